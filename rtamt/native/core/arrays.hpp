// Folds over arrays. Elements that are pairs stand in two arrays; single numbers in one, which is
// named twice.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/folds.hpp"

#if defined(__SSE2__) || defined(_M_X64)
#include <emmintrin.h>
#endif

namespace rtamt {

struct Elements {
    const double* p;
    const double* q;

    Elements operator+(std::size_t n) const { return {p + n, q + n}; }
};

template <class M>
inline typename M::Element get(const double* p, const double* q, std::size_t i) {
    return M::element(p[i], q[i]);
}

template <class M>
inline void put(double* p, double* q, std::size_t i, typename M::Element x) {
    if constexpr (M::width == 1) {
        p[i] = x;
    } else {
        p[i] = x.p;
        q[i] = x.q;
    }
}

template <class M>
constexpr double component(typename M::Element x, int k) {
    if constexpr (M::width == 1) {
        return x;
    } else {
        return k == 0 ? x.p : x.q;
    }
}

// Memory that grows with what is asked of it and never shrinks.
class Scratch {
public:
    double* room(std::size_t n) {
        if (memory_.size() < n) memory_.resize(std::max(n, 2 * memory_.size()));
        return memory_.data();
    }

private:
    std::vector<double> memory_;
};

// The same for elements of a monoid.
template <class M>
struct Room {
    Room(Scratch& first, Scratch& second, std::size_t n)
        : p(first.room(n)), q(M::width == 1 ? p : second.room(n)) {}

    Elements elements() const { return {p, q}; }

    double* p;
    double* q;
};

// out[i] is the fold of the elements 0 to i.
template <class M>
inline void prefixes(Elements in, std::size_t n, const Room<M>& out) {
    auto total = M::identity;
    for (std::size_t i = 0; i < n; ++i) {
        total = M::combine(total, get<M>(in.p, in.q, i));
        put<M>(out.p, out.q, i, total);
    }
}

// out[i] is the fold of the elements i to n - 1, for i from `begin` on, and of `last`.
template <class M>
inline void suffixes(Elements in, std::size_t begin, std::size_t n, typename M::Element last,
                     const Room<M>& out) {
    auto total = last;
    for (std::size_t i = n; i-- > begin;) {
        total = M::combine(get<M>(in.p, in.q, i), total);
        put<M>(out.p, out.q, i, total);
    }
}

// out[i] is the fold of the elements i to i + width - 1: of two parts that meet at the end of a
// block of `width` elements.
template <class M>
inline void windows(Elements in, std::size_t n, std::size_t width, const Room<M>& out) {
    const std::size_t count = n - width + 1;
    for (std::size_t block = 0; block < count; block += width) {
        const std::size_t next = block + width;
        auto older = M::identity;
        for (std::size_t i = next; i-- > block;) {
            older = M::combine(get<M>(in.p, in.q, i), older);
            if (i < count) put<M>(out.p, out.q, i, older);
        }
        auto newer = M::identity;
        for (std::size_t i = block + 1; i < std::min(next, count); ++i) {
            newer = M::combine(newer, get<M>(in.p, in.q, i + width - 1));
            put<M>(out.p, out.q, i, M::combine(get<M>(out.p, out.q, i), newer));
        }
    }
}

#if defined(__SSE2__) || defined(_M_X64)
template <class M>
inline __m128d combine_packed(__m128d x, __m128d y) {
    if constexpr (M::identity > 0) {
        return _mm_min_pd(y, x);
    } else {
        return _mm_max_pd(y, x);
    }
}
#endif

// The fold of `total` and the elements.
template <class M>
inline typename M::Element fold(typename M::Element total, Elements in, std::size_t n) {
    std::size_t i = 0;
#if defined(__SSE2__) || defined(_M_X64)
    // Loops over arrays the compiler vectorises itself, but not this one: it may not reorder
    // comparisons of which it knows too little. The order does not matter for least and greatest.
    if constexpr (M::width == 1) {
        if (n >= 8) {
            __m128d a = _mm_loadu_pd(in.p), b = _mm_loadu_pd(in.p + 2);
            __m128d c = _mm_loadu_pd(in.p + 4), d = _mm_loadu_pd(in.p + 6);
            for (i = 8; i + 8 <= n; i += 8) {
                a = combine_packed<M>(a, _mm_loadu_pd(in.p + i));
                b = combine_packed<M>(b, _mm_loadu_pd(in.p + i + 2));
                c = combine_packed<M>(c, _mm_loadu_pd(in.p + i + 4));
                d = combine_packed<M>(d, _mm_loadu_pd(in.p + i + 6));
            }
            a = combine_packed<M>(combine_packed<M>(a, b), combine_packed<M>(c, d));
            total = M::combine(total, _mm_cvtsd_f64(a));
            total = M::combine(total, _mm_cvtsd_f64(_mm_unpackhi_pd(a, a)));
        }
    }
#endif
    for (; i < n; ++i) total = M::combine(total, get<M>(in.p, in.q, i));
    return total;
}

}  // namespace rtamt
