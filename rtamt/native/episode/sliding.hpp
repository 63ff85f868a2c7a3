// The stream of folds over offsets lo to hi from every time.
#pragma once

#include <optional>

#include "core/window.hpp"
#include "episode/kept.hpp"

namespace rtamt::episode {

// A window that reaches into the open has the fold of its settled elements in kept_, which one that
// settles updates in one stretch for all the windows it is in; the open rest of a window is a
// prefix, a suffix, all, or the inside of what is open. Where nobody looks at open values, a
// two-stack queue finds the settled one.
template <class M>
class SlidingStream final : public Stream {
public:
    using Element = typename M::Element;

    SlidingStream(Desk& desk, Time lo, Time hi, Stream& p, Stream& q)
        : SlidingStream(desk, lo, hi, Operands<M>(p, q)) {}

    void demand() override {
        if (alive()) in_.enliven();
        for (World w : kAll)
            if (looks(w)) in_.want(w);
    }

    void prepare() override {
        bool seen = false;
        for (World w : kAll) seen |= (wanted(w) || summarised(w)) && opens(w);
        if (seen || speaks_of() != 0) {
            in_.hold(in_.late(), 0);
            kept_ = Kept<M>(corners());
        } else {
            in_.hold(late_, hi_);
            if (lo_ != hi_) queue_.emplace(static_cast<std::size_t>(hi_ - lo_ + 1));
        }
        keeps_ = kept_.corners() > 0;
    }

    void settle(Time t, const double*) override {
        if (keeps_) {
            keep(t);
        } else {
            const Time newest = t - late_ + hi_;
            Element x = M::identity;
            if (newest >= 0) {
                x = in_.settled(newest, 0);
                if (queue_) x = queue_->push(x);
            }
            if (t >= late_) append(0, M::result(x));
        }
        last_ = std::max<Time>(-1, t - late_);
    }

    void look(World w, Time t) override {
        const Element tail = in_.tail(w);
        tail_[w] = M::result(M::combine(tail, tail));
        const Time first = last_ + 1;
        const Time end = this->end(w, t);
        if (end < first) {
            open_[w] = {};
            return;
        }
        const auto count = static_cast<std::size_t>(end - first + 1);
        const Time open_from = std::max<Time>(0, t - in_.late() + 1);
        const Time open_to = std::max(in_.end(w, t), open_from - 1);
        if (open_to < open_from && count <= kept_.size() && corners() == 1 && neutral_[w]) {
            open_[w] = {kept_.results(), count};
            return;
        }
        fill(w, first, count, open_from, open_to, tail);
    }

    // Where no operand is open, what is open is what is kept, which knows its extremes.
    bool summarises() const override {
        if ((lo_ != 0 && hi_ != 0) || M::kind == Kind::back || speaks_of() != 0) return false;
        for (World w : {kLower, kUpper}) {
            if (!in_.certain(w) || in_.opens(w)) return false;
            if (M::kind == Kind::single && !in_.absorbs(w) && !neutral_[w]) return false;
        }
        return !in_.opens(kNow);
    }
    Extremes extremes(World w, Time t) const override {
        return end(w, t) <= last_ ? Extremes{} : kept_.extremes(in_.tail(w));
    }

    void substitute(std::size_t unknown, const double* value) override {
        Stream::substitute(unknown, value);
        kept_.substitute(unknown, value);
    }

    void reset() override {
        Stream::reset();
        if (keeps_) kept_.clear();
        if (queue_) queue_->reset();
    }
    void save(Writer& out) const override {
        Stream::save(out);
        if (keeps_) kept_.save(out);
        if (queue_) queue_->save(out);
    }
    void load(Reader& in, Time t) override {
        Stream::load(in, t);
        const Time newest = t - in_.late() - lo_;  // the last time whose window has begun
        if (keeps_)
            kept_.load(in, static_cast<std::size_t>(
                               t < in_.late() ? 0 : std::max<Time>(0, newest - last_)));
        if (queue_) queue_->load(in);
    }

private:
    SlidingStream(Desk& desk, Time lo, Time hi, Operands<M> in)
        : Stream(desk, std::max<Time>(0, in.late() + hi), in.speaks_of()),
          in_(in),
          lo_(lo),
          hi_(hi) {
        for (World w : {kLower, kUpper}) {
            const Time shift = in.absorbs(w) ? hi : lo;
            // Windows that lie before time 0 are empty, whatever the tail.
            outlook_[w] = {std::max(-late_, in.reach(w) - shift),
                           std::max({Time{-1}, in.floor(w) - shift, -hi - 1}), in.certain(w),
                           in.tail_of_tails(w)};
            neutral_[w] = in.neutral(w);
        }
    }

