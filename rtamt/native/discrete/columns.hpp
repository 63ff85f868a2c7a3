// The registers of a program as columns: their values at many samples, or in many lanes.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "core/columns.hpp"
#include "discrete/machine.hpp"

namespace rtamt {

class RegisterColumns {
public:
    RegisterColumns(const DiscreteMachine& program, std::size_t size)
        : program_(program),
          size_(size),
          memory_(std::make_unique_for_overwrite<double[]>(program.initial_.size() * size)),
          at_(program.initial_.size()) {
        for (std::size_t slot = 0; slot < at_.size(); ++slot) {
            at_[slot] = out(slot);
            std::fill_n(out(slot), size, program.initial_[slot]);
        }
    }

    std::size_t size() const { return size_; }
    const double* at(std::size_t slot) const { return at_[slot]; }
    double* out(std::size_t slot) { return memory_.get() + slot * size_; }
    // Reads a register from a column elsewhere.
    void point(std::size_t slot, const double* column) { at_[slot] = column; }

    void map(const Instruction& instruction, std::size_t count) {
        dispatch(
            instruction.opcode,
            [&]<double (*function)(double, double)> {
                columns::map<function>(at(instruction.a), at(instruction.b), out(instruction.out),
                                       count);
            },
            []<class Window> {}, [] {});
    }
    // Evaluates the terms of samples that are columns of their own. Returns the index of the first
    // nan, of a variable or a term, or count.
    std::size_t terms(const double* const* columns, std::size_t from, std::size_t count) {
        std::size_t first = count;
        for (std::size_t v = 0; v < program_.variables(); ++v)
            first = columns::first_nan(columns[v] + from, first);
        for (const Load& load : program_.loads_) point(load.out, columns[load.variable] + from);
        return std::min(first, terms(count));
    }
    // The index of the first of n samples with a nan, or n.
    std::size_t first_refused(const double* const* columns, std::size_t n) {
        for (std::size_t from = 0; from < n; from += size_) {
            const std::size_t count = std::min(size_, n - from);
            const std::size_t bad = terms(columns, from, count);
            if (bad < count) return from + bad;
        }
        return n;
    }

    // Evaluates the terms from the variables. Returns the index of the first nan, or count.
    std::size_t terms(std::size_t count) {
        for (const Instruction& term : program_.terms_) map(term, count);
        std::size_t first = count;
        for (const Load& load : program_.loads_) first = columns::first_nan(at(load.out), first);
        for (const Instruction& term : program_.terms_)
            first = columns::first_nan(at(term.out), first);
        return first;
    }

private:
    const DiscreteMachine& program_;
    std::size_t size_;
    std::unique_ptr<double[]> memory_;
    std::vector<const double*> at_;
};

}  // namespace rtamt
