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
    const std::size_t corners = runs.corners, n = runs.size();
    // Positions at which a run enters or leaves, and the runs inside then; -1 is nothing before.
    auto& [starts, first, last, older, total, results] = memory;
    starts.clear();
    first.clear();
    last.clear();
    const auto place = [&](Time position) {
        const auto run = static_cast<std::ptrdiff_t>(runs.place(position));
        return n > 0 && runs.start(0) <= position ? run : -1;
    };
    std::ptrdiff_t i = place(begin + lo), j = place(begin + hi);
    const auto count = static_cast<std::ptrdiff_t>(n);
    for (Time now = begin; now <= end;) {
        starts.push_back(now);
        first.push_back(i);
        last.push_back(j);
        const Time leaves = i + 1 < count ? runs.start(static_cast<std::size_t>(i + 1)) - lo : kEver;
        const Time enters = j + 1 < count ? runs.start(static_cast<std::size_t>(j + 1)) - hi : kEver;
        now = std::min(leaves, enters);
        if (now == kEver) break;
        i += leaves == now;
        j += enters == now;
    }
    if (starts.empty()) return;
    results.resize(starts.size() * corners);
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
                Pair all = fold.identity();
                for (std::ptrdiff_t run = middle; run-- > base;)
                    older[static_cast<std::size_t>(run - base)] = all =
                        fold.combine(element(run), all);
                younger = fold.identity();
            }
            results[k * corners + c] =
                fold.combine(older[static_cast<std::size_t>(first[k] - base)], younger).q;
        }
    }
    total.resize(corners);
    for (std::size_t k = 0; k < starts.size(); ++k) {
        for (std::size_t c = 0; c < corners; ++c) total[c] = {0.0, results[k * corners + c]};
        found.push(starts[k], total.data());
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
            older[i * corners + c] = memory.total[c] =
                fold.combine(runs.at(i)[c], memory.total[c]);
    for (std::size_t i = 0; i < n; ++i) found.push(runs.start(i) - lo, older.data() + i * corners);
}

}  // namespace rtamt::dense
