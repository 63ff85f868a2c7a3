// The windows over the regions of dense time: those that are read at all positions, and those that
// are read at position 0 alone. The definitions are rtamt/machines/dense/regions.py.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "dense/region_streams.hpp"
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

    // Writes the folds of positions from `begin`, which was taken in, to the last one; each is for
    // a position that is earlier by `lo`.
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

// The fold of runs that come and change behind, and go in front, in two stacks: before `middle_`
// each run has the fold of those from it on to there, behind it of those from there on to it.
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

// The operands of a window, read as elements of its fold.
class Operands {
public:
    Operands(RegionFold fold, RegionStream& a, RegionStream& b) : fold(fold), a_(a), b_(b) {}

    bool single() const { return fold.kind == Kind::single; }
    Time late() const { return single() ? b_.late() : std::max(a_.late(), b_.late()); }
    Time last() const { return single() ? b_.last() : std::min(a_.last(), b_.last()); }
    void hold(Time late, Time oldest) {
        for (RegionStream* s : {&a_, &b_}) s->hold(late - s->late() - oldest);
    }
    // The only operand.
    RegionStream& only() const { return b_; }

    RunsView settled(Time begin, Time end, std::size_t corners) {
        const Time first = std::max<Time>(0, begin);
        if (first > end) {
            elements_.restart(corners);
            elements_.add(begin, fold.identity());
            return elements_.view();
        }
        if (single()) return b_.settled(first, end);
        return paired(a_.settled(first, end), b_.settled(first, end), first, end);
    }
    RunsView seen(std::size_t world, Time begin) {
        const Time first = std::max<Time>(0, begin);
        if (single()) return b_.seen(world, first, memory_[1]);
        return paired(a_.seen(world, first, memory_[0]), b_.seen(world, first, memory_[1]), first,
                      {});
    }

    // The value from some position on, as RegionStream::tail: elements of two equal numbers are
    // one.
    std::optional<double> tail(std::size_t world) const {
        const std::optional<double> q = b_.tail(world);
        if (single() || !q) return q;
        const std::optional<double> p = a_.tail(world);
        return p && same(*p, *q) ? q : std::nullopt;
    }
    // Of one operand the value of all open positions, as RegionStream::flat.
    std::optional<double> flat(std::size_t world) const {
        return single() ? b_.flat(world) : std::nullopt;
    }
    bool as_now(std::size_t world) const { return a_.as_now(world) && b_.as_now(world); }

    const RegionFold fold;

private:
    RunsView paired(const RunsView& p, const RunsView& q, Time begin, std::optional<Time> end) {
        pairs_.restart(p.corners);
        join(p, q, begin, pairs_);
        elements_.restart(p.corners);
        pair_up(fold, pairs_.view(), end, elements_);
        return elements_.view();
    }

    RegionStream& a_;
    RegionStream& b_;
    std::array<Runs, 2> memory_;
    Runs pairs_;
    Runs elements_;
};

// How a window reads the end of a trace.
struct Reading {
    explicit Reading(const FormulaRow& row, RegionFold fold)
        : ahead(!row.hi || *row.hi > 0),
          guard(row.guard),
          endless(row.endless || !row.hi),
          least(fold.least),
          begin(row.guard ? *row.hi + 1 : row.lo.value_or(0)) {}

    // Whether it reads nothing behind the last position but its own.
    bool stops(std::size_t world) const {
        if (world == Regions::now) return ahead;
        return ahead && !guard && world == (least ? Regions::upper : Regions::lower);
    }

    bool ahead;
    bool guard;
    bool endless;
    bool least;
    Time begin;
};

// Writes what a fold that stops is at unseen positions: its own element, or nothing.
inline void write_own(Runs& found, RegionFold fold, Time lo, const RunsView& elements, Time begin) {
    if (lo == 0) {
        found.append(elements.clipped(begin));
    } else {
        found.push(begin, fold.empty());
    }
}

// The fold over offsets lo to hi. Of one operand, the folds from each open position to the last one
// that was seen are stairs. As positions settle with the last one that they read, the first step is
// their value; in a world that reads nothing behind the last position all stairs are what is open.
class Sliding final : public RegionStream {
public:
    Sliding(RegionTrace& trace, const FormulaRow& row, RegionFold fold, RegionStream& a,
            RegionStream& b)
        : RegionStream(trace, std::max<Time>(0, Operands(fold, a, b).late() + *row.hi)),
          operands_(fold, a, b),
          reading_(row, fold),
          lo_(*row.lo),
          hi_(*row.hi),
          none_(trace.corners, fold.identity()) {
        operands_.hold(late(), lo_);
        if (operands_.single() && trace.axes == 0 && !trace.whole) stairs_.emplace(fold);
        for (std::size_t world = 0; world < kWorlds; ++world) {
            const bool stops = reading_.stops(world);
            as_now_[world] =
                !is_cut(world) && (stops || !reading_.ahead) && operands_.as_now(world);
            if (is_cut(world)) continue;
            tail_[world] = stops && lo_ != 0 ? fold.empty() : operands_.tail(world);
            if (stops || hi_ < 0) continue;
            // Every open window reaches what decides it; one that lies before may be empty.
            const auto value = operands_.flat(world);
            if (value && same(*value, -fold.empty())) flat_[world] = value;
        }
    }

