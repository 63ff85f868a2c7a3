// The registers of a program as columns: their values at many samples, or in many entries.
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
          memory_(column_memory(program.initial_.size() * size)),
          at_(program.initial_.size()),
          out_(program.initial_.size()) {
        for (std::size_t slot = 0; slot < at_.size(); ++slot) {
            write_to(slot, nullptr);
            std::fill_n(out(slot), size, program.initial_[slot]);
        }
        // A nan goes through all functions but pow: it is looked for where no other term reads it.
        std::vector<bool> passed_on(at_.size());
        for (const Instruction& term : program.terms_)
            if (term.opcode != Opcode::map_pow) passed_on[term.a] = passed_on[term.b] = true;
        std::vector<bool> read(program.variables());
        for (const Load& load : program.loads_) {
            read[load.variable] = true;
            if (!passed_on[load.out]) checked_.push_back(load.out);
        }
        for (const Instruction& term : program.terms_)
            if (!passed_on[term.out]) checked_.push_back(term.out);
        for (std::size_t v = 0; v < read.size(); ++v)
            if (!read[v]) unread_.push_back(v);
    }

    std::size_t size() const { return size_; }
    const double* at(std::size_t slot) const { return at_[slot]; }
    double* out(std::size_t slot) { return out_[slot]; }
    // Writes a register to a column elsewhere; nullptr: to its own again.
    void write_to(std::size_t slot, double* column) {
        at_[slot] = out_[slot] = column != nullptr ? column : memory_.get() + slot * size_;
    }
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
        for (const Load& load : program_.loads_) point(load.out, columns[load.variable] + from);
        return terms(first_unread(columns, from, count));
    }
    // The same with copies of the variables, so that all registers stand side by side.
    std::size_t copied_terms(const double* const* columns, std::size_t from, std::size_t count) {
        for (const Load& load : program_.loads_)
            std::copy_n(columns[load.variable] + from, count, out(load.out));
        return terms(first_unread(columns, from, count));
    }
    // The index of the first nan of a variable that no term reads, or count.
    std::size_t first_unread(const double* const* columns, std::size_t from,
                             std::size_t count) const {
        for (const std::size_t v : unread_) count = columns::first_nan(columns[v] + from, count);
        return count;
    }
    // The variables that no term reads.
    const std::vector<std::size_t>& unread() const { return unread_; }
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
        for (const std::size_t slot : checked_) count = columns::first_nan(at(slot), count);
        return count;
    }

private:
    const DiscreteMachine& program_;
    std::size_t size_;
    ColumnMemory memory_;
    std::vector<const double*> at_;
    std::vector<double*> out_;
    std::vector<std::size_t> checked_;  // registers
    std::vector<std::size_t> unread_;   // variables
};

}  // namespace rtamt
