// Responses: `p or eventually[a:b] q` at every time, of which a reader wants the least of the open
// values; `p or always[a:b] q`; and their duals. The words here are those of `or`.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <type_traits>
#include <vector>

#include "core/windows.hpp"
#include "episode/streams.hpp"

namespace rtamt::episode {

// The extreme open value of a stream whose parts are known, kept from sample to sample.
class Summary {
public:
    explicit Summary(const Parts& parts) : parts_(parts), window_(*parts.late->window()) {}
    Summary(const Summary&) = delete;
    Summary& operator=(const Summary&) = delete;
    virtual ~Summary() = default;

    // Whether it holds in a world.
    virtual bool covers(World) const = 0;
    virtual void demand() {}
    virtual void prepare() {
        for (Stream* s : parts_.settled) s->retain(window_.hi + 1);
    }
    virtual void take(Time t) = 0;
    // The extreme of the open values, and of some settled ones.
    virtual double value(World w, Time t) = 0;
    virtual void reset() = 0;
    virtual void fields(Snapshot& s, Time t) = 0;

protected:
    // The greatest of the parts that settle at once.
    template <class F>
    double at_once(Time time) const {
        double x = F::identity;
        for (const Stream* s : parts_.settled) x = F::combine_alone(x, s->settled(time, 0));
        return x;
    }

    Parts parts_;
    WindowOf window_;
};

template <class F>
using Opposite = std::conditional_t<std::is_same_v<F, Min>, Max, Min>;

// The least of max(p, q[a:b]) over the windows that reach to the present, where F is Max. The later
// a window begins, the less is its q. So of two windows the earlier one does not matter if its p is
// not below that of the later one, and p rises along the others. In the first of these the greatest
// q so far is not below p: there no window matters but the last, and its value is that q. In the
// rest q is below p, and the first has the least value. A sample moves windows from the rest to the
// first, or shortens the rest from its end.
template <class F>
class Response final : public Summary {
public:
    using Summary::Summary;

    static bool fits(const WindowOf& window) {
        return window.lo >= 0 && window.greatest == std::is_same_v<F, Max> &&
               window.operand->latency() == 0;
    }
    bool covers(World w) const override { return w == kNow; }
    void prepare() override {
        Summary::prepare();
        window_.operand->retain(window_.hi + 1);
    }
    void take(Time t) override {
        const double p = at_once<F>(t);
        const double q = window_.operand->settled(t, 0);
        const Time oldest = t - window_.hi;
        if (begin_ < rest_.size() && rest_[begin_].time < oldest) ++begin_;
        if (answered_ < oldest) value_ = Opposite<F>::identity;
        if (begin_ < rest_.size() && reaches(p, rest_.back().p)) {
            const auto below = [p](const Waiting& w) { return !reaches(p, w.p); };
            rest_.erase(std::partition_point(first(), rest_.end(), below), rest_.end());
        }
        push({t, p});

        const Time newest = t - window_.lo;
        const auto answered = [=](const Waiting& w) { return w.time <= newest && reaches(w.p, q); };
        if (answered(rest_[begin_])) {
            const auto end = std::partition_point(first(), rest_.end(), answered);
            answered_ = (end - 1)->time;
            value_ = q;
            begin_ = static_cast<std::size_t>(end - rest_.begin());
        } else if (answered_ >= oldest) {
            value_ = F::combine_alone(value_, q);
        }
    }
    double value(World, Time) override {
        if (begin_ == rest_.size()) return value_;
        return Opposite<F>::combine_alone(value_, rest_[begin_].p);
    }
    void reset() override {
        rest_.clear();
        begin_ = 0;
        answered_ = -1;
        value_ = Opposite<F>::identity;
    }
    // The operands keep all values that matter.
    void fields(Snapshot& s, Time t) override {
        if (!s.reads()) return;
        reset();
        for (Time time = std::max<Time>(0, t - window_.hi); time <= t; ++time) take(time);
    }

private:
    struct Waiting {
        Time time;
        double p;
    };

    // Whether x is at least p.
    static bool reaches(double p, double x) { return same(F::combine_alone(p, x), x); }

    auto first() { return rest_.begin() + static_cast<std::ptrdiff_t>(begin_); }

    // Moves to the front of the memory before it grows.
    void push(Waiting w) {
        if (rest_.size() == rest_.capacity() && begin_ > rest_.size() / 2) {
            rest_.erase(rest_.begin(), first());
            begin_ = 0;
        }
        rest_.push_back(w);
    }

    std::vector<Waiting> rest_;  // from begin_ on, the windows whose q is below p
    std::size_t begin_ = 0;
    Time answered_ = -1;  // the last window whose q is not below p, and its value
    double value_ = Opposite<F>::identity;
};

// The least of max(p, always[a:b] q), where F is Max. It is the least of max(q, once[a:b] p), whose
// values settle at once.
template <class F>
class Duration final : public Summary {
public:
    using Least = Opposite<F>;

    explicit Duration(const Parts& parts) : Summary(parts) {
        const auto width = static_cast<std::size_t>(window_.hi - window_.lo + 1);
        if (width > 1) begun_.emplace(width);
    }

    static bool fits(const WindowOf& window) {
        return window.lo >= 0 && window.greatest == std::is_same_v<Least, Max> &&
               window.operand->latency() == 0;
    }
    // Elsewhere than at the end the unseen values must not matter.
    bool covers(World w) const override {
        if (w == kNow || is_cut(w)) return w == kNow;
        const Outlook& q = window_.operand->outlook(w);
        return q.certain && same(q.tail, Least::identity) && !window_.operand->may_be_open(w);
    }
    void take(Time t) override {
        const double p = begin(t - window_.lo);
        const double q = window_.operand->settled(t, 0);
        least_ = Least::combine_alone(least_, F::combine_alone(p, q));
    }
    double value(World, Time) override { return least_; }
    void reset() override {
        if (begun_) begun_->reset();
        least_ = Least::identity;
    }
    void fields(Snapshot& s, Time t) override {
        if (s.reads()) {
            reset();
            for (Time time = std::max<Time>(0, t - window_.hi); time <= t - window_.lo; ++time)
                begin(time);
        }
        s.numbers(&least_, 1);
    }

private:
    // Lets the window of a time begin; the least p of those that are begun and not over.
    double begin(Time time) {
        const double p = time < 0 ? Least::identity : at_once<F>(time);
        return begun_ ? begun_->push(p) : p;
    }

    std::optional<SlidingWindow<Least>> begun_;
    double least_ = Least::identity;
};

template <class F>
std::unique_ptr<Summary> summary_of(const Parts& parts) {
    if (parts.late == nullptr) return nullptr;
    if (Response<F>::fits(*parts.late->window())) return std::make_unique<Response<F>>(parts);
    if (Duration<F>::fits(*parts.late->window())) return std::make_unique<Duration<F>>(parts);
    return nullptr;
}

}  // namespace rtamt::episode
