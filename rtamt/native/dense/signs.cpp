#include "dense/signs.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/columns.hpp"
#include "dense/region_windows.hpp"

namespace rtamt::dense {

Signs::Signs(const std::vector<DenseRow>& terms, std::size_t variables,
             const std::vector<FormulaRow>& rows, std::size_t result, End end, bool numbers)
    : variables_(variables),
      loads_(terms.size()),
      constants_(terms.size()),
      rows_(rows),
      result_(result),
      end_(end),
      numbers_(numbers),
      found_(terms.size() + rows.size()),
      settled_(found_.size()) {
    require(result < found_.size());
    for (std::size_t i = 0; i < terms.size(); ++i) {
        const DenseRow& row = terms[i];
        require(is_term(row, i, variables));
        if (row.kind == "LOAD") {
            loads_[i] = row.a;
        } else if (row.kind == "CONST") {
            constants_[i] = row.value;
        } else {
            operations_.push_back({function_named(row.name), i, row.a, row.b});
        }
    }
    std::vector<bool> operand(found_.size());
    operand[result] = true;
    require_rows(rows, terms.size());
    for (const FormulaRow& row : rows) {
        require(row.hi || row.lo == std::optional<Time>(0) || row.kind == "MAP");
        folds_.push_back(fold_named(row.name));
        operand[row.a] = operand[row.b] = true;
        ahead_ |= row.kind == "WINDOW" && (!row.hi || *row.hi > 0);
    }
    for (std::size_t reg = 0; reg < terms.size(); ++reg)
        if (operand[reg] && !constants_[reg]) read_.push_back(reg);
    seen_.resize(read_.size());
}

bool Signs::read(const Events* events, Time begin, Time last) {
    t_ = 2 * (last - begin);
    for (std::size_t world = 0; world < Regions::worlds; ++world) settle(world);
    std::vector<std::size_t> at(variables_);
    for (std::size_t v = 0; v < variables_; ++v) {
        const Events& e = events[v];
        const auto after = std::upper_bound(e.times, e.times + e.size, begin) - e.times;
        if (after == 0) throw std::invalid_argument("expected an event at the begin of the trace");
        at[v] = static_cast<std::size_t>(after) - 1;
    }
    const std::size_t terms = loads_.size();
    std::vector<double> memory((variables_ + terms) * kBlock);
    std::vector<const double*> sources(terms);
    for (std::size_t i = 0; i < terms; ++i) {
        double* own = memory.data() + (variables_ + i) * kBlock;
        if (constants_[i]) std::fill_n(own, kBlock, *constants_[i]);
        sources[i] = loads_[i] ? memory.data() + *loads_[i] * kBlock : own;
    }
    std::vector<Time> steps(variables_ == 1 ? 0 : kBlock);
    for (Time now = begin; now <= last;) {
        std::size_t n = 0;
        const Time* times = steps.data();
        if (variables_ == 1) {  // its events are the steps
            const Events& e = events[0];
            times = e.times + at[0];
            for (std::size_t i = 0; i < terms; ++i)
                if (loads_[i]) sources[i] = e.values + at[0];
            const std::size_t most = std::min(e.size - at[0], kBlock);
            n = static_cast<std::size_t>(std::upper_bound(times, times + most, last) - times);
            at[0] += n;
            now = at[0] < e.size ? e.times[at[0]] : kAfter;
        }
        for (; variables_ != 1 && n < kBlock && now <= last; ++n) {
            steps[n] = now;
            Time next = kAfter;
            for (std::size_t v = 0; v < variables_; ++v) {
                const Events& e = events[v];
                memory[v * kBlock + n] = e.values[at[v]];
                if (at[v] + 1 < e.size) next = std::min(next, e.times[at[v] + 1]);
            }
            for (std::size_t v = 0; v < variables_; ++v)
                at[v] += at[v] + 1 < events[v].size && events[v].times[at[v] + 1] == next;
            now = next;
        }
        for (const Operation& op : operations_) {
            double* out = memory.data() + (variables_ + op.out) * kBlock;
            op.function(sources[op.a], sources[op.b], out, n);
            if (columns::first_nan(out, n) < n) return false;
        }
        for (std::size_t r = 0; r < read_.size(); ++r) {
            Runs& seen = seen_[r];
            const double* values = sources[read_[r]];
            double last = seen.empty() ? std::nan("") : seen.at(seen.size() - 1)->q;
            for (std::size_t i = 0; i < n; ++i) {
                const double value = kept(values[i]);
                if (same(value, last)) continue;
                last = value;
                const Time step = std::max(times[i], begin);
                seen.add(2 * (step - begin), Pair{0.0, value});
            }
        }
    }
    return true;
}

std::size_t Signs::world(bool best) const {
    if (end_ == End::complete || !ahead_) return Regions::now;
    if (end_ == End::cut) return best ? Regions::cut_upper : Regions::cut_lower;
    return best ? Regions::upper : Regions::lower;
}

// Finds from where on registers differ from the world `now`: where they read what is not recorded.
void Signs::settle(std::size_t world) {
    const std::size_t terms = constants_.size();
    for (std::size_t reg = 0; reg < found_.size(); ++reg) {
        Time& settled = settled_[reg][world];
        settled = world == Regions::now || !numbers_ ? 0 : t_ + 1;
        if (reg < terms || settled == 0) continue;
        const FormulaRow& row = rows_[reg - terms];
        const Time inner = std::min(settled_[row.a][world], settled_[row.b][world]);
        const Reading reading(row, folds_[reg - terms]);
        if (row.kind == "MAP") {
            settled = inner;
        } else if (!row.hi) {
            if (!is_cut(world) || inner <= t_) settled = 0;
        } else {
            settled = std::min(settled, std::max<Time>(0, inner - *row.hi));
            if (reading.endless && is_cut(world))
                settled = std::min(settled, std::max<Time>(0, t_ - reading.begin + 1));
        }
    }
}

const Runs& Signs::runs(std::size_t reg, std::size_t world) {
    std::optional<Runs>& found = found_[reg][world];
    if (found) return *found;
    const std::size_t terms = constants_.size();
    const Time begin = settled_[reg][world];
    if (reg >= terms) {
        found = windowed(reg, world, begin);
    } else if (constants_[reg]) {
        found.emplace().add(begin, Pair{0.0, kept(*constants_[reg])});
    } else {
        const auto place = std::find(read_.begin(), read_.end(), reg) - read_.begin();
        if (begin == 0)
            found = seen_[static_cast<std::size_t>(place)];
        else
            found.emplace();
        const bool best = world == Regions::upper || world == Regions::cut_upper;
        const Pair unseen{0.0, best ? kInfinity : -kInfinity};
        found->push(t_ + 1, &unseen);
    }
    return *found;
}

RunsView Signs::from(std::size_t reg, std::size_t world, Time begin, Runs& memory) {
    const Time settled = settled_[reg][world];
    if (begin >= settled) return runs(reg, world).view().clipped(begin);
    memory.append(runs(reg, Regions::now).view().clipped(begin, settled - 1));
    memory.append(runs(reg, world).view());
    return memory.view();
}

Runs Signs::windowed(std::size_t reg, std::size_t world, Time begin) {
    const std::size_t i = reg - constants_.size();
    const FormulaRow& row = rows_[i];
    const RegionFold fold = folds_[i];
    Runs memory[2], pairs, read, found;
    if (row.kind == "MAP") {
        join(from(row.a, world, begin, memory[0]), from(row.b, world, begin, memory[1]), begin,
             pairs);
        for (std::size_t k = 0; k < pairs.size(); ++k)
            found.push(pairs.start(k), fold.upper(pairs.at(k)->p, pairs.at(k)->q));
        return found;
    }
    const Time lo = row.lo.value_or(0), hi = row.hi.value_or(0);
    const Time first = row.lo ? std::max<Time>(0, begin + lo) : 0;
    RunsView elements = from(row.b, world, first, memory[1]);
    if (fold.kind != Kind::single) {
        join(from(row.a, world, first, memory[0]), elements, first, pairs);
        pair_up(fold, pairs.view(), {}, read);
        elements = read.view();
    }
    FoldMemory folding;
    if (!row.lo) {
        Pair total = fold.identity();
        if (elements.start(0) - hi > 0) found.push(0, &total);
        for (std::size_t k = 0; k < elements.size(); ++k) {
            total = fold.combine(total, *elements.at(k));
            found.push(elements.start(k) - hi, &total);
        }
        if (begin == 0) return found;
        Runs later;
        later.append(found.view().clipped(begin));
        return later;
    }
    const Reading reading(row, fold);
    const bool stops = reading.stops(world);
    const Time after = std::max(begin, t_ + 1);  // the first position behind the trace
    if (!row.hi) {
        const Time end = is_cut(world) || stops ? t_ : kEver;
        if (begin <= end)
            fold_suffixes(fold, elements.clipped(begin, end), 0, {fold.identity()}, folding, found);
        if (is_cut(world))
            found.append(windowed(reg, world - 2, after).view());
        else if (stops)
            write_own(found, fold, 0, elements, after);
        return found;
    }
    if (stops) {
        if (begin <= t_) {
            Runs known;
            if (first <= t_) {
                const RunsView seen = elements.clipped(first, t_);
                for (std::size_t k = 0; k < seen.size(); ++k) known.add(seen.start(k), seen.at(k));
            }
            known.add(std::max(t_ + 1, first), fold.identity());
            slide(fold, known.view(), lo, hi, begin, t_, folding, found);
        }
        write_own(found, fold, lo, elements, after);
        return found;
    }
    const bool cut = reading.endless && is_cut(world);
    const Time recorded = cut ? t_ - reading.begin : kEver;
    if (recorded >= begin) slide(fold, elements, lo, hi, begin, recorded, folding, found);
    if (cut) found.append(windowed(reg, world - 2, std::max(begin, recorded + 1)).view());
    return found;
}

Signs::Spans Signs::parts(std::size_t world, bool negative) {
    Spans found;
    const Runs& runs = this->runs(result_, world);
    for (std::size_t i = 0; i < runs.size() && runs.start(i) <= t_; ++i) {
        if (std::signbit(runs.at(i)->q) != negative) continue;
        const Time end = i + 1 < runs.size() ? std::min(runs.start(i + 1) - 1, t_) : t_;
        found.emplace_back(runs.start(i), end);
    }
    return found;
}

namespace {

// Calls a function with each part of some spans that lies in others.
template <class Take>
void common(const Signs::Spans& some, const Signs::Spans& others, Take take) {
    for (auto a = some.begin(), b = others.begin(); a != some.end() && b != others.end();) {
        const Time first = std::max(a->first, b->first);
        const Time last = std::min(a->second, b->second);
        if (first <= last) take(first, last);
        if (a->second < b->second)
            ++a;
        else
            ++b;
    }
}

}  // namespace

Signs::Count Signs::fails_at(const Spans& spans) {
    Count count;
    common(parts(world(true), true), spans, [&](Time first, Time last) {
        count.ticks += (last + 1) / 2 - first / 2;  // the odd positions
        ++count.occasions;
        if (count.first < 0) count.first = first;
    });
    return count;
}

bool Signs::holds_at(const Spans& spans) {
    Time needed = 0;
    for (const auto& [first, last] : spans) {
        if (last > t_) return false;
        needed += last - first + 1;
    }
    common(parts(world(false), false), spans,
           [&](Time first, Time last) { needed -= last - first + 1; });
    return needed == 0;
}

}  // namespace rtamt::dense
