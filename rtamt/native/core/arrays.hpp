// Folds over arrays. Elements that are pairs are in two arrays, `p` and `q`; elements that are
// single numbers are in one array, to which both point.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "core/folds.hpp"

namespace rtamt {

struct Elements {
    const double* p;
    const double* q;

    Elements operator+(std::size_t n) const { return {p + n, q + n}; }
};

template <class F>
inline typename F::Element get(const double* p, const double* q, std::size_t i) {
    return F::element(p[i], q[i]);
}

template <class F>
inline void put(double* p, double* q, std::size_t i, typename F::Element x) {
    if constexpr (F::width == 1) {
        p[i] = x;
    } else {
        p[i] = x.p;
        q[i] = x.q;
    }
}

template <class F>
constexpr double component(typename F::Element x, int k) {
    if constexpr (F::width == 1) {
        return x;
    } else {
        return k == 0 ? x.p : x.q;
    }
}

// Memory for intermediate results, which grows and never shrinks.
template <class T>
class ScratchOf {
public:
    T* reserve(std::size_t n) {
        if (memory_.size() < n) memory_.resize(std::max(n, 2 * memory_.size()));
        return memory_.data();
    }

private:
    std::vector<T> memory_;
};
using Scratch = ScratchOf<double>;

// Scratch memory for the elements of a fold.
template <class F>
struct ElementBuffer {
    ElementBuffer(Scratch& first, Scratch& second, std::size_t n)
        : p(first.reserve(n)), q(F::width == 1 ? p : second.reserve(n)) {}

    Elements elements() const { return {p, q}; }

    double* p;
    double* q;
};

#ifdef RTAMT_SSE2
template <class F>
inline __m128d combine_packed(__m128d x, __m128d y) {
    if constexpr (F::identity > 0) {
        return _mm_or_pd(_mm_min_pd(x, y), _mm_min_pd(y, x));
    } else {
        return _mm_and_pd(_mm_max_pd(x, y), _mm_max_pd(y, x));
    }
}

inline __m128d both_low(__m128d x) { return _mm_unpacklo_pd(x, x); }
inline __m128d both_high(__m128d x) { return _mm_unpackhi_pd(x, x); }

// Four folds at once wait for the total of the four before them, and for nothing else.
template <class F>
inline std::size_t prefixes_packed(const double* in, std::size_t n, double* out) {
    __m128d total = _mm_set1_pd(F::identity);
    std::size_t i = 0;
    for (; i + 4 <= n; i += 4) {
        __m128d a = _mm_loadu_pd(in + i), b = _mm_loadu_pd(in + i + 2);
        a = combine_packed<F>(a, both_low(a));
        b = combine_packed<F>(combine_packed<F>(b, both_low(b)), both_high(a));
        _mm_storeu_pd(out + i, combine_packed<F>(total, a));
        _mm_storeu_pd(out + i + 2, combine_packed<F>(total, b));
        total = combine_packed<F>(total, both_high(b));
    }
    return i;
}
// The same from the end on; returns where the folds begin that were found.
template <class F>
inline std::size_t suffixes_packed(const double* in, std::size_t begin, std::size_t n, double last,
                                   double* out) {
    __m128d total = _mm_set1_pd(last);
    std::size_t i = n;
    for (; i >= begin + 4; i -= 4) {
        __m128d a = _mm_loadu_pd(in + i - 4), b = _mm_loadu_pd(in + i - 2);
        b = combine_packed<F>(b, both_high(b));
        a = combine_packed<F>(combine_packed<F>(a, both_high(a)), both_low(b));
        _mm_storeu_pd(out + i - 2, combine_packed<F>(total, b));
        _mm_storeu_pd(out + i - 4, combine_packed<F>(total, a));
        total = combine_packed<F>(total, both_low(a));
    }
    return i;
}
#endif

// out[i] is the fold of the elements 0 to i.
template <class F>
inline void prefixes(Elements in, std::size_t n, const ElementBuffer<F>& out) {
    auto total = F::identity;
    std::size_t i = 0;
#ifdef RTAMT_SSE2
    if constexpr (F::width == 1) {
        i = prefixes_packed<F>(in.p, n, out.p);
        if (i > 0) total = out.p[i - 1];
    }
#endif
    for (; i < n; ++i) {
        total = F::combine_alone(total, get<F>(in.p, in.q, i));
        put<F>(out.p, out.q, i, total);
    }
}

// out[i] is the fold of the elements i to n - 1, for i from `begin` on, and of `last`.
template <class F>
inline void suffixes(Elements in, std::size_t begin, std::size_t n, typename F::Element last,
                     const ElementBuffer<F>& out) {
    auto total = last;
    std::size_t i = n;
#ifdef RTAMT_SSE2
    if constexpr (F::width == 1) {
        i = suffixes_packed<F>(in.p, begin, n, last, out.p);
        if (i < n) total = out.p[i];
    }
#endif
    while (i-- > begin) {
        total = F::combine_alone(get<F>(in.p, in.q, i), total);
        put<F>(out.p, out.q, i, total);
    }
}

// out[i] is the fold of the elements i to i + width - 1. Every window is the end of one block of
// `width` elements and the begin of the next.
template <class F>
inline void windows(Elements in, std::size_t n, std::size_t width, const ElementBuffer<F>& out) {
    const std::size_t count = n - width + 1;
    for (std::size_t block = 0; block < count; block += width) {
        const std::size_t next = block + width;
        auto older = F::identity;
        for (std::size_t i = next; i-- > block;) {
            older = F::combine_alone(get<F>(in.p, in.q, i), older);
            if (i < count) put<F>(out.p, out.q, i, older);
        }
        auto newer = F::identity;
        for (std::size_t i = block + 1; i < std::min(next, count); ++i) {
            newer = F::combine_alone(newer, get<F>(in.p, in.q, i + width - 1));
            put<F>(out.p, out.q, i, F::combine_alone(get<F>(out.p, out.q, i), newer));
        }
    }
}

// One element again and again, for loops that take arrays of elements too.
template <class F>
struct Repeated {
    typename F::Element element;

