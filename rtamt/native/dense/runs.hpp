// Signals over the regions of dense time as runs of equal values, and their folds. The definition is
// rtamt/machines/dense/runs.py.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
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
        switch (kind) {
            case Kind::ahead: return {lower(x.p, y.p), upper(x.q, lower(x.p, y.q))};
            case Kind::back: return {lower(x.p, y.p), upper(y.q, lower(y.p, x.q))};
            case Kind::single: break;
        }
        return {0.0, upper(x.q, y.q)};
    }
    double empty() const { return least ? kInfinity : -kInfinity; }
    Pair identity() const { return {kind == Kind::single ? 0.0 : -empty(), empty()}; }
};

// Throws std::invalid_argument if there is no such fold.
RegionFold fold_named(const std::string& name);

// Runs of elements: a run lasts from its start to the next one. With one operand the first numbers
// of pairs play no part. Every run has an element for each corner.
struct Runs {
    std::vector<Time> starts;
    std::vector<Pair> values;
    std::size_t corners = 1;

    std::size_t size() const { return starts.size(); }
    bool empty() const { return starts.empty(); }
    const Pair* at(std::size_t run) const { return values.data() + run * corners; }
    Pair* at(std::size_t run) { return values.data() + run * corners; }
    // The run in which a position lies; the first one, if it begins later.
    std::size_t place(Time position) const {
        const auto after = std::upper_bound(starts.begin(), starts.end(), position);
        return after == starts.begin() ? 0 : static_cast<std::size_t>(after - starts.begin()) - 1;
    }
    void reserve(std::size_t runs) {
        starts.reserve(runs);
        values.reserve(runs * corners);
    }
    Pair* add(Time start) {
        starts.push_back(start);
        values.resize(values.size() + corners);
        return at(size() - 1);
    }
    void add(Time start, const Pair* elements) {
        starts.push_back(start);
        values.insert(values.end(), elements, elements + corners);
    }
    void add(Time start, Pair element) {
        starts.push_back(start);
        values.insert(values.end(), corners, element);
    }
    // The run of a signal; equal ones merge.
    void push(Time start, const Pair* elements);
    void append(const Runs& other) {
        for (std::size_t i = 0; i < other.size(); ++i) push(other.starts[i], other.at(i));
    }
    void fields(Snapshot& s);
};

// The runs from a position on, which lies inside or before them, up to an end.
Runs clipped(const Runs& runs, Time begin, Time end = std::numeric_limits<Time>::max());

// Two signals as one of pairs, from a position on.
Runs joint(const Runs& p, const Runs& q, Time begin);

// The elements of a fold of two operands: see `paired` in rtamt/machines/dense/runs.py. The last
// run ends at `end`, if there is one.
Runs paired(RegionFold fold, const Runs& pairs, std::optional<Time> end);

// The fold over offsets lo to hi of every position from begin to end.
Runs slid(RegionFold fold, const Runs& runs, Time lo, Time hi, Time begin,
          Time end = std::numeric_limits<Time>::max());

// The fold from each position plus an offset up to an end, of a signal that begins there or before.
Runs suffixes(RegionFold fold, const Runs& runs, Time lo, Time end);

// For each run the fold of all from it on; `rest` has an element for each corner, which comes last.
Runs suffixes(RegionFold fold, Runs runs, const std::vector<Pair>& rest);

}  // namespace rtamt::dense
