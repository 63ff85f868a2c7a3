#include "dense/regions.hpp"

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

#include "dense/region_windows.hpp"

namespace rtamt::dense {

Regions::Regions(std::size_t terms, const std::vector<RegionConstant>& constants,
                 const std::vector<RegionRow>& rows, const std::vector<std::size_t>& initial,
                 const std::vector<std::size_t>& streams, const std::vector<std::size_t>& unknowns)
    : terms_(terms),
      constants_(terms),
      rows_(rows),
      initial_(initial),
      streams_(terms + rows.size()),
      order_(streams),
      folds_(terms + rows.size()),
      found_(terms + rows.size()),
      trace_(std::make_unique<RegionTrace>()) {
    const std::size_t registers = terms + rows.size();
    const auto require = [](bool condition) {
        if (!condition) throw std::invalid_argument("expected a program over regions");
    };
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
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const RegionRow& row = rows[i];
        require(row.a < terms + i && row.b < terms + i);
        require(row.kind == "MAP" || (row.kind == "WINDOW" && (row.lo || row.hi)));
        require(!row.guard || row.hi);
        require(row.kind == "MAP" || (row.hi && *row.hi <= 0) || (row.lo && *row.lo >= 0));
        require(!row.lo || !row.hi || *row.lo <= *row.hi);
        fold_of_.push_back(fold_named(row.name));
        print.add(row.kind, row.name, row.a, row.b, row.lo.value_or(kEver), row.hi.value_or(kEver),
                  row.guard, row.endless);
    }
    fingerprint_ = print.value();
    std::vector<Time> reaches(registers);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const RegionRow& row = rows[i];
        const Time lo = row.lo.value_or(0), hi = row.hi.value_or(0);
        require(-kEver <= lo && -kEver <= hi);
        const Time inner = std::max(reaches[row.a], reaches[row.b]);
        const Time own = std::max(std::abs(lo), std::abs(hi));
        require(own <= kEver - inner);
        reaches[terms + i] = inner + own;
        reach_ = std::max(reach_, inner + own);
    }
    const auto operand = [&](std::size_t reg) -> RegionStream& {
        require(streams_[reg] != nullptr);
        return *streams_[reg];
    };
    for (const std::size_t reg : order_) {
        require(reg < registers && streams_[reg] == nullptr);
        auto& made = streams_[reg];
        if (reg < terms) {
            if (constants_[reg]) made = std::make_unique<Constant>(*trace_, *constants_[reg]);
            else made = std::make_unique<Predicate>(*trace_);
            continue;
        }
        const RegionRow& row = rows[reg - terms];
        const RegionFold fold = fold_of_[reg - terms];
        RegionStream &a = operand(row.a), &b = operand(row.b);
        if (row.kind == "MAP") {
            made = std::make_unique<Pointwise>(*trace_, fold, a, b);
        } else if (!row.hi) {
            const auto axis = std::find(unknowns.begin(), unknowns.end(), reg) - unknowns.begin();
            require(static_cast<std::size_t>(axis) < unknowns.size());
            made = std::make_unique<RegionFuture>(*trace_, row, fold, a, b,
                                                  static_cast<std::size_t>(axis));
        } else if (!row.lo) {
            made = std::make_unique<UnboundedPast>(*trace_, row, fold, a, b);
        } else {
            made = std::make_unique<Sliding>(*trace_, row, fold, a, b);
        }
    }
    for (const std::size_t reg : initial_) {
        require(reg < registers);
        if (reg < terms || rows[reg - terms].kind == "MAP") continue;
        const RegionRow& row = rows[reg - terms];
        folds_[reg] = std::make_unique<AtBegin>(*trace_, row, fold_of_[reg - terms],
                                                operand(row.a), operand(row.b));
    }
}

Regions::Regions(Regions&&) noexcept = default;
Regions& Regions::operator=(Regions&&) noexcept = default;
Regions::~Regions() = default;

void Regions::advance(const Time* positions, const double* const* terms, std::size_t n, Time t) {
    if (t_ < 0) {
        first_.clear();
        for (std::size_t reg = 0; reg < terms_; ++reg) first_.push_back(terms[reg][0]);
    }
    t_ = t;
    for (const std::size_t reg : order_) {
        RegionStream& stream = *streams_[reg];
        if (reg < terms_) stream.take(positions, terms[reg], n);
        if (!stream.settle(t)) continue;
        if (const auto axis = stream.unknown()) {
            std::vector<double> value(trace_->corners);
            for (std::size_t c = 0; c < value.size(); ++c) value[c] = stream.settling().at(0)[c].q;
            for (const auto& each : streams_)
                if (each) each->substitute(*axis, value);
            for (const auto& fold : folds_)
                if (fold) fold->substitute(*axis, value);
        }
        stream.keep(t);
    }
    for (const auto& fold : folds_)
        if (fold) fold->settle();
    for (const std::size_t reg : order_) streams_[reg]->trim();
}

Regions::Values Regions::look(std::size_t worlds) {
    trace_->t = t_;
    for (const std::size_t reg : order_) streams_[reg]->forget();
    if (trace_->axes > 0)  // windows without end find the values of unknowns
        for (const std::size_t reg : order_)
            for (std::size_t world = 0; world < worlds; ++world) streams_[reg]->open(world);
    for (const std::size_t reg : initial_) found_[reg] = at_zero(reg, found_, worlds);
    return found_[initial_.back()];
}

Regions::Values Regions::at_zero(std::size_t reg, const std::vector<Values>& found,
                                 std::size_t worlds) const {
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
    const RegionRow& row = rows_[reg - terms_];
    const RegionFold fold = fold_of_[reg - terms_];
    for (std::size_t world = 0; world < worlds; ++world)
        values[world] = folds_[reg] ? folds_[reg]->value(world, t_)
                                    : fold.upper(found[row.a][world], found[row.b][world]);
    return values;
}

void Regions::reset() {
    t_ = -1;
    first_.clear();
    for (const std::size_t reg : order_) streams_[reg]->reset();
    for (const auto& fold : folds_)
        if (fold) fold->reset();
}

void Regions::fields(Snapshot& s) {
    s(t_);
    s.sized(first_);
    s.require(first_.size() == (t_ < 0 ? 0 : terms_));
    s.require(t_ >= -1 && (t_ < 0 || t_ % 2 == 0) && t_ <= kEver - reach_);
    for (const std::size_t reg : order_) {
        RegionStream& stream = *streams_[reg];
        stream.fields(s);
        s.require(stream.last() == std::max<Time>(-1, t_ - stream.late()));
    }
    for (const auto& fold : folds_)
        if (fold) fold->fields(s);
}

}  // namespace rtamt::dense