    void keep(Time t) {
        const Time base = std::max<Time>(0, t - late_);
        const Time time = t - in_.late();
        if (time >= 0) {
            const auto size = static_cast<std::size_t>(std::max<Time>(0, time - lo_ + 1 - base));
            const auto from = static_cast<std::size_t>(std::max<Time>(0, time - hi_ - base));
            kept_.extend(size);
            for (std::size_t c = 0; c < corners(); ++c)
                kept_.fold_in(c, from, in_.settled(time, c));
        }
        if (t < late_) return;
        const bool any = kept_.size() > 0;
        for (std::size_t c = 0; c < corners(); ++c)
            append(c, any ? kept_.first(c) : M::result(M::identity));
        if (any) kept_.pop();
    }

    void fill(World w, Time first, std::size_t count, Time open_from, Time open_to, Element tail) {
        const Time end = first + static_cast<Time>(count) - 1;
        const auto n = static_cast<std::size_t>(open_to - open_from + 1);
        Elements in{};
        if (n > 0) in = in_.values(w, open_from, open_to, &desk_.scratch[0]);
        const std::size_t m = std::min(kept_.size(), count);
        const Elements settled = kept_.in_world(w, m, desk_, &desk_.scratch[2]);
        double* __restrict out = open(w, count);

        // The values up to time `to`, of what is settled and of newer elements: `newer` numbers
        // them from the first time that has no value yet.
        Time at = first;
        const auto ahead = [&](Time offset) {
            return static_cast<std::size_t>(at + offset - open_from);
        };
        const auto upto = [&](Time to, auto newer) {
            if (to > end) to = end;
            if (to < at) return;
            const auto begin = static_cast<std::size_t>(at - first);
            const auto stop = static_cast<std::size_t>(to - first + 1);
            const std::size_t middle = std::clamp(m, begin, stop);
            for (std::size_t i = begin; i < middle; ++i)
                out[i] = M::result(M::combine(get<M>(settled.p, settled.q, i), newer(i - begin)));
            for (std::size_t i = middle; i < stop; ++i) out[i] = M::result(newer(i - begin));
            at = to + 1;
        };
        upto(open_from - 1 - hi_, [](std::size_t) { return M::identity; });

        const Time prefix_to = std::min({open_from - lo_, open_to - hi_, end});
        if (at <= prefix_to) {
            const auto used = static_cast<std::size_t>(prefix_to + hi_ - open_from + 1);
            const Room<M> room(desk_.scratch[4], desk_.scratch[5], used);
            prefixes<M>(in, used, room);
            const Elements prefix = room.elements() + ahead(hi_);
            upto(prefix_to, [=](std::size_t i) { return get<M>(prefix.p, prefix.q, i); });
        }
        const Time whole_to = std::min(open_from - lo_, end);
        if (at <= whole_to) {
            const Element whole = M::combine(fold<M>(M::identity, in, n), tail);
            upto(whole_to, [=](std::size_t) { return whole; });
        }
        const Time inside_to = std::min(open_to - hi_, end);
        if (at <= inside_to) {
            const Room<M> room(desk_.scratch[6], desk_.scratch[7], n);
            windows<M>(in, n, static_cast<std::size_t>(hi_ - lo_ + 1), room);
            const Elements inside = room.elements() + ahead(lo_);
            upto(inside_to, [=](std::size_t i) { return get<M>(inside.p, inside.q, i); });
        }
        const Time suffix_to = std::min(open_to - lo_, end);
        if (at <= suffix_to) {
            const Room<M> room(desk_.scratch[8], desk_.scratch[9], n);
            suffixes<M>(in, ahead(lo_), n, tail, room);
            const Elements suffix = room.elements() + ahead(lo_);
            upto(suffix_to, [=](std::size_t i) { return get<M>(suffix.p, suffix.q, i); });
        }
        upto(end, [=](std::size_t) { return tail; });
    }

    Operands<M> in_;
    Time lo_;
    Time hi_;
    bool keeps_ = false;
    std::array<bool, kWorlds> neutral_{true, false, false};
    Kept<M> kept_;
    std::optional<Sliding<M>> queue_;
};

}  // namespace rtamt::episode
