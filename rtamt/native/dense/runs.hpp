// Signals over the regions of dense time as runs of equal values, and their folds. The definition
// is rtamt/machines/dense/runs.py.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/folds.hpp"
#include "core/order.hpp"
#include "core/snapshot.hpp"
#include "dense/time.hpp"

namespace rtamt::dense {

// A lattice fold that is known when the program runs.
struct RegionFold {
    bool least = true;  // whether the fold of nothing is +inf
    Kind kind = Kind::single;

    // The first number of a pair is folded the other way than the last.
    double lower(double x, double y) const {
        return least == (kind == Kind::single) ? lesser(x, y) : greater(x, y);
    }
    double upper(double x, double y) const { return least ? lesser(x, y) : greater(x, y); }
    Pair combine(Pair x, Pair y) const {
        if (kind == Kind::single) return {0.0, upper(x.q, y.q)};
        if (kind == Kind::back) std::swap(x, y);
        return {lower(x.p, y.p), upper(x.q, lower(x.p, y.q))};
    }
    double empty() const { return least ? kInfinity : -kInfinity; }
    Pair identity() const { return {kind == Kind::single ? 0.0 : -empty(), empty()}; }
};

// Throws std::invalid_argument if there is no such fold.
RegionFold fold_named(const std::string& name);

constexpr Time kEver = std::numeric_limits<Time>::max();

// Runs of a signal that lie in memory of others, from a position on. With one operand the first
// numbers of pairs play no part. Every run has an element for each corner.
struct RunsView {
    const Time* starts;
    const Pair* values;
    std::size_t count;
    std::size_t corners;
    Time begin;  // the first run begins here or before

    std::size_t size() const { return count; }
    Time start(std::size_t run) const { return run == 0 ? begin : starts[run]; }
    const Pair* at(std::size_t run) const { return values + run * corners; }
    // The run in which a position lies; the first one, if it begins later.
    std::size_t place(Time position) const {
        if (count == 0) return 0;
        if (starts[count - 1] <= position) return count - 1;  // mostly
        const Time* after = std::upper_bound(starts, starts + count, position);
        return after == starts ? 0 : static_cast<std::size_t>(after - starts) - 1;
    }
    // The runs from a position on, which lies inside or before them, up to an end.
    RunsView clipped(Time from, Time end = kEver) const;
};

// Runs of elements: a run lasts from its start to the next one. They are a queue, whose front moves
// inside its memory: what lasts as long as a window is not allocated again and again.
class Runs {
public:
    explicit Runs(std::size_t corners = 1) : corners_(corners) {}

    std::size_t corners() const { return corners_; }
    std::size_t size() const { return starts_.size() - first_; }
    bool empty() const { return starts_.size() == first_; }
    Time start(std::size_t run) const { return starts_[first_ + run]; }
    Time last_start() const { return starts_.back(); }
    const Pair* at(std::size_t run) const { return values_.data() + (first_ + run) * corners_; }
    Pair* at(std::size_t run) { return values_.data() + (first_ + run) * corners_; }
    RunsView view() const {
        return {starts_.data() + first_, at(0), size(), corners_, empty() ? 0 : start(0)};
    }

    Pair* add(Time start) {
        starts_.push_back(start);
        values_.resize(values_.size() + corners_);
        return at(size() - 1);
    }
    void add(Time start, const Pair* elements) {
        starts_.push_back(start);
        values_.insert(values_.end(), elements, elements + corners_);
    }
    void add(Time start, Pair element) {
        starts_.push_back(start);
        values_.insert(values_.end(), corners_, element);
    }
    // The run of a signal; equal ones merge.
    void push(Time start, const Pair* elements) {
        if (!empty()) {
            const Pair* last = values_.data() + values_.size() - corners_;
            bool equal = true;
            for (std::size_t c = 0; c < corners_; ++c) equal &= same(last[c].q, elements[c].q);
            if (equal) return;
        }
        add(start, elements);
    }
    // The same where all corners have one value.
    void push(Time start, double value) {
        if (!empty() && uniform(value)) return;
        add(start, Pair{0.0, value});
    }
    // Keeps memory for so many runs.
    void reserve(std::size_t runs) {
        starts_.reserve(runs);
        values_.reserve(runs * corners_);
    }
    void append(const RunsView& other) {
        for (std::size_t i = 0; i < other.size(); ++i) push(other.start(i), other.at(i));
    }
    // Forgets the first runs, or those that begin at a position or later, or all.
    void drop(std::size_t runs) {
        first_ += runs;
        if (first_ < kLeast || first_ < size()) return;
        starts_.erase(starts_.begin(), starts_.begin() + static_cast<std::ptrdiff_t>(first_));
        values_.erase(values_.begin(),
                      values_.begin() + static_cast<std::ptrdiff_t>(first_ * corners_));
        first_ = 0;
    }
    void cut(Time from) {
        while (!empty() && starts_.back() >= from) {
            starts_.pop_back();
            values_.resize(values_.size() - corners_);
        }
    }
    void clear() {
        starts_.clear();
        values_.clear();
        first_ = 0;
    }
    void restart(std::size_t corners) {
        clear();
        corners_ = corners;
    }

    // The elements of all runs, one behind the other.
    std::span<Pair> elements() { return {at(0), size() * corners_}; }
    void fields(Snapshot& s);

private:
    static constexpr std::size_t kLeast = 16;

    bool uniform(double value) const {
        bool equal = true;
        for (std::size_t c = values_.size() - corners_; c < values_.size(); ++c)
            equal &= same(values_[c].q, value);
        return equal;
    }

    std::vector<Time> starts_;
    std::vector<Pair> values_;
    std::size_t first_ = 0;
    std::size_t corners_;
};

// What folds need of memory.
struct FoldMemory {
    std::vector<Pair> older;
    std::vector<Pair> younger;
    std::vector<Pair> total;
};

// These write behind what is found already. Two signals as one of pairs, from a position on:
void join(const RunsView& p, const RunsView& q, Time begin, Runs& found);

// The elements of a fold of two operands: see `paired` in rtamt/machines/dense/runs.py. The last
// run ends at `end`, if there is one.
void pair_up(RegionFold fold, const RunsView& pairs, std::optional<Time> end, Runs& found);

// The fold over offsets lo to hi of every position from begin to end.
void slide(RegionFold fold, const RunsView& runs, Time lo, Time hi, Time begin, Time end,
           FoldMemory& memory, Runs& found);

// For each run the fold of all from it on; `rest` has an element for each corner, which comes last.
void fold_suffixes(RegionFold fold, const RunsView& runs, Time lo, const std::vector<Pair>& rest,
                   FoldMemory& memory, Runs& found);

}  // namespace rtamt::dense
