// The stream of a window with two ends: at every time, the fold over the offsets lo to hi.
#pragma once

#include <optional>

#include "core/windows.hpp"
#include "episode/partial_folds.hpp"

namespace rtamt::episode {

// Windows that have open elements keep the fold of their settled ones in partial_; a new settled
// element changes all those that it is in, which stand side by side. The open elements of a window
// are a prefix, a suffix, the whole, or the inside of all open elements. Where nobody wants open
// values, a two-stack queue folds the settled ones.
template <class F>
class SlidingStream final : public Stream {
public:
    using Element = typename F::Element;

    SlidingStream(Workspace& workspace, Operands<F> in, Time lo, Time hi, const Role& role)
        : Stream(workspace, std::max<Time>(0, in.latency() + hi), in.unknown_mask(),
                 in.streams()),
          in_(in),
          lo_(lo),
          hi_(hi),
          endless_from_(role.endless_from) {
        goes_over_ = endless_from_.has_value();
        for (World w : kAhead) {
            const Time shift = in.absorbs(w) ? hi : lo;
            // Windows that lie before time 0 are empty, whatever the tail.
            outlook_[w] = {std::max(-latency_, in.reach(w) - shift),
                           std::max({Time{-1}, in.floor(w) - shift, -hi - 1}), in.certain(w),
                           in.tail_of_tails(w)};
            skips_[w] = in.skips(w, hi, role);
            neutral_[w] = skips_[w] || in.neutral(w);
            if (skips_[w]) outlook_[w] = alone(w);
            if (!is_cut(w) || !goes_over_) continue;
            const Outlook& open = outlook_[open_of(w)];
            // The tail is that of the open reading, so every value before it is open, a certain one too.
            outlook_[w] = {std::max({outlook_[w].reach, open.reach, -*endless_from_}),
                           std::max(outlook_[w].floor, open.floor), open.certain, open.tail};
        }
    }

    void prepare() override {
        for (World w : kAll) has_partial_ |= (wanted(w) || summarised(w)) && may_be_open(w);
        has_partial_ |= unknown_mask() != 0;
        partial_ = PartialFolds<F>(corners());
        if (has_partial_) {
            in_.retain(in_.latency(), 0);
        } else {
            bool cut = false;
            for (World w : kAtEnd) cut |= finds_open(w);
            in_.retain(latency_, cut ? std::min(lo_ + 1, hi_) : hi_);
            if (lo_ != hi_) queue_.emplace(static_cast<std::size_t>(hi_ - lo_ + 1));
        }
    }

    void settle(Time t, const double*) override {
        if (has_partial_) {
            fold_into_partial(t);
        } else {
            const Time newest = t - latency_ + hi_;
            Element x = F::identity;
            if (newest >= 0) {
                x = in_.settled(newest, 0);
                if (queue_) x = queue_->push(x);
            }
            if (t >= latency_) append(0, F::result(x));
        }
        last_ = std::max<Time>(-1, t - latency_);
    }

    void find_open(World w, Time t) override {
        const Element tail = skips_[w] ? F::identity : in_.tail(w);
        tail_[w] = F::result(F::combine(tail, tail));
        if (skips_[w] && lo_ == 0) tail_[w] = in_.last().tail(w);
        const bool over = is_cut(w) && goes_over_;
        if (over) tail_[w] = Stream::tail(open_of(w));
        const std::size_t count = open_count(w, t);
        if (count == 0) {
            open_[w] = {};
            return;
        }
        if (!has_partial_) fold_retained(t);
        const Time open_from = std::max<Time>(0, t - in_.latency() + 1);
        const Time open_to = std::max(skips_[w] ? t : in_.end(w, t), open_from - 1);
        if (open_to < open_from && count <= partial_.size() && corners() == 1 && neutral_[w] &&
            !over) {
            open_[w] = {partial_.results(), count};
            return;
        }
        double* out = fill(w, count, open_from, open_to, tail);
        if (skips_[w] && lo_ == 0) write_from(out, t + 1, w, t, in_.last(), w);
        if (over) write_from(out, t + 1 - *endless_from_, w, t, *this, open_of(w));
    }

    // Where no operand has open values, the open values are partial folds with the tail.
    bool summarises(World, bool) const override {
        if ((lo_ != 0 && hi_ != 0) || F::kind == Kind::back || unknown_mask() != 0) return false;
        for (World w : {kLower, kUpper}) {
            if (skips_[w] || !in_.certain(w) || in_.may_be_open(w)) return false;
            if (F::kind == Kind::single && !in_.absorbs(w) && !neutral_[w]) return false;
        }
        return !in_.may_be_open(kNow);
    }
    Extremes extremes(World w, Time t) const override {
        return end(w, t) <= last_ ? Extremes{} : partial_.extremes(in_.tail(w));
    }

    std::optional<WindowOf> window() const override {
        if (F::width > 1) return {};
        return WindowOf{in_.only(), lo_, hi_, !(component<F>(F::identity, 0) > 0)};
    }

    std::span<const double> folded() const override {
        return {partial_.results(), partial_.size()};
    }

