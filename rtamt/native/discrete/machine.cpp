#include "discrete/machine.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

namespace rtamt {
namespace {

constexpr std::size_t kMost = std::size_t{1} << 32;

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

template <class Fold>
inline double push(const Step& step, const double* r, std::int64_t t) {
    using M = typename Fold::Monoid;
    const auto x = t >= step.start ? M::element(r[step.a], r[step.b]) : M::identity;
    return M::result(static_cast<Fold*>(step.part)->push(x));
}

// Whether all values are numbers.
inline bool execute(const std::vector<Step>& steps, double* r, std::int64_t t) {
    bool nan = false;
    for (const Step& step : steps) {
        double value;
        switch (step.opcode) {
#define RTAMT_CASE(name, arity, value_)                          \
    case Opcode::map_##name:                                     \
        value = functions::name(r[step.a], r[step.b]);           \
        break;
            RTAMT_FUNCTIONS(RTAMT_CASE)
#undef RTAMT_CASE
#define RTAMT_CASE(name, Type)                                   \
    case Opcode::latest_##name:                                  \
        value = push<Latest<Type>>(step, r, t);                  \
        break;                                                   \
    case Opcode::running_##name:                                 \
        value = push<Running<Type>>(step, r, t);                 \
        break;                                                   \
    case Opcode::sliding_##name:                                 \
        value = push<Sliding<Type>>(step, r, t);                 \
        break;
            RTAMT_FOLDS(RTAMT_CASE)
#undef RTAMT_CASE
        case Opcode::delay:
            value = static_cast<Delay*>(step.part)->push(r[step.a]);
            break;
        default:
            return false;  // there are no others
        }
        r[step.out] = value;
        nan |= value != value;
    }
    return !nan;
}

std::uint64_t fingerprint(const std::vector<Row>& rows, std::size_t variables) {
    Fingerprint print;
    print.add(variables);
    for (const Row& row : rows) {
        print.add(row.slot);
        print.add(row.kind);
        print.add(row.name);
        print.add(row.a);
        print.add(row.b);
        print.add(row.value);
        print.add(row.length);
        print.add(row.start);
    }
    return print.value();
}

template <class M>
std::pair<Opcode, std::unique_ptr<Part>> fold(std::size_t length, Opcode latest) {
    const auto after = [latest](int i) { return Opcode(static_cast<int>(latest) + i); };
    if (length == 0) return {after(1), std::make_unique<Running<M>>()};
    if (length == 1) return {latest, std::make_unique<Latest<M>>()};
    return {after(2), std::make_unique<Sliding<M>>(length)};
}

}  // namespace

DiscreteMachine::DiscreteMachine(const std::vector<Row>& rows, std::size_t terms, std::size_t variables,
                 const std::vector<Observed>& observed)
    : variables_(variables),
      observed_(observed),
      samples_in_(2 * variables),
      pending_(samples_in_.data()),
      inputs_(pending_ + variables),
      fingerprint_(fingerprint(rows, variables)) {
    initial_.resize(rows.size());
    for (const Row& row : rows) {
        const std::size_t limit = row.kind == "LOAD" ? variables : rows.size();
        if (row.slot >= rows.size() || row.a >= limit || row.b >= rows.size() ||
            row.length > kMost || (row.slot < terms && row.kind == "WINDOW"))
            refuse("row " + std::to_string(row.slot) + " is out of range");
        compile(row, terms);
    }
    if (observed_.empty()) refuse("expected the result among the observed");
    for (const Observed& o : observed_)
        if (o.slot >= rows.size() || o.latency < 0) refuse("an observed register is out of range");
    registers_ = initial_;
}

void DiscreteMachine::compile(const Row& row, std::size_t terms) {
    const auto narrow = [](std::size_t i) { return static_cast<std::uint32_t>(i); };
    Step step{Opcode::delay, narrow(row.slot), narrow(row.a), narrow(row.b), row.start, nullptr};
    if (row.kind == "LOAD") {
        loads_.push_back({step.out, step.a});
        return;
    }
    if (row.kind == "CONST") {
        initial_[row.slot] = row.value;
        return;
    }
    if (row.kind == "MAP") {
#define RTAMT_NAMED(name_, arity, value) \
    if (row.name == #name_) step.opcode = Opcode::map_##name_;
        RTAMT_FUNCTIONS(RTAMT_NAMED)
#undef RTAMT_NAMED
        if (step.opcode == Opcode::delay) refuse("unknown function '" + row.name + "'");
    } else if (row.kind == "WINDOW") {
        std::unique_ptr<Part> part;
#define RTAMT_NAMED(name_, Type) \
    if (row.name == #name_)      \
        std::tie(step.opcode, part) = fold<Type>(row.length, Opcode::latest_##name_);
        RTAMT_FOLDS(RTAMT_NAMED)
#undef RTAMT_NAMED
        if (!part) refuse("unknown lattice fold '" + row.name + "'");
        parts_.push_back(std::move(part));
        step.part = parts_.back().get();
    } else if (row.kind == "DELAY") {
        if (row.length == 0) refuse("a delay of nothing");
        parts_.push_back(std::make_unique<Delay>(row.length));
        step.part = parts_.back().get();
    } else {
        refuse("unknown kind '" + row.kind + "'");
    }
    (row.slot < terms ? terms_ : formulas_).push_back(step);
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
    for (const auto& part : parts_) part->reset();
}

std::string DiscreteMachine::state() const {
    Writer out;
    out.put(fingerprint_);
    out.put(samples_);
    out.put(inputs_, variables_);
    out.put(registers_.data(), registers_.size());
    for (const auto& part : parts_) part->save(out);
    return out.bytes();
}

void DiscreteMachine::restore(std::string_view bytes) {
    Reader in(bytes);
    if (bytes.size() < sizeof fingerprint_ || in.get<std::uint64_t>() != fingerprint_)
        refuse(kForeign);
    try {
        reset();
        samples_ = in.get<std::int64_t>();
        Reader::require(samples_ >= 0);
        in.get(inputs_, variables_);
        in.get(registers_.data(), registers_.size());
        for (const auto& part : parts_) part->load(in);
        Reader::require(in.empty());
    } catch (const std::invalid_argument&) {
        reset();
        throw;
    }
}

}  // namespace rtamt
