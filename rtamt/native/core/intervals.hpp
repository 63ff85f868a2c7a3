// Interval arithmetic: which values a function of MAP can have where its operands are not known.
// The definitions are the rules in rtamt/program/algebra.py that FUNCTIONS names there; the results
// are equal bit for bit.
#pragma once

#include <cmath>
#include <limits>

#include "core/functions.hpp"

namespace rtamt {

// The values that a term can have.
struct Range {
    double lower;
    double upper;
    bool known = false;  // whether it reads no unknown sample, so that both are its value

    bool exists() const { return lower == lower; }
};

namespace intervals {

inline constexpr double kInf = std::numeric_limits<double>::infinity();
inline constexpr Range kEverything{-kInf, kInf};
inline constexpr Range kNothing{std::numeric_limits<double>::quiet_NaN(), 0.0};  // it has no value

using Function = double (*)(double, double);

inline Range opposite(const Range& x) { return {-x.upper, -x.lower}; }

// The range of two ends; everything if one is nan.
inline Range hull(double a, double b) {
    if (a != a || b != b) return kEverything;
    return {lesser(a, b), greater(a, b)};
}

// The range with each end one step further, but never of the other sign.
inline Range outward(const Range& x) {
    Range made = x;
    if (made.lower != 0.0 || negative(made.lower)) made.lower = std::nextafter(made.lower, -kInf);
    if (made.upper != 0.0 || !negative(made.upper)) made.upper = std::nextafter(made.upper, kInf);
    return made;
}

// A function that rises ('+') or falls ('-') with each operand.
template <Function f, char of_x, char of_y>
inline Range monotone(const Range& x, const Range& y) {
    const auto low = [](const Range& r, char direction) {
        return direction == '-' ? r.upper : r.lower;
    };
    const auto high = [](const Range& r, char direction) {
        return direction == '-' ? r.lower : r.upper;
    };
    return hull(f(low(x, of_x), low(y, of_y)), f(high(x, of_x), high(y, of_y)));
}

// A function that is monotone in each operand, whichever way.
template <Function f>
inline Range corners(const Range& x, const Range& y) {
    const Range low = hull(f(x.lower, y.lower), f(x.lower, y.upper));
    const Range high = hull(f(x.upper, y.lower), f(x.upper, y.upper));
    return {lesser(low.lower, high.lower), greater(low.upper, high.upper)};
}

// A function that rises, and has values from -0.0 on.
template <Function f>
inline Range from_zero(const Range& x) {
    if (x.upper < 0.0) return kNothing;
    const double lower = greater(x.lower, -0.0);
    return hull(f(lower, lower), f(x.upper, x.upper));
}

// -|x - y|, and 0.0 where they are equal.
inline Range near(const Range& x, const Range& y) {
    const Range d = hull(x.lower - y.upper, x.upper - y.lower);
    const double a = std::fabs(d.lower);
    const double b = std::fabs(d.upper);
    const double far = a < b ? b : a;
    const double close = d.lower <= 0.0 && d.upper >= 0.0 ? 0.0 : (a < b ? a : b);
    return {far == 0.0 ? 0.0 : -far, close == 0.0 ? 0.0 : -close};
}

// x == y without a margin.
inline Range meeting(const Range& x, const Range& y) {
    const bool always = x.lower == x.upper && x.upper == y.lower && y.lower == y.upper;
    const bool ever = x.lower <= y.upper && y.lower <= x.upper;
    return {always ? kInf : -kInf, ever ? kInf : -kInf};
}

// Whether a whole number lies in a range; both infinities count as whole.
inline bool has_whole(const Range& y) {
    return std::isinf(y.lower) || std::isinf(y.upper) || std::ceil(y.lower) <= y.upper;
}

// Whether a power is monotone on a range of bases some of which are negative or -0.0.
inline bool is_monotone_power(const Range& x, const Range& y) {
    const double n = y.lower;
    if (n != y.upper || !has_whole(y)) return false;
    if (!std::isinf(n) && std::fmod(n, 2.0) != 0.0)
        return n > 0.0 || negative(x.upper);  // an odd one jumps at 0 if it is negative
    return n == 0.0 || x.upper <= 0.0 || x.lower >= 0.0;
}

// The rule of each function. A function of one operand receives it twice.
inline Range neg(const Range& x, const Range&) { return opposite(x); }
inline Range abs(const Range& x, const Range&) {
    const double a = std::fabs(x.lower);
    const double b = std::fabs(x.upper);
    return {negative(x.lower) && !negative(x.upper) ? 0.0 : lesser(a, b), greater(a, b)};
}
inline Range sqrt(const Range& x, const Range&) { return from_zero<functions::sqrt>(x); }
inline Range exp(const Range& x, const Range&) {
    return outward(hull(functions::exp(x.lower, 0.0), functions::exp(x.upper, 0.0)));
}
inline Range ln(const Range& x, const Range&) {
    const Range made = from_zero<functions::ln>(x);
    return made.exists() ? outward(made) : made;
}
#define RTAMT_MONOTONE(name, of_x, of_y)                    \
    inline Range name(const Range& x, const Range& y) {     \
        return monotone<functions::name, of_x, of_y>(x, y); \
    }
RTAMT_MONOTONE(add, '+', '+')
RTAMT_MONOTONE(sub, '+', '-')
RTAMT_MONOTONE(min, '+', '+')
RTAMT_MONOTONE(max, '+', '+')
RTAMT_MONOTONE(at_least, '+', '-')
RTAMT_MONOTONE(above, '+', '-')
RTAMT_MONOTONE(ge, '+', '-')
RTAMT_MONOTONE(gt, '+', '-')
#undef RTAMT_MONOTONE
inline Range mul(const Range& x, const Range& y) { return corners<functions::mul>(x, y); }
inline Range div(const Range& x, const Range& y) {
    if (!y.known && y.lower <= 0.0 && y.upper >= 0.0) return kEverything;
    return corners<functions::div>(x, y);
}
inline Range pow(const Range& x, const Range& y) {
    Range base = x;
    if (negative(base.lower)) {
        if (base.lower > -kInf && !has_whole(y)) {  // a negative base has no such power
            if (base.upper < 0.0) return kNothing;
            base = {0.0, base.upper + 0.0};
        } else if (!is_monotone_power(base, y)) {
            return kEverything;
        }
    }
    return outward(corners<functions::pow>(base, y));
}
inline Range log(const Range& x, const Range& base) {
    const Range over = from_zero<functions::ln>(x);
    Range under = from_zero<functions::ln>(base);
    if (!over.exists() || !under.exists()) return kNothing;
    if (!base.known && under.lower <= 0.0 && under.upper >= 0.0) return kEverything;
    const Range exact = outward(corners<functions::div>(over, under));
    // A step of the logarithm may be more than one of the quotient.
    if (!base.known) under = outward(under);
    const Range stepped = corners<functions::div>(outward(over), under);
    return {lesser(exact.lower, stepped.lower), greater(exact.upper, stepped.upper)};
}
inline Range equal(const Range& x, const Range& y) { return near(x, y); }
inline Range unequal(const Range& x, const Range& y) { return opposite(near(x, y)); }
inline Range nonnegative(const Range& x, const Range&) { return {x.lower + 0.0, x.upper + 0.0}; }
inline Range eq(const Range& x, const Range& y) { return meeting(x, y); }
inline Range ne(const Range& x, const Range& y) { return opposite(meeting(x, y)); }

// The values of a function; none if it has none, or is nan for known operands.
template <Function f, Range (*rule)(const Range&, const Range&)>
inline Range range_of(const Range& x, const Range& y) {
    if (!x.known || !y.known) return rule(x, y);
    const double value = f(x.lower, y.lower);
    return {value, value, true};
}

}  // namespace intervals
}  // namespace rtamt
