// Stream: the values of one register over dense time, as far as they are known and some reader
// still needs them.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "core/folds.hpp"
#include "core/snapshot.hpp"
#include "dense/time.hpp"

namespace rtamt::dense {

// Equality of all bits: 0.0 and -0.0 differ.
using rtamt::same;
inline bool same(Pair x, Pair y) { return same(x.p, y.p) && same(x.q, y.q); }

// A right-continuous step function, as steps (time, value), each of which lasts until the next one.
// Steps that all readers have read are dropped, except the last, whose value still counts.
class Stream {
public:
    // Takes the value before all steps; nan if there is none.
    explicit Stream(double before = std::nan("")) : before_(before) { clear(); }

    std::size_t add_reader() {
        next_.push_back(1);
        return next_.size() - 1;
    }

    // The time before which the stream is complete.
    Time frontier() const { return frontier_; }
    void settle(Time frontier) { frontier_ = frontier; }

    // kBefore before the first step.
    Time last_time() const { return times_[end_ - 1]; }

    // The steps that a reader has not read yet. times[unread] is kAfter or a later time; values[-1] is
    // the value before these steps.
    std::size_t unread(std::size_t reader) const { return end_ - next_[reader]; }
    const Time* times(std::size_t reader) const { return times_.data() + next_[reader]; }
    const double* values(std::size_t reader) const { return values_.data() + next_[reader]; }
    void consume(std::size_t reader, std::size_t n) { next_[reader] += n; }
    void unconsume(std::size_t reader, std::size_t n) { next_[reader] -= n; }

    // Adds all steps.
    void extend(const Time* times, const double* values, std::size_t n) {
        reserve(n);
        std::copy_n(times, n, times_.data() + end_);
        std::copy_n(values, n, values_.data() + end_);
        end_ += n;
        times_[end_] = kAfter;
    }
    // Removes the last steps, which nobody has read.
    void retract(std::size_t n) {
        end_ -= n;
        times_[end_] = kAfter;
    }

    // Adds the steps that change the value or its sign: 0.0 and -0.0 differ.
    void append(const Time* times, const double* values, std::size_t n) {
        reserve(n);
        Time* t = times_.data();
        double* v = values_.data();
        std::size_t end = end_;
        double last = v[end - 1];
        for (std::size_t i = 0; i < n; ++i) {
            const double value = values[i];
            t[end] = times[i];
            v[end] = value;
            end += !same(value, last);
            last = value;
        }
        end_ = end;
        t[end] = kAfter;
    }

    // Sets the value from a time on: the last step's time, if nobody has read it, or a later one.
    void set(Time time, double value) {
        if (last_time() == time && end_ > read()) {
            --end_;
            times_[end_] = kAfter;
        }
        append(&time, &value, 1);
    }

    // Frees memory that a much longer stream needed.
    void trim() {
        move(kept());
        const std::size_t room = std::max(kLeast, 2 * (end_ + 1));
        if (2 * room > times_.size()) return;
        times_.resize(room);
        times_.shrink_to_fit();
        values_.resize(room);
        values_.shrink_to_fit();
    }

    void clear() {
        times_.resize(std::max<std::size_t>(times_.size(), 2));
        values_.resize(times_.size());
        times_[0] = kBefore;
        values_[0] = before_;
        times_[1] = kAfter;
        end_ = 1;
        frontier_ = kBefore;
        std::fill(next_.begin(), next_.end(), 1);
    }

    void fields(Snapshot& s) {
        const std::size_t first = s.reads() ? 0 : kept();
        std::size_t count = end_ - first;
        s(count);
        if (s.reads()) {
            s.require(count >= 1);
            s.require_unread<Time>(count);
            end_ = 0;
            reserve(count);
            end_ = count;
            times_[end_] = kAfter;
        }
        s.array(times_.data() + first, count);
        s.array(values_.data() + first, count);
        for (std::size_t& next : next_) {
            std::size_t place = next - first;
            s(place);
            s.require(place >= 1 && place <= count);
            next = place + first;
        }
        s(frontier_);
        if (s.reads()) require_steps(s);
    }

private:
    void require_steps(const Snapshot& s) const {
        const bool none = values_[0] != values_[0] && before_ != before_;
        const bool whole = times_[0] == kBefore && (none || same(values_[0], before_));
        s.require(rises(times_.data() + whole, end_ - whole));
        for (std::size_t i = whole; i < end_; ++i) s.require(values_[i] == values_[i]);
        s.require(frontier_ <= kTicks);
    }

    // The end of the steps that some reader has read.
    std::size_t read() const {
        std::size_t end = 1;
        for (const std::size_t next : next_) end = std::max(end, next);
        return end;
    }

    // The oldest step that a reader needs.
    std::size_t kept() const {
        std::size_t first = end_;
        for (const std::size_t next : next_) first = std::min(first, next);
        return first - 1;
    }

    void reserve(std::size_t n) {
        if (end_ + n < times_.size()) return;
        const std::size_t first = end_ > 0 ? kept() : 0;
        const std::size_t size = end_ - first;
        if (2 * (size + n + 1) > times_.size()) {
            times_.resize(std::max(kLeast, 2 * (size + n + 1)));
            values_.resize(times_.size());
        }
        // Half of the memory is free now, so that each step moves once on average.
        move(first);
    }

    // Drops the steps before a place.
    void move(std::size_t first) {
        end_ -= first;
        std::memmove(times_.data(), times_.data() + first, end_ * sizeof(Time));
        std::memmove(values_.data(), values_.data() + first, end_ * sizeof(double));
        times_[end_] = kAfter;
        for (std::size_t& next : next_) next -= first;
    }

    static constexpr std::size_t kLeast = 64;

    // Before all steps is (kBefore, before_), after them the time kAfter.
    std::vector<Time> times_;
    std::vector<double> values_;
    std::size_t end_;
    std::vector<std::size_t> next_;  // of each reader
    Time frontier_;
    double before_;
};

}  // namespace rtamt::dense
