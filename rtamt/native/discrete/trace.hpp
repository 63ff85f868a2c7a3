// Folds of windows over a whole trace, block after block. As nothing is waited for, a block costs
// what its loops cost; the windows of monitors bound each single push instead.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>
#include <vector>

#include "core/arrays.hpp"
#include "core/widest.hpp"
#include "core/windows.hpp"

namespace rtamt::trace {

// Two columns of operands, or one to which both pointers point, at n times; those outside of begin
// and end are outside of the trace.
struct Operands {
    const double* a;
    const double* b;
    std::size_t n;
    std::size_t begin;
    std::size_t end;
};

// The memory of one instruction.
class Memory {
public:
    Memory() = default;
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    virtual ~Memory() = default;

    virtual void push(const Operands& in, double* out) = 0;
};

// A fold that the windows of monitors do as fast: it pushes the operands into one of those.
template <class Window>
class Pushed final : public Memory {
public:
    using F = typename Window::Fold;

    template <class... Args>
    explicit Pushed(Args... args) : window_(args...) {}

    void push(const Operands& in, double* out) override {
        identities(out, 0, in.begin);
        if (in.end > in.begin)
            window_.push(in.a + in.begin, in.b + in.begin, out + in.begin, in.end - in.begin);
        identities(out, std::max(in.begin, in.end), in.n);
    }

private:
    void identities(double* out, std::size_t from, std::size_t to) {
        for (; from < to; ++from) out[from] = F::result(window_.push(F::identity));
    }

    Window window_;
};

class Delayed final : public Memory {
public:
    explicit Delayed(std::size_t length) : line_(length) {}
    void push(const Operands& in, double* out) override { line_.push(in.a, out, in.n); }

private:
    DelayLine line_;
};

// The least, or greatest, element so far. A new one is rare: most chunks are compared and filled.
template <class F>
class Extreme final : public Memory {
public:
    void push(const Operands& in, double* out) override {
        std::fill_n(out, in.begin, total_);
        std::size_t at = in.begin;
        while (at < in.end) {
            const std::size_t count = std::min(kChunk, in.end - at);
            const double* x = in.a + at;
            const double total = fold<F>(total_, {x, x}, count);
            if (same(total, total_)) {
                std::fill_n(out + at, count, total_);
            } else {
                for (std::size_t i = 0; i < count; ++i)
                    out[at + i] = total_ = F::combine_alone(total_, x[i]);
            }
            at += count;
        }
        std::fill_n(out + at, in.n - at, total_);
    }

private:
    static constexpr std::size_t kChunk = 64;

    double total_ = F::identity;
};

template <class F>
RTAMT_LOOP void combine(const double* __restrict xp, const double* __restrict xq,
                        const double* __restrict yp, const double* __restrict yq,
                        double* __restrict p, double* __restrict q, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        put<F>(p, q, i, F::combine(get<F>(xp, xq, i), get<F>(yp, yq, i)));
}

// What two calls of combine would do, the second of which combines elements twice as far apart.
template <class F>
RTAMT_LOOP void combine_four(const double* __restrict xp, const double* __restrict xq,
                             std::size_t apart, double* __restrict p, double* __restrict q,
                             std::size_t n) {
    const auto pair = [=](std::size_t i) {
        return F::combine(get<F>(xp, xq, i), get<F>(xp, xq, i + apart));
    };
    for (std::size_t i = 0; i < n; ++i)
        put<F>(p, q, i, F::combine(pair(i), pair(i + 2 * apart)));
}

template <class F>
RTAMT_LOOP void combine_results(const double* __restrict xp, const double* __restrict xq,
                                const double* __restrict yp, const double* __restrict yq,
                                double* __restrict out, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        out[i] = F::result(F::combine(get<F>(xp, xq, i), get<F>(yp, yq, i)));
}

// The least or greatest of elements among which there is no -0.0: one comparison for each.
template <class F>
struct WithoutMinusZero : F {
    static double combine(double x, double y) {
        if constexpr (F::identity > 0) {
            return y < x ? y : x;
        } else {
            return y > x ? y : x;
        }
    }
};

RTAMT_LOOP void copy_and_find_minus_zero(const double* __restrict in, double* __restrict out,
                                         std::size_t n, bool* found) {
    std::uint64_t zeros = 0;
    for (std::size_t i = 0; i < n; ++i) {
        out[i] = in[i];
        zeros |= bits_of(in[i]) == bits_of(-0.0) ? 1u : 0u;
    }
    *found = zeros != 0;
}

// A window of 2 elements or more, but not very many: windows of 2, 4, 8, ... elements are made from
// two of half that length, and the last from two that overlap, as folding an element twice changes
// nothing.
template <class F>
class Doubled final : public Memory {
public:
    Doubled(std::size_t length, std::size_t most)
        : length_(length),
          clean_(length - 1),
          lines_{Line(length + most), Line(length + most), Line(length + most)} {
        Line& raw = lines_[0];
        for (std::size_t i = 0; i + 1 < length; ++i) put<F>(raw.p(), raw.q(), i, F::identity);
    }

