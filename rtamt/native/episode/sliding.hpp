// The stream of a window with two ends: at every time, the fold over the offsets lo to hi.
#pragma once

#include <algorithm>
#include <optional>

#include "core/windows.hpp"
#include "episode/streams.hpp"

namespace rtamt::episode {

// Partial folds: the folds of the settled elements of windows that are still open. The windows
// begin one after the other, and all of them reach to the present.
template <class F>
class PartialFolds {
public:
    using Element = typename F::Element;

    PartialFolds() = default;
    explicit PartialFolds(std::size_t corners) : lines_(corners, F::width) {}

    std::size_t size() const { return lines_.size(); }
    std::size_t corners() const { return lines_.corners(); }
    const double* results() const { return lines_.line(0, F::width - 1).data(); }
    double first(std::size_t corner) const { return lines_.line(corner, F::width - 1)[0]; }

    // Adds windows without elements, up to a number of windows.
    void extend(std::size_t size) {
        for (std::size_t c = 0; c < corners(); ++c)
            for (int k = 0; k < F::width; ++k)
                lines_.line(c, k).extend(size, component<F>(F::identity, k));
    }
    // Adds an element to the windows from number `from` on.
    void fold_in(std::size_t corner, std::size_t from, Element x) {
        if (from >= size()) return;
        double* p = lines_.line(corner, 0).data() + from;
        double* q = lines_.line(corner, F::width - 1).data() + from;
        const std::size_t n = size() - from;
        if constexpr (F::width == 1) {
            move_last<F>(p, n, x);
        } else {
            if (kAhead && corners() == 1) {
                reach(p, q, x);
            } else {
                each(p, q, n, x);
            }
        }
    }
    void pop() {
        lines_.pop();
        if (decided_ > 0) --decided_;
    }

    // The folds of the first `count` windows in a world.
    Elements in_world(World w, std::size_t count, Workspace& workspace, Scratch* scratch) const {
        if (corners() == 1) return {lines_.line(0, 0).data(), results()};
        const ElementBuffer<F> buffer(scratch[0], scratch[1], count);
        for (std::size_t i = 0; i < count; ++i) {
            buffer.p[i] = lines_.at(i, 0, w, workspace.unknowns);
            if (F::width > 1) buffer.q[i] = lines_.at(i, 1, w, workspace.unknowns);
        }
        return buffer.elements();
    }

    // The extremes of the results of all windows, each followed by an element `tail`, and of some
    // windows that were popped. Not for `since` and its dual.
    Extremes extremes(Element tail) const {
        Extremes found = decided_results_;
        const std::size_t n = size();
        if (decided_ == n) return found;
        const double* p = lines_.line(0, 0).data();
        const double* q = results();
        const auto at = [&](std::size_t i) { return F::result(F::combine(get<F>(p, q, i), tail)); };
        found.add(at(decided_));
        found.add(at(n - 1));
        if constexpr (kAhead) {  // what is reached falls, what can be reached rises
            std::size_t low = decided_;
            std::size_t high = n - 1;
            while (low < high) {
                const std::size_t middle = (low + high) / 2;
                const double limit = lower(p[middle], tail.q);
                if (same(upper(limit, q[middle]), limit)) {
                    high = middle;
                } else {
                    low = middle + 1;
                }
            }
            found.add(at(low));
            if (low > decided_) found.add(at(low - 1));
        }
        return found;
    }

    void substitute(std::size_t unknown, const double* value) { lines_.substitute(unknown, value); }
    void clear() {
        lines_.clear();
        decided_ = 0;
        decided_results_ = {};
    }
    void fields(Snapshot& s, std::size_t size) {
        lines_.fields(s, size);
        s(decided_, decided_results_);
        s.require(decided_ <= size);
    }

private:
    static constexpr bool kAhead = F::kind == Kind::ahead;
    static constexpr std::size_t kChunk = 32;

    static double lower(double x, double y) {
        return F::combine({x, F::identity.q}, {y, F::identity.q}).p;
    }
    static double upper(double x, double y) {
        return F::combine({F::identity.p, x}, {F::identity.p, y}).q;
    }

    // Moves the numbers, which rise or fall: those that change are the last ones.
    template <class G>
    static void move_last(double* p, std::size_t n, double x) {
        while (n > 0) {
            const std::size_t count = std::min(n, kChunk);
            double* last = p + (n - count);
            const bool more = !same(G::combine_alone(*last, x), *last);
            combine_results<G>({last, last}, Repeated<G>{x}, last, count);
            if (!more) return;
            n -= count;
        }
    }

    static void each(double* __restrict p, double* __restrict q, std::size_t n, Element x) {
        for (std::size_t i = 0; i < n; ++i) put<F>(p, q, i, F::combine(get<F>(p, q, i), x));
    }

    // Adds an element to all windows of `until` or its dual. In the words of `until`: the later a
    // window begins, the greater is its p. In the first windows p is not above the new q, and the
    // result is decided: no later q can change it. In the others p is above every q so far; their
    // results are the greatest of these and fall. So a new element changes only the last p and the
    // last results.
    void reach(double* p, double* q, Element x) {
        const std::size_t n = size();
        while (decided_ < n && same(lower(p[decided_], x.q), p[decided_])) {
            q[decided_] = upper(q[decided_], p[decided_]);
            decided_results_.add(q[decided_++]);
        }
        const std::size_t rest = n - decided_;
        move_last<typename F::UpperFold>(q + decided_, rest, x.q);
        move_last<typename F::LowerFold>(p + decided_, rest, x.p);
    }

    Polynomials lines_;
    std::size_t decided_ = 0;
    Extremes decided_results_;
};

// Windows that have open elements keep the fold of their settled ones in partial_; a new settled
// element changes all those that it is in, which stand side by side. The open elements of a window
// are a prefix, a suffix, the whole, or the inside of all open elements. Where nobody wants open
// values, a two-stack queue folds the settled ones.
template <class F>
class SlidingStream final : public Stream {
public:
    using Element = typename F::Element;

    SlidingStream(Workspace& workspace, Operands<F> in, Time lo, Time hi, const Role& role)
        : Stream(workspace, std::max<Time>(0, in.latency() + hi), in.unknown_mask(), in.streams()),
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
            // The tail is that of the open reading, so every value before it is open, a certain one
            // too.
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
        for (std::size_t c = 0; c < corners(); ++c) partial_.fold_in(c, from, in_.settled(time, c));
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
