// The windows over the regions of dense time: those that are read at all positions, and those that
// are read at position 0 alone. The definitions are rtamt/machines/dense/regions.py.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "dense/region_streams.hpp"

namespace rtamt::dense {

// The operands of a window, read as elements of its fold.
class Operands {
public:
    Operands(RegionFold fold, RegionStream& a, RegionStream& b) : fold(fold), a_(a), b_(b) {}

    Time late() const { return single() ? b_.late() : std::max(a_.late(), b_.late()); }
    Time last() const { return single() ? b_.last() : std::min(a_.last(), b_.last()); }
    void hold(Time late, Time oldest) {
        for (RegionStream* s : {&a_, &b_}) s->hold(late - s->late() - oldest);
    }
    Runs settled(Time begin, Time end, std::size_t corners) const {
        const Time first = std::max<Time>(0, begin);
        if (first > end) {
            Runs none;
            none.corners = corners;
            none.add(begin, fold.identity());
            return none;
        }
        if (single()) return b_.settled(first, end);
        return paired(fold, joint(a_.settled(first, end), b_.settled(first, end), first), end);
    }
    Runs seen(std::size_t world, Time begin) const {
        const Time first = std::max<Time>(0, begin);
        if (single()) return b_.seen(world, first);
        return paired(fold, joint(a_.seen(world, first), b_.seen(world, first), first), {});
    }

    // Of one operand the value from some position on, as RegionStream::tail.
    std::optional<double> tail(std::size_t world) const {
        return single() ? b_.tail(world) : std::nullopt;
    }
    // Of one operand the value from a position on, as RegionStream::flat_from.
    std::optional<double> flat_from(std::size_t world, Time begin) const {
        return single() ? b_.flat_from(world, begin) : std::nullopt;
    }

    const RegionFold fold;

private:
    bool single() const { return fold.kind == Kind::single; }

    RegionStream& a_;
    RegionStream& b_;
};

// How a window reads the end of a trace.
struct Reading {
    explicit Reading(const RegionRow& row, RegionFold fold)
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

// What a fold that stops is at unseen positions: its own element, or nothing.
inline void append_own(Runs& found, RegionFold fold, Time lo, const Runs& elements, Time begin) {
    if (lo == 0) {
        found.append(clipped(elements, begin));
    } else {
        const Pair none{0.0, fold.empty()};
        found.push(begin, &none);
    }
}

class Sliding final : public RegionStream {
public:
    Sliding(RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
            RegionStream& b)
        : RegionStream(trace, std::max<Time>(0, Operands(fold, a, b).late() + *row.hi)),
          operands_(fold, a, b),
          reading_(row, fold),
          lo_(*row.lo),
          hi_(*row.hi) {
        operands_.hold(late(), lo_);
    }

    std::optional<double> tail(std::size_t world) const override {
        if (is_cut(world)) return std::nullopt;
        if (reading_.stops(world) && lo_ != 0) return operands_.fold.empty();
        return operands_.tail(world);
    }

protected:
    Runs settled_runs(Time begin, Time end) override {
        const Runs elements = operands_.settled(begin + lo_, end + hi_, trace_.corners);
        return slid(operands_.fold, elements, lo_, hi_, begin, end);
    }
    Runs open_runs(std::size_t world, Time begin, Time t, RegionTrace&) const override {
        const bool stops = reading_.stops(world);
        const Runs elements = operands_.seen(world, begin + lo_);
        if (stops) {
            Runs found;
            if (begin <= t && begin + hi_ >= t) {  // no window ends before all is unknown
                if (begin + lo_ <= t) found = suffixes(operands_.fold, elements, lo_, t);
                const Pair none{0.0, operands_.fold.empty()};
                if (t - lo_ < t) found.push(std::max(begin, t - lo_ + 1), &none);
            } else if (begin <= t) {
                Runs known = clipped(elements, begin + lo_, t);
                known.add(std::max(t + 1, begin + lo_), operands_.fold.identity());
                found = slid(operands_.fold, known, lo_, hi_, begin, t);
            }
            append_own(found, operands_.fold, lo_, elements, std::max(begin, t + 1));
            return found;
        }
        if (reading_.endless && is_cut(world)) {
            const Time recorded = t - reading_.begin;
            Runs found;
            if (begin <= recorded)
                found = slid(operands_.fold, elements, lo_, hi_, begin, recorded);
            found.append(clipped(open(world - 2), std::max(begin, recorded + 1)));
            return found;
        }
        return slid(operands_.fold, elements, lo_, hi_, begin);
    }
    std::optional<double> flat(std::size_t world, Time begin) const override {
        if (reading_.stops(world) || is_cut(world)) return std::nullopt;
        const auto value = operands_.flat_from(world, begin + hi_);
        // Every window reaches what decides it.
        return value && same(*value, -operands_.fold.empty()) ? value : std::nullopt;
    }

private:
    Operands operands_;
    Reading reading_;
    Time lo_;
    Time hi_;
};

// The fold over all offsets up to hi.
class UnboundedPast final : public RegionStream {
public:
    UnboundedPast(RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
                  RegionStream& b)
        : RegionStream(trace, std::max<Time>(0, Operands(fold, a, b).late() + *row.hi)),
          operands_(fold, a, b),
          hi_(*row.hi) {
        operands_.hold(late(), hi_);
        UnboundedPast::reset();
    }

