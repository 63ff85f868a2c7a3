// The values that the terms of a program can have on a sample that is not known, or not exactly. The
// definition is rtamt/program/ranges.py.
#pragma once

#include <cstddef>
#include <vector>

#include "core/intervals.hpp"
#include "discrete/machine.hpp"

namespace rtamt {

class TermRanges {
public:
    TermRanges(const std::vector<DiscreteRow>& terms, std::size_t variables)
        : program_(terms, terms.size(), variables, {{terms.empty() ? 0 : terms.size() - 1, 0}}),
          ranges_(terms.size()) {
        for (const std::uint32_t slot : program_.constants_) {
            const double value = program_.initial_[slot];
            ranges_[slot] = {value, value, true};
        }
    }

    std::size_t variables() const { return program_.variables(); }
    std::size_t terms() const { return ranges_.size(); }

    // Finds the ranges of all terms from the least and the greatest value of each variable, which
    // are `stride` apart. Returns false if a term has no value.
    bool find(const double* lower, const double* upper, std::ptrdiff_t stride) {
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
    const Range& operator[](std::size_t term) const { return ranges_[term]; }

private:
    static Range found(Opcode opcode, const Range& x, const Range& y) {
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

    DiscreteMachine program_;
    std::vector<Range> ranges_;
};

}  // namespace rtamt
