// The values that the terms of a program can have on a sample that is not known, or not exactly. The
// definition is rtamt/machines/terms.py.
#pragma once

#include <cstddef>
#include <vector>

#include "core/intervals.hpp"
#include "discrete/machine.hpp"

namespace rtamt {

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
