#include "discrete/ranges.hpp"

#include <cstdint>

namespace rtamt {
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
    : program_(terms, variables),
      ranges_(terms.size()) {
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
