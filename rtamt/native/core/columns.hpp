// Columns: the values of one register at many samples, or in many lanes.
#pragma once

#include <algorithm>
#include <cstddef>

#if defined(__SSE2__) || defined(_M_X64)
#include <emmintrin.h>
#endif

namespace rtamt::columns {

// The index of the first nan, or n.
inline std::size_t first_nan(const double* values, std::size_t n) {
#if defined(__SSE2__) || defined(_M_X64)  // compilers do not vectorise the loop below
    __m128d found = _mm_setzero_pd();
    for (std::size_t i = 0; i + 2 <= n; i += 2) {
        const __m128d pair = _mm_loadu_pd(values + i);
        found = _mm_or_pd(found, _mm_cmpunord_pd(pair, pair));
    }
    if (_mm_movemask_pd(found) == 0 && (n % 2 == 0 || values[n - 1] == values[n - 1])) return n;
#endif
    return static_cast<std::size_t>(
        std::find_if(values, values + n, [](double x) { return x != x; }) - values);
}

// Applies a function of MAP to two columns.
template <double (*function)(double, double)>
inline void map(const double* __restrict a, const double* __restrict b, double* __restrict out,
                std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) out[i] = function(a[i], b[i]);
}

}  // namespace rtamt::columns