    void reset() override {
        RegionStream::reset();
        if (stairs_) stairs_->clear();
        taken_ = -1;
    }
    void restored() override {
        if (!stairs_) return;
        const Time upto = std::min(operands_.last(), last_ + hi_);
        taken_ = std::max<Time>(-1, late_ > 0 ? operands_.last() : upto);
        const Time begin = std::max<Time>(0, last_ + 1 + lo_);
        if (begin > taken_) return;
        const RunsView runs = operands_.only().settled(begin, taken_);
        for (std::size_t i = 0; i < runs.size(); ++i) stairs_->push(runs.start(i), runs.at(i)->q);
    }

protected:
    void proceed(Time t) override {
        if (!stairs_) return;
        risen_ = taken_ + 1;
        const Time upto = std::min(operands_.last(), t - late_ + hi_);
        if (upto <= taken_) return;
        const RunsView runs = operands_.only().settled(taken_ + 1, upto);
        for (std::size_t i = 0; i < runs.size(); ++i) {
            const Time start = runs.start(i);
            const Time end = start - 1 - hi_;
            if (end > last_) {
                settle_runs(last_ + 1, end);
                last_ = end;
            }
            risen_ = std::min(risen_, stairs_->push(start, runs.at(i)->q));
        }
        taken_ = upto;
    }
    void settle_runs(Time begin, Time end) override {
        if (stairs_) {
            stairs_->settle(begin + lo_, end + lo_, lo_, kept_);
        } else {
            const RunsView elements = operands_.settled(begin + lo_, end + hi_, trace_.corners);
            slide(operands_.fold, elements, lo_, hi_, begin, end, trace_.memory, kept_);
        }
    }
    Time first_change(std::size_t world) override {
        return climbs(world) ? std::min(trace_.before + 1, risen_ - lo_) : changed_;
    }
    void write_open(std::size_t world, Time begin, Time t, Runs& found) override {
        if (climbs(world)) {
            if (begin <= t - lo_) stairs_->write(begin + lo_, lo_, found);
            if (t - lo_ < t) found.push(std::max(begin, t - lo_ + 1), operands_.fold.empty());
            const Time later = std::max(begin, t + 1);
            if (lo_ == 0) found.append(operands_.seen(world, later));
            return;
        }
        const RunsView elements = operands_.seen(world, begin + lo_);
        if (reading_.stops(world)) {
            if (begin <= t && begin + hi_ >= t) {  // no window ends before all is unknown
                if (begin + lo_ <= t)
                    fold_suffixes(operands_.fold, elements.clipped(begin + lo_, t), lo_, none_,
                                  trace_.memory, found);
                if (t - lo_ < t) found.push(std::max(begin, t - lo_ + 1), operands_.fold.empty());
            } else if (begin <= t) {
                known_.clear();  // runs of elements, of which the first numbers differ too
                const RunsView seen = elements.clipped(begin + lo_, t);
                for (std::size_t i = 0; i < seen.size(); ++i) known_.add(seen.start(i), seen.at(i));
                known_.add(std::max(t + 1, begin + lo_), operands_.fold.identity());
                slide(operands_.fold, known_.view(), lo_, hi_, begin, t, trace_.memory, found);
            }
            write_own(found, operands_.fold, lo_, elements, std::max(begin, t + 1));
        } else if (reading_.endless && is_cut(world)) {
            const Time recorded = t - reading_.begin;
            if (begin <= recorded)
                slide(operands_.fold, elements, lo_, hi_, begin, recorded, trace_.memory, found);
            Runs memory;
            found.append(seen(world - 2, std::max(begin, recorded + 1), memory));
        } else {
            slide(operands_.fold, elements, lo_, hi_, begin, kEver, trace_.memory, found);
        }
    }

private:
    // Whether the stairs are the open values of a world: up to the last position all has settled.
    bool climbs(std::size_t world) const {
        return stairs_ && reading_.stops(world) && operands_.late() == 0;
    }

    Operands operands_;
    Reading reading_;
    Time lo_;
    Time hi_;
    std::vector<Pair> none_;
    Runs known_;
    std::optional<Stairs> stairs_;
    Time taken_ = -1;  // the last position of the operand in the stairs
    Time risen_ = 0;   // the first one from which on the stairs changed in this update
};

