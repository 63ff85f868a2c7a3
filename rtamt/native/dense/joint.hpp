// Joint: several streams read as one, at all times at which one of them steps.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>
#include <vector>

#include "core/arrays.hpp"
#include "dense/stream.hpp"

namespace rtamt::dense {

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

}  // namespace rtamt::dense
