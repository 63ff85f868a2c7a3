// The lattice folds of WINDOW by name. The definitions are FOLDS in rtamt/program/algebra.py; the
// results are equal bit for bit.
#pragma once

#include <limits>

#include "core/order.hpp"

#define RTAMT_FOLDS(X)  \
    X(min, Min)         \
    X(max, Max)         \
    X(until, Until)     \
    X(release, Release) \
    X(since, Since)     \
    X(trigger, Trigger)

namespace rtamt {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

enum class Kind { single, ahead, back };

// A fold has elements of one or two numbers, never nan, of which the last is the result. The older
// element is the left one in combine. Outside of loops over arrays combine_alone is faster.
template <double (*Lower)(double, double), int Sign>
struct Single {
    using Element = double;
    static constexpr Kind kind = Kind::single;
    static constexpr int width = 1;
    static constexpr Element identity = Sign * kInfinity;
    static Element element(double x, double) { return x; }
    static double result(Element x) { return x; }
    static Element combine(Element x, Element y) { return Lower(x, y); }
    static Element combine_alone(Element x, Element y) { return kAlone<Lower>(x, y); }
};

struct Pair {
    double p;
    double q;
};

template <double (*Lower)(double, double), double (*Upper)(double, double), int Sign>
struct Paired {
    using LowerFold = Single<Lower, Sign>;
    using UpperFold = Single<Upper, -Sign>;
    using Element = Pair;
    static constexpr int width = 2;
    static constexpr Element identity{Sign * kInfinity, -Sign * kInfinity};
    static Element element(double p, double q) { return {p, q}; }
    static double result(Element x) { return x.q; }
};

template <double (*Lower)(double, double), double (*Upper)(double, double), int Sign>
struct Ahead : Paired<Lower, Upper, Sign> {
    static constexpr Kind kind = Kind::ahead;
    template <auto lower, auto upper>
    static Pair combined(Pair x, Pair y) {
        return {lower(x.p, y.p), upper(x.q, lower(x.p, y.q))};
    }
    static Pair combine(Pair x, Pair y) { return combined<Lower, Upper>(x, y); }
    static Pair combine_alone(Pair x, Pair y) {
        return combined<kAlone<Lower>, kAlone<Upper>>(x, y);
    }
};

template <double (*Lower)(double, double), double (*Upper)(double, double), int Sign>
struct Back : Paired<Lower, Upper, Sign> {
    using Mirror = Ahead<Lower, Upper, Sign>;
    static constexpr Kind kind = Kind::back;
    static Pair combine(Pair x, Pair y) { return Mirror::combine(y, x); }
    static Pair combine_alone(Pair x, Pair y) { return Mirror::combine_alone(y, x); }
};

using Min = Single<lesser, 1>;
using Max = Single<greater, -1>;
using Until = Ahead<lesser, greater, 1>;
using Release = Ahead<greater, lesser, -1>;
using Since = Back<lesser, greater, 1>;
using Trigger = Back<greater, lesser, -1>;

}  // namespace rtamt
