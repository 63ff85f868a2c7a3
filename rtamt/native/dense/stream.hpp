// The values of a register over dense time, from when they are known to when all have read them.
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

namespace rtamt::dense {

// Tells 0.0 from -0.0: what is the same in every bit has the same future.
inline bool same(double x, double y) {
    return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
}
inline bool same(Pair x, Pair y) { return same(x.p, y.p) && same(x.q, y.q); }

// Vectors as snapshots hold them: their size, then what is in them.
template <class T>
inline void save(Writer& out, const std::vector<T>& values) {
    out.put<std::uint64_t>(values.size());
    out.put(values.data(), values.size());
}
template <class T>
inline void load(Reader& in, std::vector<T>& values) {
    const auto count = in.get<std::uint64_t>();
    Reader::require(count <= in.size() / sizeof(T));
    values.resize(count);
    in.get(values.data(), count);
}

inline bool rises(const double* times, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        if (!std::isfinite(times[i]) || (i > 0 && !(times[i] > times[i - 1]))) return false;
    return true;
}

// A right-continuous step function: steps (time, value), of which each lasts until the next one.
// Steps that all readers have read are dropped, but for the last, whose value still counts.
class Stream {
public:
    Stream() { clear(); }

    std::size_t add_reader() {
        next_.push_back(1);
        return next_.size() - 1;
    }

    // The time before which no step will come any more.
    double frontier() const { return frontier_; }
    void settle(double frontier) { frontier_ = frontier; }

    // -inf before the first step.
    double last_time() const { return times_[end_ - 1]; }

    // What a reader has not read yet. times[unread] is inf or a later time; values[-1] is the value
    // before these steps, nan where there is none.
    std::size_t unread(std::size_t reader) const { return end_ - next_[reader]; }
    const double* times(std::size_t reader) const { return times_.data() + next_[reader]; }
    const double* values(std::size_t reader) const { return values_.data() + next_[reader]; }
    void consume(std::size_t reader, std::size_t n) { next_[reader] += n; }
    void unconsume(std::size_t reader, std::size_t n) { next_[reader] -= n; }

    // Steps as they come.
    void extend(const double* times, const double* values, std::size_t n) {
        reserve(n);
        std::copy_n(times, n, times_.data() + end_);
        std::copy_n(values, n, values_.data() + end_);
        end_ += n;
        times_[end_] = kInfinity;
    }
    // Takes back the last steps, which nobody has read.
    void retract(std::size_t n) {
        end_ -= n;
        times_[end_] = kInfinity;
    }

    // Steps, without those that change nothing: 0.0 and -0.0 are the same to what comes after.
    void append(const double* times, const double* values, std::size_t n) {
        reserve(n);
        double* t = times_.data();
        double* v = values_.data();
        std::size_t end = end_;
        double last = v[end - 1];
        for (std::size_t i = 0; i < n; ++i) {
            const double value = values[i];
            t[end] = times[i];
            v[end] = value;
            end += !(value == last);
            last = value;
        }
        end_ = end;
        t[end] = kInfinity;
    }

    // The value from a time on, which is the last step's, if nobody has read it, or later.
    void set(double time, double value) {
        if (last_time() == time && end_ > read()) {
            --end_;
            times_[end_] = kInfinity;
        }
        append(&time, &value, 1);
    }

    // Gives back memory that much more steps needed.
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
        times_[0] = -kInfinity;
        values_[0] = std::nan("");
        times_[1] = kInfinity;
        end_ = 1;
        frontier_ = -kInfinity;
        std::fill(next_.begin(), next_.end(), 1);
    }

    void save(Writer& out) const {
        const std::size_t first = kept();
        out.put<std::uint64_t>(end_ - first);
        out.put(times_.data() + first, end_ - first);
        out.put(values_.data() + first, end_ - first);
        for (const std::size_t next : next_) out.put<std::uint64_t>(next - first);
        out.put(frontier_);
    }
    void load(Reader& in) {
        clear();
        const auto count = in.get<std::uint64_t>();
        Reader::require(count >= 1 && count <= in.size() / (2 * sizeof(double)));
        end_ = 0;
        reserve(count);
        in.get(times_.data(), count);
        in.get(values_.data(), count);
        end_ = count;
        times_[end_] = kInfinity;
        const bool whole = times_[0] == -kInfinity && values_[0] != values_[0];
        Reader::require(rises(times_.data() + whole, count - whole));
        for (std::size_t i = whole; i < count; ++i) Reader::require(values_[i] == values_[i]);
        for (std::size_t& next : next_) {
            next = in.get<std::uint64_t>();
            Reader::require(next >= 1 && next <= end_);
        }
        frontier_ = in.get<double>();
        Reader::require(frontier_ == frontier_);
    }

private:
    // The end of what a reader has read.
    std::size_t read() const {
        std::size_t end = 1;
        for (const std::size_t next : next_) end = std::max(end, next);
        return end;
    }

    // The oldest step that is needed.
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
        // Half of the room is free now: steps move once in as many appends as there are steps.
        move(first);
    }

    // Drops the steps before a place.
    void move(std::size_t first) {
        end_ -= first;
        std::memmove(times_.data(), times_.data() + first, end_ * sizeof(double));
        std::memmove(values_.data(), values_.data() + first, end_ * sizeof(double));
        times_[end_] = kInfinity;
        for (std::size_t& next : next_) next -= first;
    }

    static constexpr std::size_t kLeast = 64;

    // In front of all steps stands (-inf, nan), behind them the time inf.
    std::vector<double> times_;
    std::vector<double> values_;
    std::size_t end_;
    std::vector<std::size_t> next_;  // of each reader
    double frontier_;
};

}  // namespace rtamt::dense
