// How traces end, and what bounds say then.
#pragma once

#include "core/order.hpp"

namespace rtamt {

// How a trace ends: with nothing after it, at a time that no one chose, or as a mere beginning.
enum class End { complete, cut, open };

// 1 if bounds say that a specification is satisfied, -1 if violated, else 0.
inline int verdict_of(double lower, double upper) {
    return negative(upper) ? -1 : !negative(lower);
}

// The robustness, or the bound that is nearest to it.
inline double moved(double robustness, double lower, double upper) {
    return alone::greater(lower, alone::lesser(robustness, upper));
}

}  // namespace rtamt
