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

void Runs::fields(Snapshot& s) {
    std::size_t runs = size();
    s(runs);
    if (s.reads()) {
        s.require_unread<Time>(runs);
        clear();
        starts_.resize(runs);
    }
    s.array(starts_.data() + first_, runs);
    if (s.reads()) {
        for (std::size_t i = 1; i < runs; ++i) s.require(starts_[i - 1] < starts_[i]);
        s.require_unread<Pair>(runs * corners_);
        values_.resize(runs * corners_);
    }
    s.numbers(at(0), runs * corners_);
}

RunsView RunsView::clipped(Time from, Time end) const {
    std::size_t after = count;
    if (count > 0 && starts[count - 1] > end)
        after = static_cast<std::size_t>(std::upper_bound(starts, starts + count, end) - starts);
    const std::size_t first = std::min(place(from), after);
    return {starts + first, at(first), after - first, corners,
            first == after ? from : std::max(from, start(first))};
}

void join(const RunsView& p, const RunsView& q, Time begin, Runs& found) {
    std::size_t i = p.place(begin), j = q.place(begin);
    Time now = begin;
    for (;;) {
        Pair* out = found.add(now);
        for (std::size_t c = 0; c < p.corners; ++c) out[c] = {p.at(i)[c].q, q.at(j)[c].q};
        const Time x = i + 1 < p.size() ? p.starts[i + 1] : kEver;
        const Time y = j + 1 < q.size() ? q.starts[j + 1] : kEver;
        now = std::min(x, y);
        if (now == kEver) return;
        i += x == now;
        j += y == now;
    }
}

void pair_up(RegionFold fold, const RunsView& pairs, std::optional<Time> end, Runs& found) {
    const auto together = [&](Time start, const Pair* here) {
        Pair* out = found.add(start);
        for (std::size_t c = 0; c < pairs.corners; ++c)
            out[c] = {here[c].p, fold.lower(here[c].p, here[c].q)};
    };
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const Pair* here = pairs.at(i);
        const Time start = pairs.start(i);
        const bool last = i + 1 == pairs.size();
        const std::optional<Time> stop = last ? end : pairs.starts[i + 1] - 1;
        if (fold.kind == Kind::ahead) {
            if (start % 2 != 0) {
                together(start, here);
            } else {
                found.add(start, here);
                if (!(stop && *stop == start)) together(start + 1, here);
            }
        } else {
            const bool instant = stop && *stop % 2 == 0;
            if (!(instant && *stop == start)) together(start, here);
            if (instant) found.add(*stop, here);
        }
    }
}

void slide(RegionFold fold, const RunsView& runs, Time lo, Time hi, Time begin, Time end,
           FoldMemory& memory, Runs& found) {
    const std::size_t corners = runs.corners;
    const auto count = static_cast<std::ptrdiff_t>(runs.size());
    const auto place = [&](Time position) {  // -1: before the first run is nothing
        const auto run = static_cast<std::ptrdiff_t>(runs.place(position));
        return count > 0 && runs.start(0) <= position ? run : -1;
    };
    const auto element = [&](std::ptrdiff_t run, std::size_t c) {
        return run < 0 ? fold.identity() : runs.at(static_cast<std::size_t>(run))[c];
    };
    const auto start = [&](std::ptrdiff_t run, Time offset) {
        return run < count ? runs.start(static_cast<std::size_t>(run)) - offset : kEver;
    };
    // A queue in two stacks: `older` has the suffix folds of the runs base to middle, and `younger`
    // the fold of the runs behind them. A window has the runs first to last.
    auto& [older, younger, total] = memory;
    younger.assign(corners, fold.identity());
    std::ptrdiff_t first = place(begin + lo), last = place(begin + hi);
    std::ptrdiff_t next = first, middle = first, base = first;
    for (Time now = begin; now <= end;) {
        for (; next <= last; ++next)
            for (std::size_t c = 0; c < corners; ++c)
                younger[c] = fold.combine(younger[c], element(next, c));
        if (first >= middle) {
            base = first;
            middle = next;
            older.resize(static_cast<std::size_t>(middle - base) * corners);
            total.assign(corners, fold.identity());
            for (std::ptrdiff_t run = middle; run-- > base;)
                for (std::size_t c = 0; c < corners; ++c)
                    older[static_cast<std::size_t>(run - base) * corners + c] = total[c] =
                        fold.combine(element(run, c), total[c]);
            younger.assign(corners, fold.identity());
        }
        const Pair* suffixes = older.data() + static_cast<std::size_t>(first - base) * corners;
        total.resize(corners);
        for (std::size_t c = 0; c < corners; ++c)
            total[c] = {0.0, fold.combine(suffixes[c], younger[c]).q};
        found.push(now, total.data());
        // The next position at which a run enters or leaves.
        const Time leaves = start(first + 1, lo), enters = start(last + 1, hi);
        now = std::min(leaves, enters);
        if (now == kEver) return;
        first += leaves == now;
        last += enters == now;
    }
}

void fold_suffixes(RegionFold fold, const RunsView& runs, Time lo, const std::vector<Pair>& rest,
                   FoldMemory& memory, Runs& found) {
    const std::size_t corners = runs.corners, n = runs.size();
    std::vector<Pair>& older = memory.older;
    older.resize(n * corners);
    memory.total = rest;
    for (std::size_t i = n; i-- > 0;)
        for (std::size_t c = 0; c < corners; ++c)
            older[i * corners + c] = memory.total[c] = fold.combine(runs.at(i)[c], memory.total[c]);
    for (std::size_t i = 0; i < n; ++i) found.push(runs.start(i) - lo, older.data() + i * corners);
}

}  // namespace rtamt::dense
