#include "dense/regions.hpp"

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

#include "dense/region_windows.hpp"

namespace rtamt::dense {

void require(bool condition) {
    if (!condition) throw std::invalid_argument("expected a program over regions");
}

void require_rows(const std::vector<FormulaRow>& rows, std::size_t terms) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const FormulaRow& row = rows[i];
        require(row.a < terms + i && row.b < terms + i);
        if (row.kind == "MAP") continue;
        require(row.kind == "WINDOW" && (!row.guard || row.hi));
        require((row.hi && *row.hi <= 0) || (row.lo && *row.lo >= 0));
        require(!row.lo || !row.hi || *row.lo <= *row.hi);
    }
}

Regions::Regions(std::size_t terms, const std::vector<RegionConstant>& constants,
                 const std::vector<FormulaRow>& rows, const std::vector<std::size_t>& initial,
                 const std::vector<std::size_t>& streams, const std::vector<std::size_t>& unknowns)
    : terms_(terms),
      constants_(terms),
      rows_(rows),
      initial_(initial),
      columns_(terms + rows.size()),
      made_(terms + rows.size()),
      folds_(terms + rows.size()),
      found_(terms + rows.size()),
      trace_(std::make_unique<RegionTrace>()) {
    const std::size_t registers = terms + rows.size();
    require_rows(rows, terms);
    constexpr std::size_t kMostUnknowns = 16;
    require(unknowns.size() <= kMostUnknowns && !initial.empty());
    for (const RegionConstant& c : constants) {
        require(c.reg < terms);
        constants_[c.reg] = c.value;
    }
    trace_->axes = unknowns.size();
    trace_->corners = std::size_t{1} << unknowns.size();
    trace_->unknowns.resize(unknowns.size());
    Fingerprint print;
    print.add(terms, initial.size(), streams.size(), unknowns.size());
    for (const RegionConstant& c : constants) print.add(c.reg, c.value);
    for (const std::size_t reg : initial) print.add(reg);
    for (const std::size_t reg : streams) print.add(reg);
    for (const FormulaRow& row : rows) {
        fold_of_.push_back(fold_named(row.name));
        print.add(row.kind, row.name, row.a, row.b, row.lo.value_or(kEver), row.hi.value_or(kEver),
                  row.guard, row.endless);
    }
    fingerprint_ = print.value();
    std::vector<Time> reaches(registers);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const FormulaRow& row = rows[i];
        const Time lo = row.lo.value_or(0), hi = row.hi.value_or(0);
        require(-kEver <= lo && -kEver <= hi);
        const Time inner = std::max(reaches[row.a], reaches[row.b]);
        const Time own = std::max(std::abs(lo), std::abs(hi));
        require(own <= kEver - inner);
        reaches[terms + i] = inner + own;
        reach_ = std::max(reach_, inner + own);
    }
    make_streams(streams, unknowns);
    for (const std::size_t reg : initial_) {
        require(reg < registers);
        if (reg < terms || rows[reg - terms].kind == "MAP") continue;
        const FormulaRow& row = rows[reg - terms];
        require(!folds_[reg] && made_[row.a] && made_[row.b]);
        folds_[reg] = std::make_unique<AtBegin>(*trace_, row, fold_of_[reg - terms], *made_[row.a],
                                                *made_[row.b]);
        order_of_folds_.push_back(folds_[reg].get());
    }
}

void Regions::make_streams(const std::vector<std::size_t>& streams,
                           const std::vector<std::size_t>& unknowns) {
    const std::size_t registers = columns_.size();
    // Registers that are known where terms are, with what they are at unseen positions.
    std::vector<std::optional<std::array<double, kWorlds>>> unseen(registers);
    // Those whose runs are read: others are read as columns alone.
    std::vector<bool> listed(registers), read(registers);
    for (std::size_t reg = 0; reg < terms_; ++reg) {
        unseen[reg] = {-kInfinity, -kInfinity, kInfinity, -kInfinity, kInfinity};
        if (constants_[reg]) unseen[reg]->fill(*constants_[reg]);
    }
    for (const std::size_t reg : streams) {
        require(reg < registers && !listed[reg]);
        listed[reg] = true;
        if (reg < terms_) continue;
        const FormulaRow& row = rows_[reg - terms_];
        require(listed[row.a] && listed[row.b]);
        if (row.kind == "MAP" && unseen[row.a] && unseen[row.b]) {
            const RegionFold fold = fold_of_[reg - terms_];
            instants_.push_back({reg, fold, {}});
            unseen[reg].emplace();
            for (std::size_t world = 0; world < kWorlds; ++world)
                (*unseen[reg])[world] =
                    fold.upper((*unseen[row.a])[world], (*unseen[row.b])[world]);
        } else {
            read[row.a] = read[row.b] = true;
        }
    }
    for (const std::size_t reg : initial_)
        if (reg >= terms_ && reg < registers && rows_[reg - terms_].kind == "WINDOW")
            read[rows_[reg - terms_].a] = read[rows_[reg - terms_].b] = true;
    for (const std::size_t reg : streams) {
        auto& made = made_[reg];
        Leaf* leaf = nullptr;
        RegionFuture* future = nullptr;
        if (unseen[reg]) {
            if (!read[reg]) continue;
            made = std::make_unique<Leaf>(*trace_, *unseen[reg]);
            leaf = static_cast<Leaf*>(made.get());
            streams_.push_back({reg, made.get(), leaf, future});
            continue;
        }
        const FormulaRow& row = rows_[reg - terms_];
        const RegionFold fold = fold_of_[reg - terms_];
        RegionStream &a = *made_[row.a], &b = *made_[row.b];
        const auto axis = static_cast<std::size_t>(
            std::find(unknowns.begin(), unknowns.end(), reg) - unknowns.begin());
        const bool settles = row.kind == "MAP" || row.hi;
        require(settles || axis < unknowns.size());
        made = stream_of(*trace_, row, fold, a, b, axis);
        if (!settles) future = static_cast<RegionFuture*>(made.get());
        streams_.push_back({reg, made.get(), leaf, future});
    }
}