    void substitute(std::size_t unknown, const double* value) override {
        Stream::substitute(unknown, value);
        partial_.substitute(unknown, value);
    }

    void reset() override {
        Stream::reset();
        partial_.clear();
        if (queue_) queue_->reset();
    }
    void fields(Snapshot& s, Time t) override {
        Stream::fields(s, t);
        const Time newest = t - in_.latency() - lo_;  // the last time whose window has begun
        if (has_partial_)
            partial_.fields(s, static_cast<std::size_t>(
                                   t < in_.latency() ? 0 : std::max<Time>(0, newest - last_)));
        if (queue_) queue_->fields(s);
    }

private:
    bool reads_ahead(World, bool ahead) const override { return ahead || hi_ > 0; }

    // Folds the settled element of a time into the windows that begin at time `base` or later.
    void fold_into_windows(Time time, Time base) {
        const auto size = static_cast<std::size_t>(std::max<Time>(0, time - lo_ + 1 - base));
        const auto from = static_cast<std::size_t>(std::max<Time>(0, time - hi_ - base));
        partial_.extend(size);
        for (std::size_t c = 0; c < corners(); ++c)
            partial_.fold_in(c, from, in_.settled(time, c));
    }
    // The partial folds of a trace that ends, where no sample needed them.
    void fold_retained(Time t) {
        partial_.clear();
        for (Time time = std::max<Time>(0, last_ + 1 + lo_); time <= t - in_.latency(); ++time)
            fold_into_windows(time, last_ + 1);
    }
    void fold_into_partial(Time t) {
        const Time time = t - in_.latency();
        if (time >= 0) fold_into_windows(time, std::max<Time>(0, t - latency_));
        if (t < latency_) return;
        const bool any = partial_.size() > 0;
        for (std::size_t c = 0; c < corners(); ++c)
            append(c, any ? partial_.first(c) : F::result(F::identity));
        if (any) partial_.pop();
    }

    // What comes after the last sample if unseen elements are skipped: each window's own.
    Outlook alone(World w) const {
        if (lo_ > 0) return {std::max(-latency_, -lo_), -1, true, F::result(F::identity)};
        const Outlook& own = in_.last().outlook(w);
        return {std::max<Time>(0, own.reach), own.floor, own.certain, own.tail};
    }

    double* fill(World w, std::size_t count, Time open_from, Time open_to, Element tail) {
        const Time first = last_ + 1;
        const Time end = last_ + static_cast<Time>(count);
        const auto n = static_cast<std::size_t>(open_to - open_from + 1);
        Elements in{};
        if (n > 0) in = in_.values(w, open_from, open_to, &workspace_.scratch[0]);
        const std::size_t m = std::min(partial_.size(), count);
        const Elements settled = partial_.in_world(w, m, workspace_, &workspace_.scratch[2]);
        double* out = open(w, count);

        // Writes the values up to time `to`: folds of the settled elements and of newer ones, of
        // which the first is for the first time that has no value yet.
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
            if (begin < middle)
                combine_results<F>(settled + begin, newer, out + begin, middle - begin);
            newer = newer + (middle - begin);
            for (std::size_t i = middle; i < stop; ++i)
                out[i] = F::result(get<F>(newer, i - middle));
            at = to + 1;
        };
        upto(open_from - 1 - hi_, Repeated<F>{F::identity});

        const Time prefix_to = std::min({open_from - lo_, open_to - hi_, end});
        if (at <= prefix_to) {
            const auto used = static_cast<std::size_t>(prefix_to + hi_ - open_from + 1);
            const ElementBuffer<F> buffer(workspace_.scratch[4], workspace_.scratch[5], used);
            prefixes<F>(in, used, buffer);
            upto(prefix_to, buffer.elements() + ahead(hi_));
        }
        const Time whole_to = std::min(open_from - lo_, end);
        if (at <= whole_to) {
            const Element whole = F::combine_alone(fold<F>(F::identity, in, n), tail);
            upto(whole_to, Repeated<F>{whole});
        }
        const Time inside_to = std::min(open_to - hi_, end);
        if (at <= inside_to) {
            const ElementBuffer<F> buffer(workspace_.scratch[6], workspace_.scratch[7], n);
            windows<F>(in, n, static_cast<std::size_t>(hi_ - lo_ + 1), buffer);
            upto(inside_to, buffer.elements() + ahead(lo_));
        }
        const Time suffix_to = std::min(open_to - lo_, end);
        if (at <= suffix_to) {
            const ElementBuffer<F> buffer(workspace_.scratch[8], workspace_.scratch[9], n);
            suffixes<F>(in, ahead(lo_), n, tail, buffer);
            upto(suffix_to, buffer.elements() + ahead(lo_));
        }
        upto(end, Repeated<F>{tail});
        return out;
    }

    Operands<F> in_;
    Time lo_;
    Time hi_;
    std::optional<Time> endless_from_;
    bool has_partial_ = false;
    std::array<bool, kWorlds> neutral_{true};
    std::array<bool, kWorlds> skips_{};
    PartialFolds<F> partial_;
    std::optional<SlidingWindow<F>> queue_;
};

}  // namespace rtamt::episode
