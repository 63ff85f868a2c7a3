// Registers that are read at all positions, over the regions of dense time: leaves, and what
// compares operands at one position. The definitions are rtamt/machines/dense/regions.py.
//
// What is open is kept between updates, for each world that is read. Every stream says from which
// position on a world differs from what it was in the last update, and its readers write only that
// anew. It is no part of a state: after one is restored, all is found again.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "dense/regions.hpp"
#include "dense/runs.hpp"

namespace rtamt::dense {

constexpr std::size_t kWorlds = Regions::worlds;

inline bool is_cut(std::size_t world) { return world >= Regions::cut_lower; }

// What all registers of a trace share: the values of the unknowns in each world.
struct RegionTrace {
    std::size_t axes = 0;
    std::size_t corners = 1;
    std::vector<std::array<double, kWorlds>> unknowns;
    Time t = -1;               // the last position that was seen
    Time before = -1;          // and the one before this update
    std::uint64_t update = 2;  // what was found in the update before may be kept
    bool whole = false;        // all is open from position 0 on, as nothing settles
    FoldMemory memory;
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
                scratch[c] = greater(scratch[c], lesser(scratch[half + c], unknowns[axis][world]));
        }
        return scratch[0];
    }
    Pair pair_in_world(std::size_t world, const Pair* element) const {
        return {in_world(world, [=](std::size_t c) { return element[c].p; }),
                in_world(world, [=](std::size_t c) { return element[c].q; })};
    }
    // Writes an unknown of polynomials as a polynomial in what it is later.
    void substitute(std::span<Pair> values, std::size_t axis,
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

using Constants = std::array<std::optional<double>, kWorlds>;

// A register that is read at all positions.
class RegionStream {
public:
    RegionStream(RegionTrace& trace, Time late)
        : trace_(trace), late_(late), kept_(trace.corners) {}
    RegionStream(const RegionStream&) = delete;
    RegionStream& operator=(const RegionStream&) = delete;
    virtual ~RegionStream() = default;

    Time late() const { return late_; }
    Time last() const { return last_; }
    void hold(Time positions) { keep_ = std::max(keep_, positions); }

    // The value from some position on in a world in which all is unknown there, if it is plain.
    std::optional<double> tail(std::size_t world) const { return tail_[world]; }
    // The value of all open positions, if it is one.
    std::optional<double> flat(std::size_t world) const { return flat_[world]; }
    // Whether a world is as `now` up to the last position that was seen.
    bool as_now(std::size_t world) const { return as_now_[world]; }

    // Takes in that all positions up to t have been seen, after the operands have.
    void settle(Time t) {
        changed_ = last_ + 1;
        proceed(t);
        if (t - late_ <= last_) return;
        settle_runs(last_ + 1, t - late_);
        last_ = t - late_;
    }
    void trim() {
        const std::size_t first = kept_.view().place(last_ + 1 - keep_);
        if (first > 0) kept_.drop(first);
    }
    virtual void substitute(std::size_t axis, const std::vector<double>& value) {
        trace_.substitute(kept_.elements(), axis, value);
    }

    // The runs of a world from the first position that has not settled on.
    const Runs& open(std::size_t world) {
        if (seen_at_[world] != trace_.update) refresh(world);
        return open_[world];
    }
    // The first position at which a world differs from what it was in the last update. Called after
    // open().
    Time changed(std::size_t world) const { return changed_in_[world]; }

    RunsView settled(Time begin, Time end) const { return kept_.view().clipped(begin, end); }
    // The runs of a world from a position on, in memory of the caller if they are not together.
    RunsView seen(std::size_t world, Time begin, Runs& memory) {
        const Runs& open = this->open(world);
        const Time from = differs_[world];
        if (begin > last_ && begin >= from) return open.view().clipped(begin);
        if (begin > last_) {
            const Runs& now = this->open(Regions::now);
            memory.clear();
            memory.append(now.view().clipped(begin, from - 1));
            memory.append(open.view().clipped(from));
            return memory.view();
        }
        memory.clear();
        const RunsView kept = kept_.view().clipped(begin);
        for (std::size_t i = 0; i < kept.size(); ++i) {
            const Pair value = trace_.pair_in_world(world, kept.at(i));
            memory.push(kept.start(i), &value);
        }
        memory.append(open.view());
        return memory.view();
    }

    // The state from which open runs differ from `now`; only these runs are written.
    void differ(std::size_t world, Time from) { differs_[world] = from; }
    Time differs(std::size_t world) const { return differs_[world]; }

    virtual void reset() {
        last_ = -1;
        kept_.clear();
    }
    virtual void fields(Snapshot& s) {
        s(last_);
        kept_.fields(s);
        if (kept_.empty()) {
            s.require(last_ < 0);
        } else {
            s.require(kept_.start(0) <= std::max<Time>(0, last_ + 1 - keep_));
            s.require(kept_.start(0) >= 0 && kept_.last_start() <= last_);
        }
    }
    // Finds again what is no part of a state, when it and the operands are as they were.
    virtual void restored() {}

protected:
    // Takes in new runs of operands before what settles by them.
    virtual void proceed(Time) {}
    // Writes the runs of positions that settle.
    virtual void settle_runs(Time begin, Time end) = 0;
    // The first position at which open runs change in this update.
    virtual Time first_change(std::size_t) { return changed_; }
    // Writes the open runs of a world from a position on.
    virtual void write_open(std::size_t world, Time begin, Time t, Runs& found) = 0;

    RegionTrace& trace_;
    Time late_;
    Time last_ = -1;
    Time changed_ = 0;  // what was open before this update
    Runs kept_;
    Constants tail_;
    Constants flat_;
    std::array<bool, kWorlds> as_now_{};

private:
    void refresh(std::size_t world) {
        // Values of unknowns change at every update.
        const bool kept = seen_at_[world] + 1 == trace_.update && trace_.axes == 0;
        seen_at_[world] = trace_.update;
        Runs& runs = open_[world];
        const Time begin = last_ + 1;
        if (flat_[world] && !trace_.whole) {
            runs.clear();
            runs.add(begin, Pair{0.0, *flat_[world]});
            changed_in_[world] = kept ? changed_ : 0;
            return;
        }
        const Time from = kept ? first_change(world) : 0;
        if (from <= begin) {
            runs.clear();
        } else {
            runs.cut(from);
            runs.drop(runs.view().place(begin));
        }
        write_open(world, std::max({from, begin, differs_[world]}), trace_.t, runs);
        changed_in_[world] = from;
    }

    std::array<Runs, kWorlds> open_;
    std::array<std::uint64_t, kWorlds> seen_at_{};
    std::array<Time, kWorlds> changed_in_{};
    std::array<Time, kWorlds> differs_{};
    Time keep_ = 1;
};

// What is known where its terms are: a term read as a formula, a constant, or what compares such
// registers at one position.
class Leaf final : public RegionStream {
public:
    Leaf(RegionTrace& trace, const std::array<double, kWorlds>& unseen) : RegionStream(trace, 0) {
        for (std::size_t world = 0; world < kWorlds; ++world) tail_[world] = unseen[world];
        flat_ = tail_;
        as_now_.fill(true);
    }

    // Takes in values at new positions; all positions up to t have been seen.
    void take(const Time* positions, const double* values, std::size_t n, Time t) {
        changed_ = last_ + 1;
        for (std::size_t i = 0; i < n; ++i) kept_.push(positions[i], values[i]);
        last_ = t;
    }

protected:
    void settle_runs(Time, Time) override {}
    void write_open(std::size_t, Time, Time, Runs&) override {}
};

class Pointwise final : public RegionStream {
public:
    Pointwise(RegionTrace& trace, RegionFold fold, RegionStream& a, RegionStream& b)
        : RegionStream(trace, std::max(a.late(), b.late())), fold_(fold), a_(a), b_(b) {
        for (RegionStream* s : {&a, &b}) s->hold(late() - s->late());
        for (std::size_t world = 0; world < kWorlds; ++world) {
            // Of a faster operand some values are known where the other one is open.
            const auto flat = [&](const RegionStream& s) {
                return s.late() == late() ? s.flat(world) : std::nullopt;
            };
            tail_[world] = of(a.tail(world), b.tail(world));
            flat_[world] = of(flat(a), flat(b));
            as_now_[world] = a.as_now(world) && b.as_now(world);
        }
    }

protected:
    void settle_runs(Time begin, Time end) override {
        across(a_.settled(begin, end), b_.settled(begin, end), begin, kept_);
    }
    Time first_change(std::size_t world) override {
        a_.open(world);
        b_.open(world);
        return std::min(a_.changed(world), b_.changed(world));
    }
    void write_open(std::size_t world, Time begin, Time, Runs& found) override {
        across(a_.seen(world, begin, memory_[0]), b_.seen(world, begin, memory_[1]), begin, found);
    }

private:
    // The value of two that are one each, or of one that decides.
    std::optional<double> of(std::optional<double> x, std::optional<double> y) const {
        for (const auto& each : {x, y})
            if (each && same(*each, -fold_.empty())) return each;
        if (!x || !y) return std::nullopt;
        return fold_.upper(*x, *y);
    }
    void across(const RunsView& a, const RunsView& b, Time begin, Runs& found) {
        elements_.resize(a.corners);
        std::size_t i = a.place(begin), j = b.place(begin);
        for (Time now = begin; now != kEver;) {
            for (std::size_t c = 0; c < a.corners; ++c)
                elements_[c] = {0.0, fold_.upper(a.at(i)[c].q, b.at(j)[c].q)};
            found.push(now, elements_.data());
            const Time x = i + 1 < a.size() ? a.starts[i + 1] : kEver;
            const Time y = j + 1 < b.size() ? b.starts[j + 1] : kEver;
            now = std::min(x, y);
            i += x == now;
            j += y == now;
        }
    }

    RegionFold fold_;
    RegionStream& a_;
    RegionStream& b_;
    std::array<Runs, 2> memory_;
    std::vector<Pair> elements_;
};

}  // namespace rtamt::dense