// The fold over all offsets up to hi.
class UnboundedPast final : public RegionStream {
public:
    UnboundedPast(RegionTrace& trace, const FormulaRow& row, RegionFold fold, RegionStream& a,
                  RegionStream& b)
        : RegionStream(trace, std::max<Time>(0, Operands(fold, a, b).late() + *row.hi)),
          operands_(fold, a, b),
          hi_(*row.hi) {
        operands_.hold(late(), hi_);
        for (std::size_t world = 0; world < kWorlds; ++world) {
            const auto value = operands_.tail(world);
            if (value && same(*value, -fold.empty())) tail_[world] = value;
            as_now_[world] = !is_cut(world) && operands_.as_now(world);
        }
        UnboundedPast::reset();
    }

    void substitute(std::size_t axis, const std::vector<double>& value) override {
        RegionStream::substitute(axis, value);
        trace_.substitute(total_, axis, value);
    }
    void reset() override {
        RegionStream::reset();
        total_.assign(trace_.corners, operands_.fold.identity());
    }
    void fields(Snapshot& s) override {
        RegionStream::fields(s);
        s.numbers(total_.data(), total_.size());
    }

protected:
    void settle_runs(Time begin, Time end) override {
        scan(total_, operands_.settled(begin + hi_, end + hi_, trace_.corners), begin, kept_);
    }
    void write_open(std::size_t world, Time begin, Time, Runs& found) override {
        if (trace_.whole) begin = 0;  // total_ has taken nothing, so the scan starts at position 0
        open_total_.assign(1, trace_.pair_in_world(world, total_.data()));
        scan(open_total_, operands_.seen(world, begin + hi_), begin, found);
    }

private:
    void scan(std::vector<Pair>& total, const RunsView& elements, Time begin, Runs& found) const {
        if (elements.start(0) - hi_ > begin) found.push(begin, total.data());
        for (std::size_t i = 0; i < elements.size(); ++i) {
            for (std::size_t c = 0; c < elements.corners; ++c)
                total[c] = operands_.fold.combine(total[c], elements.at(i)[c]);
            found.push(elements.start(i) - hi_, total.data());
        }
    }

    Operands operands_;
    Time hi_;
    std::vector<Pair> total_;
    std::vector<Pair> open_total_;
};

// The fold over all offsets from 0 on, which settles as a polynomial in its unknown.
class RegionFuture final : public RegionStream {
public:
    RegionFuture(RegionTrace& trace, const FormulaRow& row, RegionFold fold, RegionStream& a,
                 RegionStream& b, std::size_t axis)
        : RegionStream(trace, Operands(fold, a, b).late()),
          operands_(fold, a, b),
          reading_(row, fold),
          axis_(axis),
          none_(1, fold.identity()) {
        operands_.hold(late(), 0);
    }

    std::size_t axis() const { return axis_; }
    // Writes the runs that settle with position t, of which keep() keeps them: in terms of the
    // value at the first position that has not settled. Returns false if there are none.
    bool find(Time t) {
        if (t - late_ <= last_) return false;
        rest_.assign(trace_.corners, operands_.fold.identity());
        for (std::size_t c = 0; c < rest_.size(); ++c)
            rest_[c].q = c & trace_.bit(axis_) ? kInfinity : -kInfinity;
        new_.restart(trace_.corners);
        fold_suffixes(operands_.fold, operands_.settled(last_ + 1, t - late_, trace_.corners), 0,
                      rest_, trace_.memory, new_);
        value_.clear();
        for (std::size_t c = 0; c < trace_.corners; ++c) value_.push_back(new_.at(0)[c].q);
        return true;
    }
    // For each corner the value at the first of these positions.
    const std::vector<double>& value() const { return value_; }

protected:
    void settle_runs(Time, Time) override { kept_.append(new_.view()); }
    void write_open(std::size_t world, Time begin, Time t, Runs& found) override {
        const RunsView elements = operands_.seen(world, begin);
        const bool stops = reading_.stops(world);
        if (!stops && !is_cut(world)) t = elements.start(elements.size() - 1);
        double unknown = operands_.fold.empty();  // nothing follows what has settled
        if (begin <= t) {
            fold_suffixes(operands_.fold, elements.clipped(begin, t), 0, none_, trace_.memory,
                          found);
            unknown = found.at(0)->q;
        }
        trace_.unknowns[axis_][world] = unknown;
        if (is_cut(world)) {
            found.append(open(world - 2).view().clipped(std::max(begin, t + 1)));
        } else if (stops) {
            write_own(found, operands_.fold, 0, elements, std::max(begin, t + 1));
        }
    }

private:
    Operands operands_;
    Reading reading_;
    std::size_t axis_;
    std::vector<Pair> none_;
    std::vector<Pair> rest_;
    std::vector<double> value_;
    Runs new_;
};

