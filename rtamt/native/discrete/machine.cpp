#include "discrete/machine.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <tuple>
#include <utility>

namespace rtamt {
namespace {

constexpr std::size_t kMaxLength = std::size_t{1} << (sizeof(std::size_t) > 4 ? 32 : 28);

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

template <class Window>
inline double push(const Instruction& i, const double* r, std::int64_t t) {
    using F = typename Window::Fold;
    const auto x = t >= i.start ? F::element(r[i.a], r[i.b]) : F::identity;
    return F::result(static_cast<Window*>(i.memory)->push(x));
}

// Runs every instruction on sample t. Returns false if a value is nan.
inline bool execute(const std::vector<Instruction>& instructions, double* r, std::int64_t t) {
    bool nan = false;
    for (const Instruction& i : instructions) {
        double value = 0.0;
        dispatch(
            i.opcode, [&]<double (*function)(double, double)> { value = function(r[i.a], r[i.b]); },
            [&]<class Window> { value = push<Window>(i, r, t); },
            [&] { value = static_cast<DelayLine*>(i.memory)->push(r[i.a]); });
        r[i.out] = value;
        nan |= value != value;
    }
    return !nan;
}

std::uint64_t fingerprint_of(const std::vector<DiscreteRow>& rows, std::size_t variables) {
    Fingerprint print;
    print.add(variables);
    for (const DiscreteRow& row : rows)
        print.add(row.slot, row.kind, row.name, row.a, row.b, row.value, row.length, row.start);
    return print.value();
}

template <class F>
std::pair<Opcode, std::unique_ptr<Memory>> window(std::size_t length, Opcode latest) {
    const auto after = [latest](int i) { return Opcode(static_cast<int>(latest) + i); };
    if (length == 0) return {after(1), std::make_unique<RunningWindow<F>>()};
    if (length == 1) return {latest, std::make_unique<LatestWindow<F>>()};
    return {after(2), std::make_unique<SlidingWindow<F>>(length)};
}

}  // namespace

DiscreteMachine::DiscreteMachine(const std::vector<DiscreteRow>& rows, std::size_t terms,
                                 std::size_t variables, const std::vector<Observed>& observed)
    : variables_(variables),
      observed_(observed),
      samples_in_(2 * variables),
      pending_(samples_in_.data()),
      inputs_(pending_ + variables),
      fingerprint_(fingerprint_of(rows, variables)) {
    initial_.resize(rows.size());
    for (const DiscreteRow& row : rows) {
        const std::size_t limit = row.kind == "LOAD" ? variables : rows.size();
        if (row.slot >= rows.size() || row.a >= limit || row.b >= rows.size() ||
            row.length > kMaxLength ||
            (row.slot < terms && (row.kind == "WINDOW" || row.kind == "DELAY")))
            refuse("row " + std::to_string(row.slot) + " is out of range");
        compile(row, terms);
    }
    for (const Observed& o : observed_)
        if (o.slot >= rows.size() || o.latency < 0) refuse("an observed register is out of range");
    registers_ = initial_;
}

void DiscreteMachine::compile(const DiscreteRow& row, std::size_t terms) {
    const auto narrow = [](std::size_t i) { return static_cast<std::uint32_t>(i); };
    Instruction made{Opcode::delay, narrow(row.slot), narrow(row.a),
                     narrow(row.b), row.start,        nullptr};
    if (row.kind == "LOAD") {
        loads_.push_back({made.out, made.a});
        return;
    }
    if (row.kind == "CONST") {
        initial_[row.slot] = row.value;
        constants_.push_back(made.out);
        return;
    }
    if (row.kind == "MAP") {
#define RTAMT_NAMED(name_, arity, value) \
    if (row.name == #name_) made.opcode = Opcode::map_##name_;
        RTAMT_FUNCTIONS(RTAMT_NAMED)
#undef RTAMT_NAMED
        if (made.opcode == Opcode::delay) refuse("unknown function '" + row.name + "'");
    } else if (row.kind == "WINDOW") {
        std::unique_ptr<Memory> memory;
#define RTAMT_NAMED(name_, Type) \
    if (row.name == #name_)      \
        std::tie(made.opcode, memory) = window<Type>(row.length, Opcode::latest_##name_);
        RTAMT_FOLDS(RTAMT_NAMED)
#undef RTAMT_NAMED
        if (!memory) refuse("unknown lattice fold '" + row.name + "'");
        memories_.push_back(std::move(memory));
        made.memory = memories_.back().get();
    } else if (row.kind == "DELAY") {
        if (row.length == 0) refuse("a delay of nothing");
        memories_.push_back(std::make_unique<DelayLine>(row.length));
        made.memory = memories_.back().get();
    } else {
        refuse("unknown kind '" + row.kind + "'");
    }
    (row.slot < terms ? terms_ : formulas_).push_back(made);
}

bool DiscreteMachine::take() {
    double* r = registers_.data();
    bool nan = false;
    for (std::size_t i = 0; i < variables_; ++i) nan |= pending_[i] != pending_[i];
    for (const Load& load : loads_) r[load.out] = pending_[load.variable];
    if (!execute(terms_, r, samples_) || nan) [[unlikely]] {
        // The registers of the sample before, from its inputs.
        if (samples_ == 0) {
            registers_ = initial_;
        } else {
            for (const Load& load : loads_) r[load.out] = inputs_[load.variable];
            execute(terms_, r, samples_);
        }
        return false;
    }
    execute(formulas_, r, samples_);
    std::swap(pending_, inputs_);
    ++samples_;
    return true;
}

void DiscreteMachine::take(const double* inputs, const double* terms, std::size_t stride) {
    std::copy_n(inputs, variables_, inputs_);
    for (double& value : registers_) {
        value = *terms;
        terms += stride;
    }
    ++samples_;
}

double DiscreteMachine::result() const {
    const Observed& result = observed_.front();
    return samples_ > result.latency ? registers_[result.slot] : std::nan("");
}

void DiscreteMachine::reset() {
    samples_ = 0;
    registers_ = initial_;
    std::fill_n(inputs_, variables_, 0.0);
    for (const auto& memory : memories_) memory->reset();
}

void DiscreteMachine::fields(Snapshot& s) {
    s.counts(&samples_, 1);
    s.numbers(inputs_, variables_);
    s.numbers(registers_.data(), registers_.size());
    for (const std::uint32_t slot : constants_) s.require(registers_[slot] == initial_[slot]);
    for (const auto& memory : memories_) memory->fields(s);
}

namespace {

Range found(Opcode opcode, const Range& x, const Range& y) {
    switch (opcode) {
#define RTAMT_CASE(name, arity, value) \
    case Opcode::map_##name:           \
        return intervals::range_of<functions::name, intervals::name>(x, y);
        RTAMT_FUNCTIONS(RTAMT_CASE)
#undef RTAMT_CASE
        default:
            return intervals::kNothing;  // no term is a window
    }
}

}  // namespace

TermRanges::TermRanges(const std::vector<DiscreteRow>& terms, std::size_t variables)
    : program_(terms, variables), ranges_(terms.size()) {
    for (const std::uint32_t slot : program_.constants_) {
        const double value = program_.initial_[slot];
        ranges_[slot] = {value, value, true};
    }
}

bool TermRanges::find(const double* lower, const double* upper, std::ptrdiff_t stride) {
    for (const Load& load : program_.loads_) {
        const auto at = static_cast<std::ptrdiff_t>(load.variable) * stride;
        ranges_[load.out] = {lower[at], upper[at], same(lower[at], upper[at])};
    }
    for (const Instruction& i : program_.terms_) {
        const Range range = found(i.opcode, ranges_[i.a], ranges_[i.b]);
        if (!range.exists()) return false;
        ranges_[i.out] = range;
    }
    return true;
}

}  // namespace rtamt
