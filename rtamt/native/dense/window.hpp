// Folds of what happens inside a window that moves over dense time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "dense/node.hpp"

namespace rtamt::dense {

// The fold of the steps inside a window: each comes when the window's end reaches its start, and
// leaves when the window's begin, `lo` from now, reaches the start of the next one.
//
// A queue of two stacks, of any monoid: the newer steps are in back_, with their fold; of the older
// ones, front_ has the folds of those that are left whenever the oldest leaves, and only where that
// changes the fold. When front_ is used up, all of back_ but the newest step goes there.
template <class M>
class Queue {
public:
    using Element = typename M::Element;

    explicit Queue(double lo) : lo_(lo), forgets_(lo > -kInfinity) {}

    Element fold() const { return M::combine(older_, newer_); }
    // When the oldest leaves; inf while the end of the only step is not known.
    double leaves() const { return leaves_; }

    // A step comes, with which the one before ends. Whether the fold changed.
    bool push(double start, Element x) {
        if (forgets_) {
            if (back_.size() == 1 && front_.empty()) leaves_ = start - lo_;
            back_.push_back({start, x});
        }
        const Element newer = M::combine(newer_, x);
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
    // What is inside leaves at once.
    void clear() {
        front_.clear();
        back_.clear();
        older_ = newer_ = M::identity;
        leaves_ = kInfinity;
    }

    void save(Writer& out) const {
        dense::save(out, front_);
        dense::save(out, back_);
        out.put(newer_);
    }
    void load(Reader& in) {
        dense::load(in, front_);
        dense::load(in, back_);
        newer_ = in.get<Element>();
        for (std::size_t i = 0; i < front_.size(); ++i)
            Reader::require(std::isfinite(front_[i].time) &&
                            (i == 0 || front_[i].time <= front_[i - 1].time));
        for (std::size_t i = 0; i < back_.size(); ++i)
            Reader::require(std::isfinite(back_[i].time) &&
                            (i == 0 || back_[i].time > back_[i - 1].time));
        Reader::require(forgets_ || (front_.empty() && back_.empty()));
        Reader::require(!back_.empty() || front_.empty());
        refresh();
    }

private:
    struct Timed {
        double time;
        Element x;
    };

    // The oldest step leaves, the newest stays where it is.
    void flip() {
        Element fold = M::identity;
        for (std::size_t i = back_.size() - 1; i-- > 1;) {
            const Element longer = M::combine(back_[i].x, fold);
            if (front_.empty() || !same(longer, fold))
                front_.push_back({back_[i + 1].time - lo_, longer});
            fold = longer;
        }
        back_.front() = back_.back();
        back_.resize(1);
        newer_ = M::combine(M::identity, back_.front().x);
    }
    void refresh() {
        older_ = front_.empty() ? M::identity : front_.back().x;
        if (!front_.empty()) {
            leaves_ = front_.back().time;
        } else {
            leaves_ = back_.size() > 1 ? back_[1].time - lo_ : kInfinity;
        }
    }

    double lo_;
    bool forgets_;
    double leaves_ = kInfinity;
    Element older_ = M::identity;  // the fold of what front_ stands for
    Element newer_ = M::identity;  // and of back_
    std::vector<Timed> front_;     // by the time of leaving, the first to leave last
    std::vector<Timed> back_;      // by the time of coming
};

// WINDOW: at time s, the fold of what steps between s + lo and s + hi, both included. -inf and inf
// are bounds too: nothing leaves, or all comes at once at the end.
template <class M>
class Window final : public Node {
public:
    Window(Joint in, double lo, double hi, Stream& out)
        : in_(std::move(in)), lo_(lo), hi_(hi), out_(out), queue_(lo) {}

    void begin(double first) override { first_ = first; }
    void advance(double known) override {
        const double limit = std::min(known, in_.frontier() - hi_);
        if (!(limit > out_.frontier())) return;
        run(limit);
        out_.settle(limit);
    }
    void finish(double end, double after) override {
        run(after);
        if (lo_ > 0.0) {  // the window ends with the trace, and is empty from then on
            queue_.clear();
            out_.set(std::max(end - lo_, first_), M::result(M::identity));
        }
        out_.settle(after);
    }

    void reset() override {
        queue_.clear();
        first_ = kInfinity;
        begun_ = false;
    }
    void save(Writer& out) const override {
        out.put(first_);
        out.put<std::uint8_t>(begun_);
        queue_.save(out);
    }
    void load(Reader& in) override {
        first_ = in.get<double>();
        begun_ = in.get<std::uint8_t>() != 0;
        queue_.load(in);
        Reader::require(first_ == first_);
    }

private:
    // Gives the values at all times before limit.
    void run(double limit) {
        if (!(first_ < limit)) return;
        if (!begun_) {
            out_.set(first_, M::result(M::identity));
            begun_ = true;
        }
        in_.read([=, hi = hi_](double time) { return time - hi < limit; });
        const double* times = in_.times();
        const double* p = in_.column(0);
        const double* q = in_.column(in_.width() - 1);
        for (std::size_t i = 0, n = in_.size(); i < n; ++i) {
            const double comes = std::max(times[i] - hi_, first_);
            leave_before(comes);
            bool changed = queue_.push(times[i], M::element(p[i], q[i]));
            while (queue_.leaves() <= comes) {
                queue_.pop();
                changed = true;
            }
            if (changed) out_.set(comes, M::result(queue_.fold()));
        }
        in_.consume();
        leave_before(limit);
    }

    void leave_before(double limit) {
        while (queue_.leaves() < limit) {
            const double now = std::max(queue_.leaves(), first_);
            while (queue_.leaves() <= now) queue_.pop();
            out_.set(now, M::result(queue_.fold()));
        }
    }

    Joint in_;
    double lo_;
    double hi_;
    Stream& out_;
    double first_ = kInfinity;
    bool begun_ = false;
    Queue<M> queue_;
};

}  // namespace rtamt::dense