    std::optional<double> tail(std::size_t world) const override {
        const auto value = operands_.tail(world);
        return value && same(*value, -operands_.fold.empty()) ? value : std::nullopt;
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
    Runs settled_runs(Time begin, Time end) override {
        return scanned(total_, operands_.settled(begin + hi_, end + hi_, trace_.corners), begin);
    }
    Runs open_runs(std::size_t world, Time begin, Time, RegionTrace&) const override {
        std::vector<Pair> total{trace_.in_world(world, total_.data())};
        return scanned(total, operands_.seen(world, begin + hi_), begin);
    }

private:
    Runs scanned(std::vector<Pair>& total, const Runs& elements, Time begin) const {
        Runs found;
        found.corners = elements.corners;
        if (elements.starts[0] - hi_ > begin) found.push(begin, total.data());
        for (std::size_t i = 0; i < elements.size(); ++i) {
            for (std::size_t c = 0; c < elements.corners; ++c)
                total[c] = operands_.fold.combine(total[c], elements.at(i)[c]);
            found.push(elements.starts[i] - hi_, total.data());
        }
        return found;
    }

    Operands operands_;
    Time hi_;
    std::vector<Pair> total_;
};

// The fold over all offsets from 0 on, which settles as a polynomial in its unknown.
class RegionFuture final : public RegionStream {
public:
    RegionFuture(RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
                 RegionStream& b, std::size_t axis)
        : RegionStream(trace, Operands(fold, a, b).late()),
          operands_(fold, a, b),
          reading_(row, fold),
          axis_(axis) {
        operands_.hold(late(), 0);
    }

    std::optional<std::size_t> unknown() const override { return axis_; }

protected:
    Runs settled_runs(Time begin, Time end) override {
        std::vector<Pair> rest(trace_.corners, operands_.fold.identity());
        for (std::size_t c = 0; c < rest.size(); ++c)
            rest[c].q = c & trace_.bit(axis_) ? kInfinity : -kInfinity;
        return merged(suffixes(operands_.fold,
                               operands_.settled(begin, end, trace_.corners), rest));
    }
    Runs open_runs(std::size_t world, Time begin, Time t, RegionTrace& trace) const override {
        const Runs elements = operands_.seen(world, begin);
        const bool stops = reading_.stops(world);
        if (!stops && !is_cut(world)) t = elements.starts.back();
        Runs found;
        double unknown = operands_.fold.empty();  // nothing follows what has settled
        if (begin <= t) {
            found = merged(suffixes(operands_.fold, clipped(elements, begin, t),
                                    {operands_.fold.identity()}));
            unknown = found.at(0)->q;
        }
        trace.unknowns[axis_][world] = unknown;
        if (is_cut(world)) {
            found.append(clipped(open(world - 2), std::max(begin, t + 1)));
        } else if (stops) {
            append_own(found, operands_.fold, 0, elements, std::max(begin, t + 1));
        }
        return found;
    }

private:
    static Runs merged(const Runs& runs) {
        Runs found;
        found.corners = runs.corners;
        found.append(runs);
        return found;
    }

    Operands operands_;
    Reading reading_;
    std::size_t axis_;
};

// The fold over positions lo to hi, which is read at position 0 alone.
class AtBegin {
public:
    AtBegin(RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
            RegionStream& b)
        : trace_(trace),
          operands_(fold, a, b),
          reading_(row, fold),
          lo_(std::max<Time>(0, row.lo.value_or(0))),
          hi_(row.hi) {
        operands_.hold(operands_.late(), 0);
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
        const Runs elements = operands_.settled(begin, end, trace_.corners);
        for (std::size_t i = 0; i < elements.size(); ++i)
            for (std::size_t c = 0; c < total_.size(); ++c)
                total_[c] = operands_.fold.combine(total_[c], elements.at(i)[c]);
    }
    double value(std::size_t world, Time t) const {
        if (is_cut(world) && reading_.endless && reading_.begin > t) return value(world - 2, t);
        const bool stops = reading_.stops(world);
        if (!hi_ && !stops && !is_cut(world)) {
            const auto tail = operands_.tail(world);
            if (tail && same(*tail, -operands_.fold.empty())) return *tail;
        }
        Pair total = trace_.in_world(world, total_.data());
        const Time begin = std::max(lo_, last_ + 1);
        Time end = hi_.value_or(kEver);
        if (is_cut(world) && !hi_) {
            end = t;
        } else if (stops) {
            end = std::min(end, lo_ == 0 ? std::max<Time>(t, 0) : t);
        }
        if (begin > end) return total.q;
        if (const auto value = operands_.flat_from(world, begin))
            return operands_.fold.combine(total, {0.0, *value}).q;
        const Runs elements = clipped(operands_.seen(world, begin), begin, end);
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
    RegionTrace& trace_;
    Operands operands_;
    Reading reading_;
    Time lo_;
    std::optional<Time> hi_;
    Time last_ = -1;
    std::vector<Pair> total_;
};

}  // namespace rtamt::dense
