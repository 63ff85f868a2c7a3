#include "dense/signs.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "dense/region_windows.hpp"

namespace rtamt::dense {

// A term on a whole trace, of which nothing settles.
class Signs::Term final : public RegionStream {
public:
    Term(RegionTrace& trace, std::size_t reg, const DenseRow& row, bool numbers)
        : RegionStream(trace, 0), reg_(reg), constant_(row.kind == "CONST"), numbers_(numbers) {}

    // Takes the values at new times of a trace from a time on.
    void take(const Sampler& sampler, Time begin) {
        const double* values = sampler.column(reg_);
        const Time* times = sampler.times();
        double last = kept_.empty() ? std::nan("") : kept_.at(kept_.size() - 1)->q;
        for (std::size_t i = 0, n = sampler.size(); i < n; ++i) {
            const double sign = negative(values[i]) ? -kInfinity : kInfinity;
            const double value = numbers_ ? values[i] : sign;
            if (same(value, last)) continue;
            last = value;
            kept_.add(2 * (std::max(times[i], begin) - begin), Pair{0.0, value});
        }
    }

protected:
    void settle_runs(Time, Time) override {}
    void write_open(std::size_t world, Time begin, Time t, Runs& found) override {
        const bool best = world == Regions::upper || world == Regions::cut_upper;
        if (begin == 0 || constant_) found = kept_;
        if (!constant_) found.push(t + 1, best ? kInfinity : -kInfinity);
    }

private:
    std::size_t reg_;
    bool constant_;
    bool numbers_;
};

namespace {

const std::vector<DenseRow>& checked(const std::vector<DenseRow>& terms, std::size_t variables) {
    for (std::size_t i = 0; i < terms.size(); ++i) require(is_term(terms[i], i, variables));
    return terms;
}

}  // namespace

Signs::Signs(const std::vector<DenseRow>& terms, std::size_t variables,
             const std::vector<FormulaRow>& rows, std::size_t result, End end, bool numbers)
    : variables_(variables),
      rows_(rows),
      result_(result),
      end_(end),
      numbers_(numbers),
      trace_(std::make_unique<RegionTrace>()),
      sampler_(std::make_unique<Sampler>(checked(terms, variables), terms.size(),
                                         std::vector<double>(std::max<std::size_t>(1, variables),
                                                             std::nan("")))) {
    const std::size_t registers = terms.size() + rows.size();
    require(result < registers);
    require_rows(rows, terms.size());
    trace_->whole = true;
    trace_->unknowns.resize(1);  // which nothing reads
    streams_.resize(registers);
    std::vector<bool> read(registers);
    read[result] = true;
    for (const FormulaRow& row : rows) read[row.a] = read[row.b] = true;
    for (std::size_t reg = 0; reg < terms.size(); ++reg) {
        if (!read[reg]) continue;
        auto term = std::make_unique<Term>(*trace_, reg, terms[reg], numbers);
        read_.push_back(term.get());
        streams_[reg] = std::move(term);
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const FormulaRow& row = rows[i];
        require(row.hi || row.lo == std::optional<Time>(0) || row.kind == "MAP");
        ahead_ |= row.kind == "WINDOW" && (!row.hi || *row.hi > 0);
        streams_[terms.size() + i] = stream_of(*trace_, row, fold_named(row.name),
                                               *streams_[row.a], *streams_[row.b], 0);
    }
}

bool Signs::read(const Events* events, Time begin, Time last) {
    trace_->t = 2 * (last - begin);
    for (std::size_t world = Regions::now + 1; numbers_ && world < Regions::worlds; ++world)
        settle(world);
    std::vector<Events> inside;  // events in the trace, and the last one at its begin or before
    for (std::size_t v = 0; v < variables_; ++v) {
        const Events& e = events[v];
        const Time* const end = std::upper_bound(e.times, e.times + e.size, last);
        const Time* const after = std::upper_bound(e.times, end, begin);
        if (after == e.times)
            throw std::invalid_argument("expected an event at the begin of the trace");
        inside.push_back({after - 1, e.values + (after - 1 - e.times),
                          static_cast<std::size_t>(end - after + 1)});
    }
    const double zero = 0.0;
    if (inside.empty()) inside.push_back({&begin, &zero, 1});  // which no term reads
    Parts parts(inside.data(), inside.size());
    while (const Events* part = parts.next()) {
        sampler_->extend(part);
        while (sampler_->read(last)) {
            if (!sampler_->evaluate()) return false;
            for (Term* term : read_) term->take(*sampler_, begin);
            sampler_->consume();
        }
    }
    return true;
}

std::size_t Signs::world(bool best) const {
    if (!ahead_) return Regions::now;
    switch (end_) {
        case End::complete:
            return Regions::now;
        case End::cut:
            return best ? Regions::cut_upper : Regions::cut_lower;
        case End::open:
            break;
    }
    return best ? Regions::upper : Regions::lower;
}

// Registers differ from the world `now` where they read what is not recorded.
void Signs::settle(std::size_t world) {
    const Time t = trace_->t;
    for (Term* term : read_) term->differ(world, t + 1);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
        const FormulaRow& row = rows_[i];
        const Reading reading(row, fold_named(row.name));
        const Time inner =
            std::min(streams_[row.a]->differs(world), streams_[row.b]->differs(world));
        Time from = t + 1;
        if (row.kind == "MAP") {
            from = inner;
        } else if (!row.hi) {
            if (!is_cut(world) || inner <= t) from = 0;
        } else {
            from = std::min(from, std::max<Time>(0, inner - *row.hi));
            if (reading.endless && is_cut(world))
                from = std::min(from, std::max<Time>(0, t - reading.begin + 1));
        }
        streams_[streams_.size() - rows_.size() + i]->differ(world, from);
    }
}

RunsView Signs::result(std::size_t world) {
    RegionStream& result = *streams_[result_];
    return result.open(world).view().clipped(result.differs(world));
}

Signs::Spans Signs::parts(std::size_t world, bool negative) {
    Spans found;
    const Runs& runs = streams_[result_]->open(world);
    const Time last = trace_->t;
    for (std::size_t i = 0; i < runs.size() && runs.start(i) <= last; ++i) {
        if (std::signbit(runs.at(i)->q) != negative) continue;
        const Time end = i + 1 < runs.size() ? std::min(runs.start(i + 1) - 1, last) : last;
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
        if (last > trace_->t) return false;
        needed += last - first + 1;
    }
    common(parts(world(false), false), spans,
           [&](Time first, Time last) { needed -= last - first + 1; });
    return needed == 0;
}

}  // namespace rtamt::dense