Regions::Regions(Regions&&) noexcept = default;
Regions& Regions::operator=(Regions&&) noexcept = default;
Regions::~Regions() = default;

// Computes the columns of what compares terms.
void Regions::evaluate(const double* const* terms, std::size_t n) {
    std::copy_n(terms, terms_, columns_.begin());
    for (Instant& instant : instants_) {
        if (instant.column.size() < n)
            instant.column.resize(std::max(n, 2 * instant.column.size()));
        const FormulaRow& row = rows_[instant.reg - terms_];
        const double *a = columns_[row.a], *b = columns_[row.b];
        double* out = instant.column.data();
        if (instant.fold.least) {
            for (std::size_t i = 0; i < n; ++i) out[i] = lesser(a[i], b[i]);
        } else {
            for (std::size_t i = 0; i < n; ++i) out[i] = greater(a[i], b[i]);
        }
        columns_[instant.reg] = out;
    }
}

void Regions::advance(const Time* positions, const double* const* terms, std::size_t n, Time t) {
    if (t_ < 0) {
        first_.clear();
        for (std::size_t reg = 0; reg < terms_; ++reg) first_.push_back(terms[reg][0]);
    }
    evaluate(terms, n);
    trace_->before = t_;
    trace_->t = t_ = t;
    ++trace_->update;
    for (const Stream& each : streams_) {
        if (each.leaf) {
            each.leaf->take(positions, columns_[each.reg], n, t);
        } else {
            if (each.future && each.future->find(t)) substitute(*each.future);
            each.stream->settle(t);
        }
    }
    for (AtBegin* fold : order_of_folds_) fold->settle();
    for (const Stream& each : streams_) each.stream->trim();
}

// Writes the unknown of a window as a polynomial in what it is later.
void Regions::substitute(RegionFuture& future) {
    for (const Stream& each : streams_) each.stream->substitute(future.axis(), future.value());
    for (AtBegin* fold : order_of_folds_) fold->substitute(future.axis(), future.value());
}

Regions::Values Regions::look(std::size_t worlds) {
    if (trace_->axes > 0)  // windows without end find the values of unknowns
        for (const Stream& each : streams_)
            for (std::size_t world = 0; world < worlds; ++world) each.stream->open(world);
    for (const std::size_t reg : initial_) found_[reg] = at_zero(reg, worlds);
    return found_[initial_.back()];
}

Regions::Values Regions::at_zero(std::size_t reg, std::size_t worlds) const {
    Values values{};
    if (reg < terms_) {
        if (constants_[reg]) {
            values.fill(*constants_[reg]);
        } else if (t_ >= 0) {
            values.fill(first_[reg]);
        } else {
            values = {-kInfinity, -kInfinity, kInfinity, -kInfinity, kInfinity};
        }
        return values;
    }
    const FormulaRow& row = rows_[reg - terms_];
    const RegionFold fold = fold_of_[reg - terms_];
    for (std::size_t world = 0; world < worlds; ++world)
        values[world] = folds_[reg] ? folds_[reg]->value(world, t_)
                                    : fold.upper(found_[row.a][world], found_[row.b][world]);
    return values;
}

void Regions::reset() {
    trace_->t = trace_->before = t_ = -1;
    trace_->update += 2;  // nothing is kept
    first_.clear();
    for (const Stream& each : streams_) each.stream->reset();
    for (AtBegin* fold : order_of_folds_) fold->reset();
}

void Regions::fields(Snapshot& s) {
    s(t_);
    s.sized(first_);
    s.require(first_.size() == (t_ < 0 ? 0 : terms_));
    s.require(t_ >= -1 && (t_ < 0 || t_ % 2 == 0) && t_ <= kEver - reach_);
    if (s.reads()) {
        trace_->t = trace_->before = t_;
        trace_->update += 2;
    }
    for (const Stream& each : streams_) {
        each.stream->fields(s);
        s.require(each.stream->last() == std::max<Time>(-1, t_ - each.stream->late()));
        if (s.reads()) each.stream->restored();
    }
    for (AtBegin* fold : order_of_folds_) fold->fields(s);
}

}  // namespace rtamt::dense