    Repeated operator+(std::size_t) const { return *this; }
};

template <class F>
inline typename F::Element get(Elements in, std::size_t i) {
    return get<F>(in.p, in.q, i);
}
template <class F>
inline typename F::Element get(const Repeated<F>& in, std::size_t) {
    return in.element;
}

#ifdef RTAMT_SSE2
// Two elements side by side.
struct PackedElements {
    __m128d p;
    __m128d q;
};

template <class F>
inline PackedElements get_packed(Elements in, std::size_t i) {
    return {_mm_loadu_pd(in.p + i), _mm_loadu_pd(in.q + i)};
}
template <class F>
inline PackedElements get_packed(const Repeated<F>& in, std::size_t) {
    return {_mm_set1_pd(component<F>(in.element, 0)), _mm_set1_pd(component<F>(in.element, 1))};
}

template <class F>
inline __m128d result_packed(PackedElements x, PackedElements y) {
    if constexpr (F::kind == Kind::single) {
        return combine_packed<F>(x.q, y.q);
    } else if constexpr (F::kind == Kind::ahead) {
        return combine_packed<typename F::UpperFold>(
            x.q, combine_packed<typename F::LowerFold>(x.p, y.q));
    } else {
        return combine_packed<typename F::UpperFold>(
            y.q, combine_packed<typename F::LowerFold>(y.p, x.q));
    }
}
#endif

// out[i] is the result of element i of x and then element i of y, for i below n; out may be x.
// Compilers make no good vectors of comparisons that tell -0.0 from 0.0.
template <class F, class Newer>
inline void combine_results(Elements x, Newer y, double* out, std::size_t n) {
    std::size_t i = 0;
#ifdef RTAMT_SSE2
    for (; i + 4 <= n; i += 4) {
        const __m128d a = result_packed<F>(get_packed<F>(x, i), get_packed<F>(y, i));
        const __m128d b = result_packed<F>(get_packed<F>(x, i + 2), get_packed<F>(y, i + 2));
        _mm_storeu_pd(out + i, a);
        _mm_storeu_pd(out + i + 2, b);
    }
#endif
    for (; i < n; ++i) out[i] = F::result(F::combine_alone(get<F>(x, i), get<F>(y, i)));
}

// The fold of `total` and the elements.
template <class F>
inline typename F::Element fold(typename F::Element total, Elements in, std::size_t n) {
    std::size_t i = 0;
#ifdef RTAMT_SSE2
    // Compilers do not vectorise this loop, as they may not reorder comparisons of doubles. For the
    // least and the greatest element the order does not matter.
    if constexpr (F::width == 1) {
        if (n >= 8) {
            __m128d a = _mm_loadu_pd(in.p), b = _mm_loadu_pd(in.p + 2);
            __m128d c = _mm_loadu_pd(in.p + 4), d = _mm_loadu_pd(in.p + 6);
            for (i = 8; i + 8 <= n; i += 8) {
                a = combine_packed<F>(a, _mm_loadu_pd(in.p + i));
                b = combine_packed<F>(b, _mm_loadu_pd(in.p + i + 2));
                c = combine_packed<F>(c, _mm_loadu_pd(in.p + i + 4));
                d = combine_packed<F>(d, _mm_loadu_pd(in.p + i + 6));
            }
            a = combine_packed<F>(combine_packed<F>(a, b), combine_packed<F>(c, d));
            total = F::combine_alone(total, _mm_cvtsd_f64(a));
            total = F::combine_alone(total, _mm_cvtsd_f64(_mm_unpackhi_pd(a, a)));
        }
    }
#endif
    for (; i < n; ++i) total = F::combine_alone(total, get<F>(in.p, in.q, i));
    return total;
}

// The fold of `total` and, at every place of three arrays, of what another fold makes of the three.
template <class Outer, class Inner>
inline double fold_across(double total, const std::array<const double*, 3>& in, std::size_t n) {
    std::size_t i = 0;
#ifdef RTAMT_SSE2
    const auto inner = [&in](std::size_t at) {
        const __m128d a = _mm_loadu_pd(in[0] + at), b = _mm_loadu_pd(in[1] + at);
        return combine_packed<Inner>(combine_packed<Inner>(a, b), _mm_loadu_pd(in[2] + at));
    };
    __m128d x = _mm_set1_pd(total), y = x;
    for (; i + 4 <= n; i += 4) {
        x = combine_packed<Outer>(x, inner(i));
        y = combine_packed<Outer>(y, inner(i + 2));
    }
    x = combine_packed<Outer>(x, y);
    total = Outer::combine_alone(_mm_cvtsd_f64(x), _mm_cvtsd_f64(_mm_unpackhi_pd(x, x)));
#endif
    for (; i < n; ++i) {
        const double inner_of_two = Inner::combine_alone(in[0][i], in[1][i]);
        total = Outer::combine_alone(total, Inner::combine_alone(inner_of_two, in[2][i]));
    }
    return total;
}

}  // namespace rtamt
