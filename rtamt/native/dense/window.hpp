// Folds of the steps inside a window that moves over dense time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <vector>

#include "dense/stream.hpp"

namespace rtamt::dense {

// The fold of the steps inside a window. A step enters when the end of the window reaches its
// start, and leaves when the begin, `lo` from now, reaches the start of the next step; without a
// begin none leaves.
//
// A queue of two stacks. back_ holds the newer steps. front_ holds folds of the older ones: each is
// valid until its time, when the oldest steps leave and the next fold takes its place; equal folds
// are stored once. When front_ is used up, all steps of back_ but the newest move there.
template <class F>
class Queue {
public:
    using Element = typename F::Element;

    explicit Queue(std::optional<Time> lo) : lo_(lo.value_or(0)), bounded_(lo.has_value()) {}

    Element fold() const { return F::combine_alone(older_, newer_); }
    // The time at which the oldest step leaves; kAfter while the end of the only step is not known.
    Time leaves() const { return leaves_; }

    // Adds a step, with which the one before ends. Returns whether the fold changed.
    bool push(Time start, Element x) {
        if (bounded_) {
            if (back_.size() == 1 && front_.empty()) leaves_ = start - lo_;
            back_.push_back({start, x});
        }
        const Element newer = F::combine_alone(newer_, x);
        const bool changed = !same(newer, newer_);
        newer_ = newer;
        return changed;
    }
    void pop() {
        if (front_.empty()) {
            flip();
        } else {
            front_.pop_back();
        }
        refresh();
    }
    void clear() {
        front_.clear();
        back_.clear();
        older_ = newer_ = F::identity;
        leaves_ = kAfter;
    }

    void fields(Snapshot& s) {
        s.sized(front_);
        s.sized(back_);
        s(newer_);
        if (!s.reads()) return;
        for (std::size_t i = 0; i < front_.size(); ++i)
            s.require(i == 0 || front_[i].time <= front_[i - 1].time);
        for (std::size_t i = 0; i < back_.size(); ++i)
            s.require(counts(back_[i].time) && (i == 0 || back_[i].time > back_[i - 1].time));
        s.require(bounded_ || (front_.empty() && back_.empty()));
        s.require(!back_.empty() || front_.empty());
        refresh();
    }

private:
    struct Timed {
        Time time;
        Element x;
    };

    // Drops the oldest step of back_, and moves the others but the newest to front_.
    void flip() {
        Element fold = F::identity;
        for (std::size_t i = back_.size() - 1; i-- > 1;) {
            const Element longer = F::combine_alone(back_[i].x, fold);
            if (front_.empty() || !same(longer, fold))
                front_.push_back({back_[i + 1].time - lo_, longer});
            fold = longer;
        }
        back_.front() = back_.back();
        back_.resize(1);
        newer_ = F::combine_alone(F::identity, back_.front().x);
    }
    void refresh() {
        older_ = front_.empty() ? F::identity : front_.back().x;
        if (!front_.empty()) {
            leaves_ = front_.back().time;
        } else {
            leaves_ = back_.size() > 1 ? back_[1].time - lo_ : kAfter;
        }
    }

    Time lo_;
    bool bounded_;  // whether steps ever leave
    Time leaves_ = kAfter;
    Element older_ = F::identity;  // the fold of the steps in front_
    Element newer_ = F::identity;  // the fold of the steps in back_
    std::vector<Timed> front_;     // folds with the times at which they end, the first one last
    std::vector<Timed> back_;      // steps with their starts
};

// The node of WINDOW: at time s, the fold of the values from s + lo to s + hi, both included.
// Without lo no step leaves; without hi all steps enter at the end of the trace.
template <class F>
class WindowNode final : public StreamNode {
public:
    WindowNode(Joint in, std::optional<Time> lo, std::optional<Time> hi, Stream& out)
        : in_(std::move(in)), lo_(lo.value_or(0)), hi_(hi), out_(out), queue_(lo) {}

    void begin(Time first) override { first_ = first; }
    void advance(Time known) override {
        if (!hi_) return;
        const Time limit = std::min(known, earlier(in_.frontier(), *hi_));
        if (!(limit > out_.frontier())) return;
        run(limit);
        out_.settle(limit);
    }
    void finish(Time end, Time after) override {
        run(after);
        if (lo_ > 0) {  // the window ends with the trace, and is empty from then on
            queue_.clear();
            out_.set(std::max(end - lo_, first_), F::result(F::identity));
        }
        out_.settle(after);
    }

    void reset() override {
        queue_.clear();
        first_ = kAfter;
        begun_ = false;
    }
    void fields(Snapshot& s) override {
        s(first_, begun_);
        s.require(counts(first_) || first_ == kAfter);
        queue_.fields(s);
    }

private:
    // Computes the values at all times before limit.
    void run(Time limit) {
        if (!(first_ < limit)) return;
        if (!begun_) {
            out_.set(first_, F::result(F::identity));
            begun_ = true;
        }
        if (hi_) {
            in_.read([=, hi = *hi_](Time time) { return time - hi < limit; });
        } else {
            in_.read([](Time) { return true; });
        }
        const Time* times = in_.times();
        const double* p = in_.column(0);
        const double* q = in_.column(in_.width() - 1);
        for (std::size_t i = 0, n = in_.size(); i < n; ++i) {
            const Time comes = hi_ ? std::max(times[i] - *hi_, first_) : first_;
            leave_before(comes);
            bool changed = queue_.push(times[i], F::element(p[i], q[i]));
            while (queue_.leaves() <= comes) {
                queue_.pop();
                changed = true;
            }
            if (changed) out_.set(comes, F::result(queue_.fold()));
        }
        in_.consume();
        leave_before(limit);
    }

    void leave_before(Time limit) {
        while (queue_.leaves() < limit) {
            const Time now = std::max(queue_.leaves(), first_);
            while (queue_.leaves() <= now) queue_.pop();
            out_.set(now, F::result(queue_.fold()));
        }
    }

    Joint in_;
    Time lo_;
    std::optional<Time> hi_;
    Stream& out_;
    Time first_ = kAfter;
    bool begun_ = false;
    Queue<F> queue_;
};

}  // namespace rtamt::dense