// Makes the stream of a row; the axis is of its unknown, if it never settles.
inline std::unique_ptr<RegionStream> stream_of(RegionTrace& trace, const FormulaRow& row,
                                               RegionFold fold, RegionStream& a, RegionStream& b,
                                               std::size_t axis) {
    if (row.kind == "MAP") return std::make_unique<Pointwise>(trace, fold, a, b);
    if (!row.hi) return std::make_unique<RegionFuture>(trace, row, fold, a, b, axis);
    if (!row.lo) return std::make_unique<UnboundedPast>(trace, row, fold, a, b);
    return std::make_unique<Sliding>(trace, row, fold, a, b);
}

// The fold over positions lo to hi, which is read at position 0 alone.
class AtBegin {
public:
    AtBegin(RegionTrace& trace, const FormulaRow& row, RegionFold fold, RegionStream& a,
            RegionStream& b)
        : trace_(trace),
          operands_(fold, a, b),
          reading_(row, fold),
          lo_(std::max<Time>(0, row.lo.value_or(0))),
          hi_(row.hi),
          open_(fold) {
        operands_.hold(operands_.late(), 0);
        for (std::size_t world = 0; world < kWorlds; ++world) {
            const auto tail = operands_.tail(world);
            if (operands_.single() && !hi_ && !reading_.stops(world) && !is_cut(world) && tail &&
                same(*tail, -fold.empty()))
                decided_[world] = tail;
        }
        keeps_ = operands_.single() && trace.axes == 0 && reading_.stops(Regions::now);
        reset();
    }

    void substitute(std::size_t axis, const std::vector<double>& value) {
        trace_.substitute(total_, axis, value);
    }
    void settle() {
        Time end = operands_.last();
        const Time begin = std::max(lo_, last_ + 1);
        last_ = std::max(end, last_);
        if (hi_) end = std::min(end, *hi_);
        if (begin > end) return;
        const RunsView elements = operands_.settled(begin, end, trace_.corners);
        for (std::size_t i = 0; i < elements.size(); ++i)
            for (std::size_t c = 0; c < total_.size(); ++c)
                total_[c] = operands_.fold.combine(total_[c], elements.at(i)[c]);
    }
    double value(std::size_t world, Time t) {
        if (is_cut(world) && reading_.endless && reading_.begin > t) return value(world - 2, t);
        if (decided_[world]) return *decided_[world];
        const bool stops = reading_.stops(world);
        Pair total = trace_.pair_in_world(world, total_.data());
        const Time begin = std::max(lo_, last_ + 1);
        Time end = hi_.value_or(kEver);
        if (is_cut(world) && !hi_) {
            end = t;
        } else if (stops) {
            end = std::min(end, lo_ == 0 ? std::max<Time>(t, 0) : t);
        }
        if (begin > end) return total.q;
        if (const auto value = operands_.flat(world))
            return operands_.fold.combine(total, {0.0, *value}).q;
        if (keeps_ && stops && t >= 0 && operands_.as_now(world))
            return operands_.fold.upper(total.q, open_now(begin, end));
        const RunsView elements = operands_.seen(world, begin).clipped(begin, end);
        for (std::size_t i = 0; i < elements.size(); ++i)
            total = operands_.fold.combine(total, *elements.at(i));
        return total.q;
    }

    void reset() {
        last_ = -1;
        total_.assign(trace_.corners, operands_.fold.identity());
    }
    void fields(Snapshot& s) {
        s(last_);
        s.require(last_ == operands_.last());
        s.numbers(total_.data(), total_.size());
    }

private:
    // The fold of what is open as `now` up to the last position that was seen.
    double open_now(Time begin, Time end) {
        if (seen_at_ == trace_.update) return open_.value();
        RegionStream& operand = operands_.only();
        const Runs& runs = operand.open(Regions::now);
        const Time from = seen_at_ + 1 == trace_.update ? operand.changed(Regions::now) : 0;
        seen_at_ = trace_.update;
        if (from <= begin) {
            open_.clear();
        } else {
            open_.cut(from);
            open_.drop(begin);
        }
        const RunsView fresh = runs.view().clipped(std::max(begin, from), end);
        for (std::size_t i = 0; i < fresh.size(); ++i) open_.push(fresh.start(i), fresh.at(i)->q);
        return open_.value();
    }

    RegionTrace& trace_;
    Operands operands_;
    Reading reading_;
    Time lo_;
    std::optional<Time> hi_;
    std::array<std::optional<double>, kWorlds> decided_;
    KeptFold open_;
    bool keeps_ = false;
    std::uint64_t seen_at_ = 0;
    Time last_ = -1;
    std::vector<Pair> total_;
};

}  // namespace rtamt::dense
