// The functions of MAP by name. The definitions are FUNCTIONS in rtamt/program/algebra.py; the
// results are equal bit for bit.
#pragma once

#include <cmath>
#include <limits>

#include "core/order.hpp"

// name, arity, value of x and y. A function of one operand receives it twice. No function throws,
// and a nan in an operand gives nan, so that the machine finds it.
#define RTAMT_FUNCTIONS(X)                              \
    X(neg, 1, -x)                                       \
    X(abs, 1, std::fabs(x))                             \
    X(sqrt, 1, std::sqrt(x))                            \
    X(exp, 1, std::exp(x))                              \
    X(ln, 1, std::log(x))                               \
    X(add, 2, x + y)                                    \
    X(sub, 2, x - y)                                    \
    X(mul, 2, x* y)                                     \
    X(div, 2, x / y)                                    \
    X(pow, 2, std::pow(x, y))                           \
    X(log, 2, std::log(x) / std::log(y))                \
    X(min, 2, lesser(x, y))                             \
    X(max, 2, x != x || y != y ? x + y : greater(x, y)) \
    X(at_least, 2, (x - y) + 0.0)                       \
    X(above, 2, -((y - x) + 0.0))                       \
    X(equal, 2, nearness(x, y))                         \
    X(unequal, 2, -nearness(x, y))                      \
    X(nonnegative, 1, x + 0.0)                          \
    X(ge, 2, holds(x >= y, x, y))                       \
    X(gt, 2, holds(x > y, x, y))                        \
    X(eq, 2, holds(x == y, x, y))                       \
    X(ne, 2, holds(x != y, x, y))

namespace rtamt::functions {

// The robustness of a comparison without a margin: +inf if it holds, else -inf.
inline double holds(bool comparison, double x, double y) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    if (x != x || y != y) return std::numeric_limits<double>::quiet_NaN();
    return comparison ? inf : -inf;
}

// -|x - y|, and 0.0 where they are equal. Not written so: GCC 12 takes 0.0 - |z| for -|z|, which is
// -0.0 there.
inline double nearness(double x, double y) {
    const double above = (x - y) + 0.0;
    const double below = (y - x) + 0.0;
    return below < above ? below : above;
}

#define RTAMT_DEFINE(name, arity, value) \
    inline double name([[maybe_unused]] double x, [[maybe_unused]] double y) { return value; }
RTAMT_FUNCTIONS(RTAMT_DEFINE)
#undef RTAMT_DEFINE

}  // namespace rtamt::functions
