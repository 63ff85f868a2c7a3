// Folds of the last elements of every lane. Elements are columns, one for each of their numbers.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

#include "core/columns.hpp"
#include "core/folds.hpp"
#include "core/snapshot.hpp"

// Says of the next loop that its rounds do not read what others write.
#if defined(__clang__)
#define RTAMT_INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define RTAMT_INDEPENDENT _Pragma("GCC ivdep")
#else
#define RTAMT_INDEPENDENT __pragma(loop(ivdep))
#endif

namespace rtamt::lockstep {

// Numbers, 0.0 at first. The operating system gives the memory when it is first written to.
class Numbers {
public:
    explicit Numbers(std::size_t size) : size_(size) { clear(); }
    void clear() {
        data_.reset(static_cast<double*>(std::calloc(size_ + 1, sizeof(double))));
        if (!data_) throw std::bad_alloc();
    }
    double* data() { return data_.get(); }
    const double* data() const { return data_.get(); }

    void fields(Snapshot& s) {
        s.array(data(), size_);
        s.require(columns::first_nan(data(), size_) == size_);
    }

private:
    struct Free {
        void operator()(double* data) const { std::free(data); }
    };
    std::size_t size_;
    std::unique_ptr<double[], Free> data_;
};

// A window inside a fold over all times: at the times of the fold, clamp(window, best, worst), the
// least of which is wanted (under Order = Least; under Most everything is upside down). Numbers of
// an element: the fold of its part of the window's operand; the value if all that the window will
// still see is best, or worst. The window is a `least` itself (kSame), or a `most`.
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

struct Clamped {
    double seen;
    double best;
    double worst;
};

template <class Order, bool kSame>
struct Clamps {
    static constexpr std::size_t width = 3;
    static constexpr Clamped identity{kSame ? Order::top : -Order::top, Order::top, Order::top};

    static double clamp(double x, double best, double worst) {
        return Order::most(Order::least(x, best), worst);
    }
    // What the clamped window is after its first element.
    static Clamped element(double x, double best, double worst) {
        const double now = clamp(x, best, worst);
        return {x, kSame ? now : best, kSame ? worst : now};
    }
    static Clamped combine(Clamped x, Clamped y) {  // the older element is the left one
        const double reached = clamp(y.seen, x.best, x.worst);
        if constexpr (kSame) {
            return {Order::least(x.seen, y.seen), Order::least(reached, y.best),
                    Order::least(x.worst, y.worst)};
        } else {
            return {Order::most(x.seen, y.seen), Order::least(x.best, y.best),
                    Order::least(reached, y.worst)};
        }
    }
    // The value of the oldest element of a window over all times, when the window is whole.
    static double settled(Clamped oldest, Clamped window) {
        return clamp(window.seen, oldest.best, oldest.worst);
    }
    // What it would be if the trace ended now.
    static double now(Clamped x) { return kSame ? x.best : x.worst; }
};

// Columns of elements, in slots.
class Slots {
public:
    Slots(std::size_t slots, std::size_t num) : num_(num), numbers_(3 * slots * num) {}

    struct View {
        double* seen;
        double* best;
        double* worst;

        Clamped operator[](std::size_t i) const { return {seen[i], best[i], worst[i]}; }
        void put(std::size_t i, Clamped x) const {
            seen[i] = x.seen;
            best[i] = x.best;
            worst[i] = x.worst;
        }
    };
    View at(std::size_t slot, std::size_t lane) {
        double* start = numbers_.data() + 3 * slot * num_ + lane;
        return {start, start + num_, start + 2 * num_};
    }
    void clear() { numbers_.clear(); }
    void fields(Snapshot& s) { numbers_.fields(s); }

private:
    std::size_t num_;
    Numbers numbers_;
};

// The fold of the last `length` elements of every lane, 1 or more: SlidingWindow in columns. What
// it gives is right for lanes that have pushed so many, whatever the slots held before: a lane that
// begins anew clears nothing.
template <class F>
class RingFold {
public:
    RingFold(std::size_t length, std::size_t num)
        : block_(length / 2), ahead_(1 - length % 2), num_(num), slots_(2 * block_ + 4, num) {
        clear();
    }
    void clear() {
        slots_.clear();
        const auto identity = slots_.at(kIdentity, 0);
        for (std::size_t i = 0; i < num_; ++i) identity.put(i, F::identity);
    }

    // Pushes an element of n lanes from `lane` on, which have one place.
    void push(std::uint64_t place, std::size_t lane, std::size_t n, Slots::View in,
              Slots::View out) {
        if (block_ == 0) {
            for (std::size_t i = 0; i < n; ++i) out.put(i, in[i]);
            return;
        }
        const auto offset = static_cast<std::size_t>(place % block_);
        const std::size_t half = place / block_ % 2 * block_;
        const auto slot = [&](std::size_t k) { return slots_.at(kBlocks + k, lane); };
        const auto front = slot(half + offset);
        const auto oldest = offset + ahead_ == block_ ? slots_.at(kIdentity, lane)
                                                      : slot(half + offset + ahead_);
        const auto back = slot(block_ - half + (block_ - 1 - offset));
        const auto middle = slots_.at(kMiddle, lane);
        const auto prefix = slots_.at(kPrefix, lane);
        const auto suffix = slots_.at(kSuffix, lane);
        const auto run = [&]<bool kFresh>() {
            RTAMT_INDEPENDENT
            for (std::size_t i = 0; i < n; ++i) {
                const Clamped x = in[i];
                const Clamped first = oldest[i];
                front.put(i, x);
                const Clamped last = kFresh ? back[i] : F::combine(back[i], suffix[i]);
                back.put(i, last);
                suffix.put(i, last);
                const Clamped full = kFresh ? prefix[i] : middle[i];
                if (kFresh) middle.put(i, full);
                const Clamped newest = kFresh ? x : F::combine(prefix[i], x);
                prefix.put(i, newest);
                out.put(i, F::combine(F::combine(first, full), newest));
            }
        };
        offset == 0 ? run.template operator()<true>() : run.template operator()<false>();
    }

    void fields(Snapshot& s) { slots_.fields(s); }

private:
    static constexpr std::size_t kIdentity = 0, kMiddle = 1, kPrefix = 2, kSuffix = 3, kBlocks = 4;

    std::size_t block_;
    std::size_t ahead_;
    std::size_t num_;
    Slots slots_;
};

}  // namespace rtamt::lockstep
