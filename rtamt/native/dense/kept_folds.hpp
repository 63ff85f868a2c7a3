// Folds of one operand over the regions of dense time that are kept while the trace grows.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "dense/runs.hpp"

namespace rtamt::dense {

// For each position the fold from there to the last one that was taken in: stairs, of which a new
// run changes a last part to one value. The first step begins anywhere.
class Stairs {
public:
    explicit Stairs(RegionFold fold) : fold_(fold) {}

    // Takes in the next run. Returns the first position whose fold changes, kEver if none does.
    Time push(Time start, double value) {
        if (first_ < steps_.size() && same(steps_.back().value, value)) return kEver;
        while (first_ < steps_.size() && same(fold_.upper(steps_.back().value, value), value)) {
            if (same(steps_.back().value, value)) return start;  // its step lasts longer
            start = steps_.back().start;
            steps_.pop_back();
        }
        steps_.push_back({start, value});
        return start;
    }
    // Forgets what is before a position.
    void drop(Time position) {
        while (first_ + 1 < steps_.size() && steps_[first_ + 1].start <= position) ++first_;
        if (first_ < kLeast || first_ < size()) return;
        steps_.erase(steps_.begin(), steps_.begin() + static_cast<std::ptrdiff_t>(first_));
        first_ = 0;
    }
    void clear() {
        steps_.clear();
        first_ = 0;
    }

    // Writes the folds of positions from `begin`, which was taken in, to the last one; each is for a
    // position that is earlier by `lo`.
    void write(Time begin, Time lo, Runs& found) const {
        std::size_t i = steps_.size() - 1;  // mostly it is one of the last
        while (i > first_ && steps_[i].start > begin) --i;
        found.push(begin - lo, steps_[i].value);
        while (++i < steps_.size()) found.push(steps_[i].start - lo, steps_[i].value);
    }
    // The same from its first position on, which it forgets.
    void settle(Time begin, Time end, Time lo, Runs& found) {
        drop(begin);
        for (Time at = begin;;) {
            if (first_ == steps_.size()) {
                const Pair none = fold_.identity();
                found.push(at - lo, &none);
                return;
            }
            found.push(at - lo, steps_[first_].value);
            if (first_ + 1 == steps_.size() || steps_[first_ + 1].start > end) return;
            at = steps_[++first_].start;
        }
    }

private:
    static constexpr std::size_t kLeast = 16;

    struct Step {
        Time start;
        double value;
    };

    std::size_t size() const { return steps_.size() - first_; }

    RegionFold fold_;
    std::vector<Step> steps_;
    std::size_t first_ = 0;
};

// The fold of runs that come and change behind, and go in front, in two stacks: before `middle_` each
// run has the fold of those from it on to there, behind it of those from there on to it.
class KeptFold {
public:
    explicit KeptFold(RegionFold fold) : fold_(fold) {}

    double value() const {
        double total = fold_.empty();
        if (first_ < middle_) total = runs_[first_].fold;
        if (middle_ < runs_.size()) total = fold_.upper(total, runs_.back().fold);
        return total;
    }
    // Forgets the runs that end before a position.
    void drop(Time position) {
        while (first_ + 1 < runs_.size() && runs_[first_ + 1].start <= position) ++first_;
        if (first_ > middle_) turn();
        if (first_ < kLeast || first_ < runs_.size() - first_) return;
        runs_.erase(runs_.begin(), runs_.begin() + static_cast<std::ptrdiff_t>(first_));
        middle_ -= first_;
        first_ = 0;
    }
    // Forgets the runs that begin at a position or later.
    void cut(Time from) {
        while (runs_.size() > first_ && runs_.back().start >= from) runs_.pop_back();
        if (runs_.size() == first_) clear();
        if (runs_.size() < middle_) turn();
    }
    void push(Time start, double value) {
        if (first_ < runs_.size() && same(runs_.back().value, value)) return;
        const double before = middle_ < runs_.size() ? runs_.back().fold : fold_.empty();
        runs_.push_back({start, value, fold_.upper(before, value)});
    }
    void clear() {
        runs_.clear();
        first_ = middle_ = 0;
    }

private:
    static constexpr std::size_t kLeast = 16;

    struct Run {
        Time start;
        double value;
        double fold;
    };

    // Moves all runs before the middle.
    void turn() {
        middle_ = runs_.size();
        double total = fold_.empty();
        for (std::size_t i = middle_; i-- > first_;)
            runs_[i].fold = total = fold_.upper(runs_[i].value, total);
    }

    RegionFold fold_;
    std::vector<Run> runs_;
    std::size_t first_ = 0;
    std::size_t middle_ = 0;
};

}  // namespace rtamt::dense
