// Registers that are read at all positions, over the regions of dense time: terms, constants, and
// what compares operands at one position. The definitions are rtamt/machines/dense/regions.py.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "dense/regions.hpp"
#include "dense/runs.hpp"

namespace rtamt::dense {

constexpr Time kEver = std::numeric_limits<Time>::max();
constexpr std::size_t kWorlds = Regions::worlds;

inline bool is_cut(std::size_t world) { return world >= Regions::cut_lower; }

// What all registers of a trace share: the values of the unknowns in each world.
struct RegionTrace {
    std::size_t axes = 0;
    std::size_t corners = 1;
    std::vector<std::array<double, kWorlds>> unknowns;
    Time t = -1;  // the last position that was seen
    mutable std::vector<double> scratch;

    std::size_t bit(std::size_t axis) const { return std::size_t{1} << (axes - 1 - axis); }

    // The number of a polynomial, given at its corners, in a world.
    template <class Get>
    double in_world(std::size_t world, Get corner) const {
        if (axes == 0) return corner(0);
        scratch.resize(corners);
        for (std::size_t c = 0; c < corners; ++c) scratch[c] = corner(c);
        std::size_t half = corners;
        for (std::size_t axis = 0; axis < axes; ++axis) {
            half /= 2;
            for (std::size_t c = 0; c < half; ++c)
                scratch[c] =
                    greater(scratch[c], lesser(scratch[half + c], unknowns[axis][world]));
        }
        return scratch[0];
    }
    Pair in_world(std::size_t world, const Pair* element) const {
        return {in_world(world, [=](std::size_t c) { return element[c].p; }),
                in_world(world, [=](std::size_t c) { return element[c].q; })};
    }
    // Writes an unknown of polynomials as a polynomial in what it is later.
    void substitute(std::vector<Pair>& values, std::size_t axis,
                    const std::vector<double>& value) const {
        const std::size_t mask = bit(axis);
        for (std::size_t at = 0; at < values.size(); at += corners) {
            for (std::size_t c = 0; c < corners; ++c) {
                if (c & mask) continue;
                const Pair low = values[at + c], high = values[at + (c | mask)];
                for (const std::size_t d : {c, c | mask})
                    values[at + d] = {greater(low.p, lesser(high.p, value[d])),
                                      greater(low.q, lesser(high.q, value[d]))};
            }
        }
    }
};

// A register that is read at all positions.
class RegionStream {
public:
    RegionStream(RegionTrace& trace, Time late) : trace_(trace), late_(late) {
        kept_.corners = trace.corners;
    }
    RegionStream(const RegionStream&) = delete;
    RegionStream& operator=(const RegionStream&) = delete;
    virtual ~RegionStream() = default;

    Time late() const { return late_; }
    Time last() const { return last_; }
    void hold(Time positions) { keep_ = std::max(keep_, positions); }

    // Takes in values at new positions, if it is a term.
    virtual void take(const Time*, const double*, std::size_t) {}
    // The unknown of a window without end, which settles with it.
    virtual std::optional<std::size_t> unknown() const { return std::nullopt; }
    // Finds the runs that settle with position t; false if there are none.
    bool settle(Time t) {
        if (t - late_ <= last_) return false;
        new_ = settled_runs(last_ + 1, t - late_);
        return true;
    }
    const Runs& settling() const { return new_; }
    void keep(Time t) {
        kept_.append(new_);
        last_ = t - late_;
    }
    void trim() {
        const std::size_t first = kept_.place(last_ + 1 - keep_);
        if (first == 0) return;
        kept_.starts.erase(kept_.starts.begin(),
                           kept_.starts.begin() + static_cast<std::ptrdiff_t>(first));
        kept_.values.erase(
            kept_.values.begin(),
            kept_.values.begin() + static_cast<std::ptrdiff_t>(first * kept_.corners));
    }
    virtual void substitute(std::size_t axis, const std::vector<double>& value) {
        trace_.substitute(kept_.values, axis, value);
    }
    // Forgets what is open: more has been seen since.
    void forget() { known_.fill(false); }
    // The runs of a world from the first position that has not settled on.
    const Runs& open(std::size_t world) const {
        if (!known_[world]) {
            const auto value = flat(world, last_ + 1);
            open_[world] = value ? constant(*value, last_ + 1)
                                 : open_runs(world, last_ + 1, trace_.t, trace_);
            known_[world] = true;
        }
        return open_[world];
    }
    // The value from some position on in a world in which all is unknown there, if it is plain.
    virtual std::optional<double> tail(std::size_t) const { return std::nullopt; }

    Runs settled(Time begin, Time end) const { return clipped(kept_, begin, end); }
    // The runs of a world from a position on.
    Runs seen(std::size_t world, Time begin) const {
        const Runs& open = this->open(world);
        if (begin > last_) return clipped(open, begin);
        Runs found;
        found.reserve(kept_.size() - kept_.place(begin) + open.size());
        for (std::size_t i = kept_.place(begin); i < kept_.size(); ++i) {
            const Pair value = trace_.in_world(world, kept_.at(i));
            found.push(std::max(begin, kept_.starts[i]), &value);
        }
        found.append(open);
        return found;
    }
    // The value from a position on, if it is plainly one in a world.
    std::optional<double> flat_from(std::size_t world, Time begin) const {
        return begin > last_ ? flat(world, last_ + 1) : std::nullopt;
    }

