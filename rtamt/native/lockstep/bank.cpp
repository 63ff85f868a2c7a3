#include "lockstep/bank.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace rtamt {
namespace {

std::uint64_t fingerprint_of(std::uint64_t program, std::size_t num) {
    Fingerprint print;
    print.add(program, num);
    return print.value();
}

}  // namespace

Bank::Bank(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
           const Observed& result, std::size_t num)
    : program_(rows, terms, variables, {result}),
      columns_(program_, num),
      lanes_(num),
      inputs_(num * variables),
      fingerprint_(fingerprint_of(program_.fingerprint(), num)) {}

// Reads a variable of the chosen lanes.
void Bank::read(const Table& table, std::size_t variable, double* out) const {
    const double* from = table.at(variable);
    const std::size_t count = lanes_.count();
    if (lanes_.all() && table.row == 1) {
        std::copy_n(from, count, out);
    } else if (lanes_.all()) {
        for (std::size_t i = 0; i < count; ++i, from += table.row) out[i] = *from;
    } else {
        for (std::size_t i = 0; i < count; ++i) out[i] = from[lanes_[i] * table.row];
    }
}

std::size_t Bank::take_terms(const Table& table, const std::uint8_t* mask) {
    lanes_.choose(mask);
    const std::size_t count = lanes_.count();
    for (const Load& load : program_.loads_) read(table, load.variable, columns_.out(load.out));
    std::size_t bad = columns_.terms(count);
    for (const std::size_t variable : columns_.unread()) {
        const double* from = table.at(variable);
        for (std::size_t i = 0; i < bad; ++i)
            if (std::isnan(from[lanes_[i] * table.row])) bad = i;
    }
    if (bad < count) return lanes_[bad];
    keep_inputs(table);
    return num();
}

void Bank::keep_inputs(const Table& table) {
    for (std::size_t variable = 0; variable < variables(); ++variable) {
        double* inputs = inputs_.data() + variable * num();
        if (lanes_.all()) {
            read(table, variable, inputs);
        } else {
            for (std::size_t i = 0; i < lanes_.count(); ++i)
                inputs[lanes_[i]] = table.at(variable)[lanes_[i] * table.row];
        }
    }
}

void Bank::choose_and_clear(const std::uint8_t* mask) {
    lanes_.choose(mask);
    for (std::size_t variable = 0; variable < variables(); ++variable)
        for (std::size_t i = 0; i < lanes_.count(); ++i)
            inputs_[variable * num() + lanes_[i]] = 0.0;
}

void Bank::fields(Snapshot& s) {
    s.array(inputs_.data(), inputs_.size());
}

DiscreteBank::DiscreteBank(const std::vector<DiscreteRow>& rows, std::size_t terms,
                           std::size_t variables, const Observed& result, std::size_t num)
    : Bank(rows, terms, variables, result, num), samples_(num), results_(num, std::nan("")) {
    for (const Instruction& i : program_.formulas_) formulas_.push_back({i, {}});
    for (std::size_t lane = 0; lane < num; ++lane) {
        DiscreteMachine machine(rows, terms, variables, {result});
        auto memory = machine.memories_.begin();
        for (LaneInstruction& formula : formulas_)
            if (formula.instruction.memory != nullptr)
                formula.memories.push_back(std::move(*memory++));
    }
}

std::size_t DiscreteBank::take(const Table& table, const std::uint8_t* mask) {
    if (const std::size_t bad = take_terms(table, mask); bad < num()) return bad;
    const std::size_t count = lanes_.count();
    least_ = std::numeric_limits<std::int64_t>::max();
    for (std::size_t i = 0; i < count; ++i) least_ = std::min(least_, samples_[lanes_[i]]);
    for (const LaneInstruction& formula : formulas_) {
        const Instruction& instruction = formula.instruction;
        dispatch(
            instruction.opcode,
            [&]<double (*function)(double, double)> { columns_.map(instruction, count); },
            [&]<class Window> { push<Window>(formula); },
            [&] {
                const double* in = columns_.at(instruction.a);
                double* out = columns_.out(instruction.out);
                const auto* memories = formula.memories.data();
                for (std::size_t i = 0; i < count; ++i)
                    out[i] = static_cast<DelayLine*>(memories[lanes_[i]].get())->push(in[i]);
            });
    }
    const Observed& result = program_.observed_.front();
    const double* values = columns_.at(result.slot);
    for (std::size_t i = 0; i < count; ++i)
        if (++samples_[lanes_[i]] > result.latency) results_[lanes_[i]] = values[i];
    return num();
}

template <class Window>
void DiscreteBank::push(const LaneInstruction& formula) {
    using F = typename Window::Fold;
    const Instruction& instruction = formula.instruction;
    const double* a = columns_.at(instruction.a);
    const double* b = columns_.at(instruction.b);
    double* out = columns_.out(instruction.out);
    const auto* memories = formula.memories.data();
    const std::size_t count = lanes_.count();
    const auto push_to = [&](std::size_t i, typename F::Element x) {
        out[i] = F::result(static_cast<Window*>(memories[lanes_[i]].get())->push(x));
    };
    if (least_ >= instruction.start) {
        for (std::size_t i = 0; i < count; ++i) push_to(i, F::element(a[i], b[i]));
    } else {
        for (std::size_t i = 0; i < count; ++i)
            push_to(i, samples_[lanes_[i]] >= instruction.start ? F::element(a[i], b[i])
                                                                : F::identity);
    }
}

void DiscreteBank::reset(const std::uint8_t* mask) {
    choose_and_clear(mask);
    for (std::size_t i = 0; i < lanes_.count(); ++i) {
        const std::uint32_t lane = lanes_[i];
        samples_[lane] = 0;
        results_[lane] = std::nan("");
        for (const LaneInstruction& formula : formulas_)
            if (!formula.memories.empty()) formula.memories[lane]->reset();
    }
}

void DiscreteBank::fields(Snapshot& s) {
    Bank::fields(s);
    s.counts(samples_.data(), num());
    s.array(results_.data(), num());
    for (const LaneInstruction& formula : formulas_)
        for (const auto& memory : formula.memories) memory->fields(s);
}

EpisodeBank::EpisodeBank(const episode::Program& program, std::size_t num)
    : Bank(program.terms, program.terms.size(), program.variables, {0, 0}, num), values_(num) {
    if (num == 0) throw std::invalid_argument("expected a lane, got none");
    const EpisodeMachine checked(program);
    fingerprint_ = fingerprint_of(checked.fingerprint(), num);
    episodes_ = lockstep::episodes_of(program, values_);
}

std::size_t EpisodeBank::take(const Table& table, const std::uint8_t* mask) {
    if (const std::size_t bad = take_terms(table, mask); bad < num()) return bad;
    episodes_->take(lanes_, inputs_.data(), columns_);
    return num();
}

void EpisodeBank::take(const Table& table, const std::uint8_t* mask, const double* terms) {
    lanes_.choose(mask);
    for (std::size_t slot = 0; slot < program_.registers().size(); ++slot)
        std::copy_n(terms + slot * num(), lanes_.count(), columns_.out(slot));
    keep_inputs(table);
    episodes_->take(lanes_, inputs_.data(), columns_);
}

void EpisodeBank::reset(const std::uint8_t* mask) {
    choose_and_clear(mask);
    episodes_->reset(lanes_);
}

void EpisodeBank::finish(const std::uint8_t* mask, End end) {
    lanes_.choose(mask);
    episodes_->finish(lanes_, end);
}

void EpisodeBank::fields(Snapshot& s) {
    Bank::fields(s);
    episodes_->fields(s);
}

}  // namespace rtamt
