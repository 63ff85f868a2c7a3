// Clamped windows inside a fold over times, in columns.
#pragma once

#include "batch/formula_columns.hpp"
#include "batch/slots.hpp"
#include "core/folds.hpp"

namespace rtamt::batch {

// A window inside a fold over times, which wants the least of clamp(window, best, worst) at its
// times (under Most everything is upside down).

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
        return {Order::most(x.seen, y.seen), Order::least(Order::most(y.seen, x.worst), y.worst)};
    }
    static double settled(Kept oldest, Element later) { return Order::most(later.seen, oldest); }
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

// Registers of the columns of one clamped window; at its fold's times, all its values.
struct ClampedWindow {
    std::size_t operand;
    std::size_t least;     // the clamped value if the window is -inf
    std::size_t greatest;  // .. if it is +inf
    Time hi;
    bool is_min;
    bool clamped_below;  // whether `least` is ever above -inf
    bool clamped_above;  // .. and `greatest` below +inf
};

// What a fold over the times begin to end has seen of its operand, in columns.
struct Seen {
    double* settled;  // the values that no sample will change
    double* now;      // .. and the values of open windows: if the trace ended now,
    double* best;     // if all unseen samples were the best,
    double* worst;    // .. and the worst
};

class WindowColumns {
public:
    virtual ~WindowColumns() = default;
    virtual void take(const Taken& taken, Time begin, Time end, const Seen& seen) = 0;
    virtual void reset(const Entries& entries) = 0;
    virtual void fields(Snapshot& s) = 0;
};

// A clamped window over the offsets 0 to hi, by one of the folds Clamps and Reaches.
template <class Order, class F>
class ClampedColumns final : public WindowColumns {
    using Element = typename F::Element;
    using Kept = typename F::Kept;

public:
    ClampedColumns(std::size_t num, const ClampedWindow& window)
        : window_(window),
          length_(static_cast<std::size_t>(window.hi)),
          since_begin_(1, num),
          elements_(1, num),
          folded_(1, num),
          delayed_(length_, num),
          ring_(length_, num) {}

    void take(const Taken& t, Time begin, Time end, const Seen& seen) override {
        find_elements(t, begin, end);
        const auto in = elements_.at(0);
        const auto folded = folded_.at(0);
        each_stretch(t.entries, t.places.together(),
                     [&](std::size_t entry, std::size_t i, std::size_t n) RTAMT_LOOP_BODY {
                         ring_.push(t.places.of(entry), entry, n, in.from(i), folded.from(i));
                     });
        if (t.first < window_.hi) fold_young(t);
        each_stretch(t.entries, t.places.together(),
                     [&](std::size_t entry, std::size_t i, std::size_t n) RTAMT_LOOP_BODY {
                         settle(t, entry, n, in.from(i), folded.from(i), seen);
                     });
    }

    void reset(const Entries& entries) override {
        if (entries.all()) {
            delayed_.clear();
            ring_.clear();
        }
        const auto since_begin = since_begin_.at(0);
        for (std::size_t i = 0; i < entries.count(); ++i) since_begin.put(entries[i], F::identity);
    }
    void fields(Snapshot& s) override {
        since_begin_.fields(s);
        delayed_.fields(s);
        ring_.fields(s);
    }

private:
    void find_elements(const Taken& t, Time begin, Time end) {
        constexpr bool kMin = Order::top > 0;
        const double* operand = t.columns.at(window_.operand);
        const double* best = t.columns.at(kMin ? window_.greatest : window_.least);
        const double* worst = t.columns.at(kMin ? window_.least : window_.greatest);
        const auto out = elements_.at(0);
        const std::size_t count = t.entries.count();
        widely([&]() RTAMT_LOOP_BODY {
            RTAMT_INDEPENDENT
            for (std::size_t i = 0; i < count; ++i)
                out.put(i, F::element(operand[i], best[i], worst[i]));
        });
        if (t.first >= begin && t.last <= end) return;
        for (std::size_t i = 0; i < count; ++i) {  // only windows that begin in time count
            const Time time = t.times[t.entries[i]];
            if (time < begin || time > end)
                out.put(i, F::element(operand[i], Order::top, Order::top));
        }
    }

    // The window of an entry that has just begun holds all its samples.
    void fold_young(const Taken& t) {
        const auto since_begin = since_begin_.at(0);
        const auto in = elements_.at(0);
        const auto folded = folded_.at(0);
        each_stretch(t.entries, true,
                     [&](std::size_t entry, std::size_t i, std::size_t n) RTAMT_LOOP_BODY {
                         const auto all = since_begin.from(entry), from = in.from(i);
                         const auto out = folded.from(i);
                         const std::int64_t* times = t.times + entry;
                         const Time hi = window_.hi;
                         RTAMT_INDEPENDENT
                         for (std::size_t j = 0; j < n; ++j) {
                             const Element x = F::combine(all[j], from[j]);
                             all.put_if(times[j] < hi, j, x);
                             out.put_if(times[j] < hi, j, x);
                         }
                     });
    }

