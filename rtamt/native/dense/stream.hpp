// Streams: the values of registers over dense time, as far as they are known and some reader still
// needs them; and the nodes that compute them from each other.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "core/arrays.hpp"
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

    // The steps that a reader has not read yet. times[unread] is kAfter or a later time; values[-1]
    // is the value before these steps.
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

// Several streams read as one, at all times at which one of them steps.
class Joint {
public:
    void add(Stream& stream) { sources_.push_back({&stream, stream.add_reader(), 0, nullptr, {}}); }

    std::size_t width() const { return sources_.size(); }
    Time frontier() const {
        Time least = kAfter;
        for (const Source& s : sources_) least = std::min(least, s.stream->frontier());
        return least;
    }

    // Reads the steps at the first times, those that are `within`, none beyond the frontier.
    // Pointers to them hold until a stream is written.
    template <class Within>
    void read(Within within) {
        for (Source& s : sources_) s.count = reach(s, within);
        align();
    }
    // Reads the steps up to a time as one step: the values at that time.
    void read_at(Time time) {
        for (Source& s : sources_) {
            s.count = reach(s, [=](Time t) { return t <= time; });
            s.column = s.values() + s.count - 1;
        }
        instant_ = time;
        times_ = &instant_;
        size_ = 1;
    }
    // The latest time, not after `time`, up to which no stream has more than `most` steps.
    Time upto(Time time, std::size_t most) const {
        for (const Source& s : sources_)
            if (s.stream->unread(s.reader) > most) time = std::min(time, s.times()[most - 1]);
        return time;
    }
    // Drops the steps that were read.
    void consume() {
        for (const Source& s : sources_) s.stream->consume(s.reader, s.count);
    }
    // The number of steps that are left of each stream; rewind goes back to where so many were.
    std::vector<std::size_t> unread() const {
        std::vector<std::size_t> counts;
        for (const Source& s : sources_) counts.push_back(s.stream->unread(s.reader));
        return counts;
    }
    void rewind(const std::vector<std::size_t>& unread) {
        for (std::size_t i = 0; i < sources_.size(); ++i) {
            const Source& s = sources_[i];
            s.stream->unconsume(s.reader, unread[i] - s.stream->unread(s.reader));
        }
    }

    std::size_t size() const { return size_; }
    const Time* times() const { return times_; }
    const double* column(std::size_t i) const { return sources_[i].column; }

private:
    struct Source {
        Stream* stream;
        std::size_t reader;
        std::size_t count;
        const double* column;
        Scratch scratch;

        const Time* times() const { return stream->times(reader); }
        const double* values() const { return stream->values(reader); }
    };

    template <class Within>
    static std::size_t reach(const Source& s, Within within) {
        const std::size_t n = s.stream->unread(s.reader);
        const Time* times = s.times();
        if (n == 0 || !within(times[0])) return 0;
        if (within(times[n - 1])) return n;
        // Where another stream is far behind, few of many steps are read.
        std::size_t end = 1;
        while (end < n && within(times[end])) end = std::min(n, 2 * end);
        const Time* last = std::partition_point(times + end / 2, times + end, within);
        return static_cast<std::size_t>(last - times);
    }

    void align() {
        if (sources_.size() == 1) {
            Source& only = sources_[0];
            size_ = only.count;
            times_ = only.times();
            only.column = only.values();
            return;
        }
        const Source* most = &sources_[0];
        for (const Source& s : sources_)
            if (s.count > most->count) most = &s;
        size_ = most->count;
        times_ = most->times();
        for (const Source& s : sources_)
            if (!together(s, *most)) merge(s);
        for (Source& s : sources_) s.column = s.count == size_ ? s.values() : resampled(s);
    }

    // Most signals are sampled together, or one of them steps alone.
    static bool together(const Source& s, const Source& most) {
        if (&s == &most || s.count == 0) return true;
        return s.count == most.count &&
               std::memcmp(s.times(), most.times(), s.count * sizeof(Time)) == 0;
    }

    void merge(const Source& s) {
        Time* out = other_.reserve(size_ + s.count);
        const Time* a = times_;
        const Time* b = s.times();
        const Time* const a_end = a + size_;
        const Time* const b_end = b + s.count;
        std::size_t n = 0;
        while (a < a_end && b < b_end) {
            const Time x = *a;
            const Time y = *b;
            out[n++] = y < x ? y : x;
            a += x <= y;
            b += y <= x;
        }
        for (; a < a_end; ++a) out[n++] = *a;
        for (; b < b_end; ++b) out[n++] = *b;
        std::swap(merged_, other_);
        times_ = out;
        size_ = n;
    }

    const double* resampled(Source& s) {
        double* out = s.scratch.reserve(size_);
        const Time* times = s.times();
        const double* values = s.values() - 1;
        if (s.count == 0) {
            std::fill_n(out, size_, *values);
        } else {
            for (std::size_t i = 0; i < size_; ++i) {
                const bool steps = *times == times_[i];
                times += steps;
                values += steps;
                out[i] = *values;
            }
        }
        return out;
    }

    std::vector<Source> sources_;
    ScratchOf<Time> merged_;
    ScratchOf<Time> other_;
    Time instant_ = 0;
    const Time* times_ = nullptr;
    std::size_t size_ = 0;
};

// Applies a function to two columns of n values: operands, result, n.
using Function = void (*)(const double*, const double*, double*, std::size_t);

// Null if there is no such function.
Function function_named(const std::string& name);

// Computes the stream of one register from the streams of its operands.
class StreamNode {
public:
    StreamNode() = default;
    StreamNode(const StreamNode&) = delete;
    StreamNode& operator=(const StreamNode&) = delete;
    virtual ~StreamNode() = default;

    // The trace begins.
    virtual void begin(Time) {}
    // Computes as far as the frontiers of the operands allow; all variables are known before
    // `known`.
    virtual void advance(Time known) = 0;
    // Computes up to the end of the trace; `after` is the next tick. The operands are complete.
    virtual void finish(Time end, Time after) = 0;
    virtual void reset() {}
    virtual void fields(Snapshot&) {}
};

// Applies a function to the values that its operands have at the same time.
class MapNode final : public StreamNode {
public:
    MapNode(Joint in, Function function, Stream& out)
        : in_(std::move(in)), function_(function), out_(out) {}

    void advance(Time) override {
        const Time limit = in_.frontier();
        if (limit > out_.frontier()) run(limit);
    }
    void finish(Time, Time after) override { run(after); }

private:
    void run(Time limit) {
        in_.read([=](Time time) { return time < limit; });
        const std::size_t n = in_.size();
        double* values = scratch_.reserve(n);
        function_(in_.column(0), in_.column(in_.width() - 1), values, n);
        out_.append(in_.times(), values, n);
        in_.consume();
        out_.settle(limit);
    }

    Joint in_;
    Function function_;
    Stream& out_;
    Scratch scratch_;
};

}  // namespace rtamt::dense
