// A window inside a fold over times, which wants the least of clamp(window, best, worst) at its
// times (under Most everything is upside down).
#pragma once

#include "core/folds.hpp"

namespace rtamt::batch {

struct Least {
    static constexpr double top = kInfinity;  // the best
    static double least(double x, double y) { return lesser(x, y); }
    static double most(double x, double y) { return greater(x, y); }
};
struct Most {
    static constexpr double top = -kInfinity;
    static double least(double x, double y) { return greater(x, y); }
    static double most(double x, double y) { return lesser(x, y); }
};

// The fold of some times, and of what the windows that begin there have seen: the value if all that
// they will still see is the best, or the worst; and what they have seen in common. The window is a
// `least` itself (kSame), or a `most`.
template <class Order, bool kSame>
struct Clamps {
    struct Element {
        double seen;
        double best;
        double worst;
    };
    static constexpr Element identity{kSame ? Order::top : -Order::top, Order::top, Order::top};
    // What is kept of a time until its window is whole.
    struct Kept {
        double best;
        double worst;
    };
    static Kept kept(Element x) { return {x.best, x.worst}; }

    static double clamp(double x, double best, double worst) {
        return Order::most(Order::least(x, best), worst);
    }
    // Of one time, when its window has seen x.
    static Element element(double x, double best, double worst) {
        const double now = clamp(x, best, worst);
        return {x, kSame ? now : best, kSame ? worst : now};
    }
    static Element combine(Element x, Element y) {  // the older element is the left one
        const double reached = clamp(y.seen, x.best, x.worst);
        if constexpr (kSame) {
            return {Order::least(x.seen, y.seen), Order::least(reached, y.best),
                    Order::least(x.worst, y.worst)};
        } else {
            return {Order::most(x.seen, y.seen), Order::least(x.best, y.best),
                    Order::least(reached, y.worst)};
        }
    }
    // The value of a time when its window is whole, from the fold of the later times of the window.
    static double settled(Kept oldest, Element later) {
        return clamp(later.seen, oldest.best, oldest.worst);
    }
    static double now(Element x) { return kSame ? x.best : x.worst; }
    static double best(Element x) { return x.best; }
    static double worst(Element x) { return x.worst; }
};

// The same where the window is a `most` and the best is always the top, as in `always(p implies
// eventually[0:5] q)`.
template <class Order>
struct Reaches {
    struct Element {
        double seen;
        double worst;
    };
    static constexpr Element identity{-Order::top, Order::top};
    using Kept = double;
    static Kept kept(Element x) { return x.worst; }

    static Element element(double x, double, double worst) { return {x, Order::most(x, worst)}; }
    static Element combine(Element x, Element y) {
        return {Order::most(x.seen, y.seen),
                Order::least(Order::most(y.seen, x.worst), y.worst)};
    }
    static double settled(Kept oldest, Element later) {
        return Order::most(later.seen, oldest);
    }
    static double now(Element x) { return x.worst; }
    static double best(Element) { return Order::top; }
    static double worst(Element x) { return x.worst; }
};

// The fold of a `most` window alone.
template <class Order>
struct Reached {
    using Element = double;
    static constexpr Element identity = -Order::top;
    static Element combine(Element x, Element y) { return Order::most(x, y); }
};

}  // namespace rtamt::batch
