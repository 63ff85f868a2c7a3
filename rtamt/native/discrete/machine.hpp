// Runs a program on samples, with a fixed latency for every register. The definition is
// rtamt/machines/discrete.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/intervals.hpp"
#include "discrete/instruction.hpp"

namespace rtamt {

// A register whose values run returns, `latency` samples late.
struct Observed {
    std::size_t slot;
    std::int64_t latency;
};

class DiscreteMachine {
public:
    // Rows are checked as far as memory needs it, as the program was verified in Python. The first
    // observed register is the result; the others are those whose values run returns.
    DiscreteMachine(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
                    const std::vector<Observed>& observed);
    // Runs terms alone.
    DiscreteMachine(const std::vector<DiscreteRow>& terms, std::size_t variables)
        : DiscreteMachine(terms, terms.size(), variables,
                          {{terms.empty() ? 0 : terms.size() - 1, 0}}) {}
    DiscreteMachine(const DiscreteMachine&) = delete;
    DiscreteMachine& operator=(const DiscreteMachine&) = delete;

    std::size_t variables() const { return variables_; }
    std::size_t observed() const { return observed_.size() - 1; }
    std::int64_t samples() const { return samples_; }
    const std::vector<double>& registers() const { return registers_; }
    const double* inputs() const { return inputs_; }  // of the last sample, if there was one
    std::uint64_t fingerprint() const { return fingerprint_; }  // of the program

    // Takes in one sample, whose variables the caller writes to pending() before. Returns false,
    // and changes nothing, if a variable or a term is nan.
    double* pending() { return pending_; }
    bool take();
    // Takes in a sample whose terms are known, `stride` apart in memory, in a program that has no
    // formulas.
    void take(const double* inputs, const double* terms, std::size_t stride);
    // The robustness at time t - latency; nan before there is one.
    double result() const;

    // Takes in n samples, or none if a variable or a term is nan. Returns the index of the first
    // such sample, or n. Writes n values of each observed register to outputs, one at each sample.
    std::size_t run(const double* const* columns, std::size_t n, double* const* outputs);
    // Writes the values of the observed registers at the times of a trace of n samples, which is
    // read from its end if `backwards`. Returns what run does.
    std::size_t evaluate(const double* const* columns, std::size_t n, bool backwards,
                         double* const* outputs) const;

    void reset();
    void fields(Snapshot& s);

private:
    class Block;
    class Trace;
    friend class Batch;
    friend class DiscreteBatch;
    friend class RegisterColumns;
    friend class TermRanges;

    void compile(const DiscreteRow& row, std::size_t terms);

    std::vector<double> registers_;
    std::vector<double> initial_;
    std::size_t variables_;
    std::vector<Load> loads_;
    std::vector<std::uint32_t> constants_;  // registers
    std::vector<Instruction> terms_;
    std::vector<Instruction> formulas_;
    std::vector<std::unique_ptr<Memory>> memories_;
    std::vector<Observed> observed_;
    std::vector<double> samples_in_;
    double* pending_;
    double* inputs_;
    std::int64_t samples_ = 0;
    std::uint64_t fingerprint_;
};

// The values that the terms of a program can have on a sample that is not known, or not exactly.
// The definition is rtamt/machines/terms.py.
class TermRanges {
public:
    TermRanges(const std::vector<DiscreteRow>& terms, std::size_t variables);

    std::size_t variables() const { return program_.variables(); }
    std::size_t terms() const { return ranges_.size(); }

    // Finds the ranges of all terms from the least and the greatest value of each variable, which
    // are `stride` apart. Returns false if a term has no value.
    bool find(const double* lower, const double* upper, std::ptrdiff_t stride);
    const Range& operator[](std::size_t term) const { return ranges_[term]; }

private:
    DiscreteMachine program_;
    std::vector<Range> ranges_;
};

}  // namespace rtamt