    void push(const Operands& in, double* out) override {
        const std::size_t before = length_ - 1;
        Line& raw = lines_[0];
        take(in, raw.p() + before, raw.q() + before);
        if constexpr (F::width == 1) {
            if (clean_ >= length_ - 1 + in.n) {
                fold<WithoutMinusZero<F>>(out, in.n);
            } else {
                fold<F>(out, in.n);
            }
        } else {
            fold<F>(out, in.n);
        }
        raw.keep(in.n, before);
    }

private:
    class Line {
    public:
        explicit Line(std::size_t n)
            : size_((n + 7) / 8 * 8), memory_(column_memory(F::width * size_)) {}
        double* p() { return memory_.get(); }
        double* q() { return memory_.get() + (F::width - 1) * size_; }
        Elements elements() { return {p(), q()}; }
        // Moves n elements from a place to the begin.
        void keep(std::size_t from, std::size_t n) {
            std::memmove(p(), p() + from, n * sizeof(double));
            if (F::width == 2) std::memmove(q(), q() + from, n * sizeof(double));
        }

    private:
        std::size_t size_;
        ColumnMemory memory_;
    };

    // Writes the folds of the n windows of the first line.
    template <class G>
    void fold(double* out, std::size_t n) {
        std::size_t size = 1;
        std::size_t count = length_ - 1 + n;
        Elements from = lines_[0].elements();
        int to = 1;
        for (; 4 * size < length_; size *= 4, to = 3 - to) {
            count -= 3 * size;
            widest<combine_four<G>>(from.p, from.q, size, lines_[to].p(), lines_[to].q(), count);
            from = lines_[to].elements();
        }
        for (; 2 * size < length_; size *= 2, to = 3 - to) {
            count -= size;
            const Elements next = from + size;
            widest<combine<G>>(from.p, from.q, next.p, next.q, lines_[to].p(), lines_[to].q(),
                               count);
            from = lines_[to].elements();
        }
        const Elements last = from + (length_ - size);
        widest<combine_results<G>>(from.p, from.q, last.p, last.q, out, n);
    }

    void take(const Operands& in, double* p, double* q) {
        const auto identities = [&](std::size_t from, std::size_t to) {
            for (; from < to; ++from) put<F>(p, q, from, F::identity);
        };
        identities(0, in.begin);
        bool minus_zero = false;
        if (in.end > in.begin) {
            const std::size_t inside = in.end - in.begin;
            if constexpr (F::width == 1) {
                widest<copy_and_find_minus_zero>(in.a + in.begin, p + in.begin, inside,
                                                 &minus_zero);
            } else {
                std::copy_n(in.a + in.begin, inside, p + in.begin);
                std::copy_n(in.b + in.begin, inside, q + in.begin);
            }
        }
        clean_ = minus_zero ? 0 : clean_ + in.n;
        identities(std::max(in.begin, in.end), in.n);
    }

    std::size_t length_;
    std::size_t clean_;  // at least as many of the last elements are not -0.0
    Line lines_[3];
};

}  // namespace rtamt::trace
