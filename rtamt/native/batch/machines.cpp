#include "batch/machines.hpp"

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

Batch::Batch(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
             const Observed& result, std::size_t num)
    : program_(rows, terms, variables, {result}),
      columns_(program_, num),
      entries_(num),
      inputs_(num * variables),
      fingerprint_(fingerprint_of(program_.fingerprint(), num)) {}

// Reads a variable of the chosen entries.
void Batch::read(const Table& table, std::size_t variable, double* out) const {
    const double* from = table.at(variable);
    const std::size_t count = entries_.count();
    if (entries_.all() && table.row == 1) {
        std::copy_n(from, count, out);
    } else if (entries_.all()) {
        for (std::size_t i = 0; i < count; ++i, from += table.row) out[i] = *from;
    } else {
        for (std::size_t i = 0; i < count; ++i) out[i] = from[entries_[i] * table.row];
    }
}

std::size_t Batch::take_terms(const Table& table, const std::uint8_t* mask) {
    entries_.choose(mask);
    const std::size_t count = entries_.count();
    for (const Load& load : program_.loads_) read(table, load.variable, columns_.out(load.out));
    std::size_t bad = columns_.terms(count);
    for (const std::size_t variable : columns_.unread()) {
        const double* from = table.at(variable);
        for (std::size_t i = 0; i < bad; ++i)
            if (std::isnan(from[entries_[i] * table.row])) bad = i;
    }
    if (bad < count) return entries_[bad];
    keep_inputs(table);
    return num();
}

void Batch::keep_inputs(const Table& table) {
    for (std::size_t variable = 0; variable < variables(); ++variable) {
        double* inputs = inputs_.data() + variable * num();
        if (entries_.all()) {
            read(table, variable, inputs);
        } else {
            for (std::size_t i = 0; i < entries_.count(); ++i)
                inputs[entries_[i]] = table.at(variable)[entries_[i] * table.row];
        }
    }
}

void Batch::choose_and_clear(const std::uint8_t* mask) {
    entries_.choose(mask);
    for (std::size_t variable = 0; variable < variables(); ++variable)
        for (std::size_t i = 0; i < entries_.count(); ++i)
            inputs_[variable * num() + entries_[i]] = 0.0;
}

void Batch::fields(Snapshot& s) { s.array(inputs_.data(), inputs_.size()); }

DiscreteBatch::DiscreteBatch(const std::vector<DiscreteRow>& rows, std::size_t terms,
                             std::size_t variables, const Observed& result, std::size_t num)
    : Batch(rows, terms, variables, result, num), samples_(num), results_(num, std::nan("")) {
    for (const Instruction& i : program_.formulas_) formulas_.push_back({i, {}});
    for (std::size_t entry = 0; entry < num; ++entry) {
        DiscreteMachine machine(rows, terms, variables, {result});
        auto memory = machine.memories_.begin();
        for (BatchInstruction& formula : formulas_)
            if (formula.instruction.memory != nullptr)
                formula.memories.push_back(std::move(*memory++));
    }
}

std::size_t DiscreteBatch::take(const Table& table, const std::uint8_t* mask) {
    if (const std::size_t bad = take_terms(table, mask); bad < num()) return bad;
    const std::size_t count = entries_.count();
    least_ = std::numeric_limits<std::int64_t>::max();
    for (std::size_t i = 0; i < count; ++i) least_ = std::min(least_, samples_[entries_[i]]);
    for (const BatchInstruction& formula : formulas_) {
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
                    out[i] = static_cast<DelayLine*>(memories[entries_[i]].get())->push(in[i]);
            });
    }
    const Observed& result = program_.observed_.front();
    const double* values = columns_.at(result.slot);
    for (std::size_t i = 0; i < count; ++i)
        if (++samples_[entries_[i]] > result.latency) results_[entries_[i]] = values[i];
    return num();
}

template <class Window>
void DiscreteBatch::push(const BatchInstruction& formula) {
    using F = typename Window::Fold;
    const Instruction& instruction = formula.instruction;
    const double* a = columns_.at(instruction.a);
    const double* b = columns_.at(instruction.b);
    double* out = columns_.out(instruction.out);
    const auto* memories = formula.memories.data();
    const std::size_t count = entries_.count();
    const auto push_to = [&](std::size_t i, typename F::Element x) {
        out[i] = F::result(static_cast<Window*>(memories[entries_[i]].get())->push(x));
    };
    if (least_ >= instruction.start) {
        for (std::size_t i = 0; i < count; ++i) push_to(i, F::element(a[i], b[i]));
    } else {
        for (std::size_t i = 0; i < count; ++i)
            push_to(i, samples_[entries_[i]] >= instruction.start ? F::element(a[i], b[i])
                                                                  : F::identity);
    }
}

void DiscreteBatch::reset(const std::uint8_t* mask) {
    choose_and_clear(mask);
    for (std::size_t i = 0; i < entries_.count(); ++i) {
        const std::uint32_t entry = entries_[i];
        samples_[entry] = 0;
        results_[entry] = std::nan("");
        for (const BatchInstruction& formula : formulas_)
            if (!formula.memories.empty()) formula.memories[entry]->reset();
    }
}

void DiscreteBatch::fields(Snapshot& s) {
    Batch::fields(s);
    s.counts(samples_.data(), num());
    s.array(results_.data(), num());
    for (const BatchInstruction& formula : formulas_)
        for (const auto& memory : formula.memories) memory->fields(s);
}

EpisodeBatch::EpisodeBatch(const episode::Program& program, std::size_t num)
    : Batch(program.terms, program.terms.size(), program.variables, {0, 0}, num), values_(num) {
    if (num == 0) throw std::invalid_argument("expected an entry, got none");
    const EpisodeMachine checked(program);
    fingerprint_ = fingerprint_of(checked.fingerprint(), num);
    episodes_ = batch::episodes_of(program, values_);
}

std::size_t EpisodeBatch::take(const Table& table, const std::uint8_t* mask) {
    if (const std::size_t bad = take_terms(table, mask); bad < num()) return bad;
    episodes_->take(entries_, inputs_.data(), columns_);
    return num();
}

void EpisodeBatch::take(const Table& table, const std::uint8_t* mask, const double* terms) {
    entries_.choose(mask);
    for (std::size_t slot = 0; slot < program_.registers().size(); ++slot)
        std::copy_n(terms + slot * num(), entries_.count(), columns_.out(slot));
    keep_inputs(table);
    episodes_->take(entries_, inputs_.data(), columns_);
}

void EpisodeBatch::reset(const std::uint8_t* mask) {
    choose_and_clear(mask);
    episodes_->reset(entries_);
}

void EpisodeBatch::finish(const std::uint8_t* mask, End end) {
    entries_.choose(mask);
    episodes_->finish(entries_, end);
}

void EpisodeBatch::fields(Snapshot& s) {
    Batch::fields(s);
    episodes_->fields(s);
}

}  // namespace rtamt