    RTAMT_LOOP void settle(const Taken& t, std::size_t entry, std::size_t n, View<Element> in,
                           View<Element> folded, const Seen& seen) {
        const auto delayed =
            delayed_.at(static_cast<std::size_t>(t.places.of(entry) % length_), entry);
        double* settled = seen.settled + entry;
        double* now = seen.now + entry;
        double* best = seen.best + entry;
        double* worst = seen.worst + entry;
        const auto open = [&](std::size_t i, Element x) RTAMT_LOOP_BODY {
            now[i] = Order::least(now[i], F::now(x));
            best[i] = Order::least(best[i], F::best(x));
            worst[i] = Order::least(worst[i], F::worst(x));
        };
        if (t.first >= window_.hi) {
            RTAMT_INDEPENDENT
            for (std::size_t i = 0; i < n; ++i) {
                const Element x = folded[i];
                settled[i] = Order::least(settled[i], F::settled(delayed[i], x));
                delayed.put(i, F::kept(in[i]));
                open(i, x);
            }
            return;
        }
        const std::int64_t* times = t.times + entry;
        const Time hi = window_.hi;
        RTAMT_INDEPENDENT
        for (std::size_t i = 0; i < n; ++i) {
            const Element x = folded[i];
            const double whole = Order::least(settled[i], F::settled(delayed[i], x));
            settled[i] = times[i] >= hi ? whole : settled[i];
            delayed.put(i, F::kept(in[i]));
            open(i, x);
        }
    }

    ClampedWindow window_;
    std::size_t length_;
    Slots<Element> since_begin_;  // the fold of all elements of entries that have up to `length`
    Slots<Element> elements_;     // of the chosen entries, as are their folds
    Slots<Element> folded_;
    Slots<Kept> delayed_;  // what is kept of the last elements
    RingFold<F> ring_;
};

// A `most` window alone, over the offsets 0 to hi, in a fold over all times: the newest open window
// has seen the least.
template <class Order>
class ReachedColumns final : public WindowColumns {
public:
    ReachedColumns(std::size_t num, const ClampedWindow& window)
        : window_(window), folded_(1, num), ring_(static_cast<std::size_t>(window.hi) + 1, num) {}

    void take(const Taken& t, Time, Time, const Seen& seen) override {
        const double* operand = t.columns.at(window_.operand);
        const auto folded = folded_.at(0);
        each_stretch(t.entries, t.places.together(),
                     [&](std::size_t entry, std::size_t i, std::size_t n) RTAMT_LOOP_BODY {
                         ring_.push(t.places.of(entry), entry, n, operand + i, folded.from(i));
                     });
        each_stretch(t.entries, true,
                     [&](std::size_t entry, std::size_t i, std::size_t n) RTAMT_LOOP_BODY {
                         settle(t, entry, n, operand + i, folded.from(i), seen);
                     });
    }
    void reset(const Entries& entries) override {
        if (entries.all()) ring_.clear();
    }
    void fields(Snapshot& s) override { ring_.fields(s); }

private:
    RTAMT_LOOP void settle(const Taken& t, std::size_t entry, std::size_t n, const double* operand,
                           View<double> folded, const Seen& seen) {
        double* settled = seen.settled + entry;
        double* now = seen.now + entry;
        double* worst = seen.worst + entry;
        RTAMT_INDEPENDENT
        for (std::size_t i = 0; i < n; ++i) {
            now[i] = Order::least(now[i], operand[i]);
            worst[i] = Order::least(worst[i], operand[i]);
        }
        if (t.last < window_.hi) return;
        if (t.first >= window_.hi) {
            RTAMT_INDEPENDENT
            for (std::size_t i = 0; i < n; ++i) settled[i] = Order::least(settled[i], folded[i]);
            return;
        }
        const std::int64_t* times = t.times + entry;
        const Time hi = window_.hi;
        RTAMT_INDEPENDENT
        for (std::size_t i = 0; i < n; ++i) {
            const double whole = Order::least(settled[i], folded[i]);
            settled[i] = times[i] >= hi ? whole : settled[i];
        }
    }

    ClampedWindow window_;
    Slots<double> folded_;
    RingFold<Reached<Order>> ring_;
};

}  // namespace rtamt::batch