    virtual void reset() {
        last_ = -1;
        kept_.starts.clear();
        kept_.values.clear();
    }
    virtual void fields(Snapshot& s) {
        s(last_);
        kept_.fields(s);
        if (kept_.empty()) {
            s.require(last_ < 0);
        } else {
            s.require(kept_.starts.front() <= std::max<Time>(0, last_ + 1 - keep_));
            s.require(kept_.starts.front() >= 0 && kept_.starts.back() <= last_);
        }
    }

protected:
    virtual Runs settled_runs(Time begin, Time end) = 0;
    virtual Runs open_runs(std::size_t world, Time begin, Time t, RegionTrace& trace) const = 0;
    // The value of all open positions, if it is found without their runs.
    virtual std::optional<double> flat(std::size_t, Time) const { return std::nullopt; }

    Runs constant(double value, Time start, std::size_t corners = 1) const {
        Runs found;
        found.corners = corners;
        found.add(start, Pair{0.0, value});
        return found;
    }

    RegionTrace& trace_;
    Runs kept_;

private:
    mutable std::array<Runs, kWorlds> open_;
    mutable std::array<bool, kWorlds> known_{};
    Time late_;
    Time keep_ = 1;
    Time last_ = -1;
    Runs new_;
};

// A term read as a formula.
class Predicate final : public RegionStream {
public:
    explicit Predicate(RegionTrace& trace) : RegionStream(trace, 0) {}

    std::optional<double> tail(std::size_t world) const override {
        const bool best = world == Regions::upper || world == Regions::cut_upper;
        return best ? kInfinity : -kInfinity;
    }

    void take(const Time* positions, const double* values, std::size_t n) override {
        next_ = Runs();
        next_.corners = trace_.corners;
        const Time begin = last() + 1;
        if (n == 0 || positions[0] > begin) next_.add(begin, kept_.at(kept_.size() - 1));
        for (std::size_t i = 0; i < n; ++i)
            if (next_.empty() || !same(next_.values.back().q, values[i]))
                next_.add(positions[i], Pair{0.0, values[i]});
    }

protected:
    Runs settled_runs(Time, Time) override { return std::move(next_); }
    Runs open_runs(std::size_t world, Time begin, Time, RegionTrace&) const override {
        return constant(*tail(world), begin);
    }
    std::optional<double> flat(std::size_t world, Time) const override { return tail(world); }

private:
    Runs next_;
};

class Constant final : public RegionStream {
public:
    Constant(RegionTrace& trace, double value) : RegionStream(trace, 0), value_(value) {}

    std::optional<double> tail(std::size_t) const override { return value_; }

protected:
    Runs settled_runs(Time begin, Time) override {
        return constant(value_, begin, trace_.corners);
    }
    Runs open_runs(std::size_t, Time begin, Time, RegionTrace&) const override {
        return constant(value_, begin);
    }
    std::optional<double> flat(std::size_t, Time) const override { return value_; }

private:
    double value_;
};

class Pointwise final : public RegionStream {
public:
    Pointwise(RegionTrace& trace, RegionFold fold, RegionStream& a, RegionStream& b)
        : RegionStream(trace, std::max(a.late(), b.late())), fold_(fold), a_(a), b_(b) {
        for (RegionStream* s : {&a, &b}) s->hold(late() - s->late());
    }

    std::optional<double> tail(std::size_t world) const override {
        const std::optional<double> x = a_.tail(world), y = b_.tail(world);
        for (const auto& each : {x, y})
            if (each && same(*each, -fold_.empty())) return each;
        if (!x || !y) return std::nullopt;
        return fold_.upper(*x, *y);
    }

protected:
    Runs settled_runs(Time begin, Time end) override {
        return across(joint(a_.settled(begin, end), b_.settled(begin, end), begin));
    }
    Runs open_runs(std::size_t world, Time begin, Time, RegionTrace&) const override {
        return across(joint(a_.seen(world, begin), b_.seen(world, begin), begin));
    }
    std::optional<double> flat(std::size_t world, Time begin) const override {
        const auto x = a_.flat_from(world, begin), y = b_.flat_from(world, begin);
        for (const auto& each : {x, y})  // decided by one of them
            if (each && same(*each, -fold_.empty())) return each;
        if (!x || !y) return std::nullopt;
        return fold_.upper(*x, *y);
    }

private:
    Runs across(const Runs& pairs) const {
        Runs found;
        found.corners = pairs.corners;
        found.reserve(pairs.size());
        std::vector<Pair> elements(pairs.corners);
        for (std::size_t i = 0; i < pairs.size(); ++i) {
            for (std::size_t c = 0; c < pairs.corners; ++c)
                elements[c] = {0.0, fold_.upper(pairs.at(i)[c].p, pairs.at(i)[c].q)};
            found.push(pairs.starts[i], elements.data());
        }
        return found;
    }

    RegionFold fold_;
    RegionStream& a_;
    RegionStream& b_;
};

}  // namespace rtamt::dense
