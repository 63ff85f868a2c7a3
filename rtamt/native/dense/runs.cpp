#include "dense/runs.hpp"

#include <stdexcept>

namespace rtamt::dense {

RegionFold fold_named(const std::string& name) {
#define RTAMT_NAMED(name_, Fold) \
    if (name == #name_) return {Fold::result(Fold::identity) > 0, Fold::kind};
    RTAMT_FOLDS(RTAMT_NAMED)
#undef RTAMT_NAMED
    throw std::invalid_argument("expected the name of a lattice fold, got " + name);
}

void Runs::push(Time start, const Pair* elements) {
    if (!empty()) {
        const Pair* last = at(size() - 1);
        bool equal = true;
        for (std::size_t c = 0; c < corners; ++c) equal &= same(last[c].q, elements[c].q);
        if (equal) return;
    }
    add(start, elements);
}

void Runs::fields(Snapshot& s) {
    s.sized(starts);
    std::size_t count = values.size();
    s(count);
    if (s.reads()) {
        s.require(count == starts.size() * corners);
        s.require_unread<Pair>(count);
        values.resize(count);
        for (std::size_t i = 1; i < starts.size(); ++i) s.require(starts[i - 1] < starts[i]);
    }
    s.numbers(values.data(), count);
}

Runs clipped(const Runs& runs, Time begin, Time end) {
    Runs found;
    found.corners = runs.corners;
    const auto after = static_cast<std::size_t>(
        std::upper_bound(runs.starts.begin(), runs.starts.end(), end) - runs.starts.begin());
    const std::size_t first = std::min(runs.place(begin), after);
    found.starts.assign(runs.starts.begin() + static_cast<std::ptrdiff_t>(first),
                        runs.starts.begin() + static_cast<std::ptrdiff_t>(after));
    found.values.assign(runs.at(first), runs.at(after));
    if (!found.empty() && found.starts[0] < begin) found.starts[0] = begin;
    return found;
}

Runs joint(const Runs& p, const Runs& q, Time begin) {
    Runs found;
    found.corners = p.corners;
    std::size_t i = p.place(begin), j = q.place(begin);
    Time now = begin;
    for (;;) {
        Pair* out = found.add(now);
        for (std::size_t c = 0; c < p.corners; ++c) out[c] = {p.at(i)[c].q, q.at(j)[c].q};
        const Time x = i + 1 < p.size() ? p.starts[i + 1] : std::numeric_limits<Time>::max();
        const Time y = j + 1 < q.size() ? q.starts[j + 1] : std::numeric_limits<Time>::max();
        now = std::min(x, y);
        if (now == std::numeric_limits<Time>::max()) return found;
        i += x == now;
        j += y == now;
    }
}

Runs paired(RegionFold fold, const Runs& pairs, std::optional<Time> end) {
    if (fold.kind == Kind::single) return pairs;
    Runs found;
    found.corners = pairs.corners;
    std::vector<Pair> together(pairs.corners);
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const Pair* here = pairs.at(i);
        const Time start = pairs.starts[i];
        const bool last = i + 1 == pairs.size();
        const std::optional<Time> stop = last ? end : pairs.starts[i + 1] - 1;
        for (std::size_t c = 0; c < pairs.corners; ++c)
            together[c] = {here[c].p, fold.lower(here[c].p, here[c].q)};
        if (fold.kind == Kind::ahead) {
            if (start % 2 == 0) found.add(start, here);
            if (start % 2 != 0) found.add(start, together.data());
            if (start % 2 == 0 && !(stop && *stop == start)) found.add(start + 1, together.data());
        } else {
            const bool instant = stop && *stop % 2 == 0;
            if (!(instant && *stop == start)) found.add(start, together.data());
            if (instant) found.add(*stop, here);
        }
    }
    return found;
}

Runs slid(RegionFold fold, const Runs& runs, Time lo, Time hi, Time begin, Time end) {
    const std::size_t corners = runs.corners, n = runs.size();
    Runs found;
    found.corners = corners;
    // Positions at which a run enters or leaves, and the runs inside then; -1 is nothing before.
    std::vector<Time> starts;
    std::vector<std::ptrdiff_t> first, last;
    const auto place = [&](Time position) {
        return std::upper_bound(runs.starts.begin(), runs.starts.end(), position) -
               runs.starts.begin() - 1;
    };
    std::ptrdiff_t i = place(begin + lo), j = place(begin + hi);
    constexpr Time kNever = std::numeric_limits<Time>::max();
    const auto count = static_cast<std::ptrdiff_t>(n);
    for (Time now = begin; now <= end;) {
        starts.push_back(now);
        first.push_back(i);
        last.push_back(j);
        const Time leaves = i + 1 < count ? runs.starts[static_cast<std::size_t>(i + 1)] - lo : kNever;
        const Time enters = j + 1 < count ? runs.starts[static_cast<std::size_t>(j + 1)] - hi : kNever;
        now = std::min(leaves, enters);
        if (now == kNever) break;
        i += leaves == now;
        j += enters == now;
    }
    std::vector<double> results(starts.size() * corners);
    std::vector<Pair> older;
    for (std::size_t c = 0; c < corners; ++c) {
        // A queue in two stacks: `older` has suffix folds of runs base to middle.
        const auto element = [&](std::ptrdiff_t run) {
            return run < 0 ? fold.identity() : runs.at(static_cast<std::size_t>(run))[c];
        };
        std::ptrdiff_t next = first[0], middle = first[0], base = first[0];
        Pair younger = fold.identity();
        for (std::size_t k = 0; k < starts.size(); ++k) {
            for (; next <= last[k]; ++next) younger = fold.combine(younger, element(next));
            if (first[k] >= middle) {
                base = first[k];
                middle = next;
                older.resize(static_cast<std::size_t>(middle - base));
                Pair total = fold.identity();
                for (std::ptrdiff_t run = middle; run-- > base;)
                    older[static_cast<std::size_t>(run - base)] = total =
                        fold.combine(element(run), total);
                younger = fold.identity();
            }
            const Pair total =
                fold.combine(older[static_cast<std::size_t>(first[k] - base)], younger);
            results[k * corners + c] = total.q;
        }
    }
    std::vector<Pair> elements(corners);
    for (std::size_t k = 0; k < starts.size(); ++k) {
        for (std::size_t c = 0; c < corners; ++c) elements[c] = {0.0, results[k * corners + c]};
        found.push(starts[k], elements.data());
    }
    return found;
}

Runs suffixes(RegionFold fold, const Runs& runs, Time lo, Time end) {
    const auto after = static_cast<std::size_t>(
        std::upper_bound(runs.starts.begin(), runs.starts.end(), end) - runs.starts.begin());
    Runs found;
    found.starts.resize(after);
    found.values.resize(after);
    std::size_t first = after;  // what is found stands from here on
    Pair total = fold.identity();
    for (std::size_t i = after; i-- > 0;) {
        total = fold.combine(*runs.at(i), total);
        // Equal runs merge: the earlier start is theirs.
        if (first < after && same(found.values[first].q, total.q)) {
            found.starts[first] = runs.starts[i] - lo;
        } else {
            --first;
            found.starts[first] = runs.starts[i] - lo;
            found.values[first] = {0.0, total.q};
        }
    }
    found.starts.erase(found.starts.begin(),
                       found.starts.begin() + static_cast<std::ptrdiff_t>(first));
    found.values.erase(found.values.begin(),
                       found.values.begin() + static_cast<std::ptrdiff_t>(first));
    return found;
}

Runs suffixes(RegionFold fold, Runs runs, const std::vector<Pair>& rest) {
    std::vector<Pair> total = rest;
    for (std::size_t i = runs.size(); i-- > 0;) {
        Pair* here = runs.at(i);
        for (std::size_t c = 0; c < runs.corners; ++c)
            here[c] = total[c] = fold.combine(here[c], total[c]);
    }
    return runs;
}

}  // namespace rtamt::dense
