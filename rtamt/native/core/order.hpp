// The order of doubles in which -0.0 is below 0.0: the sign bit of a robustness says whether the
// formula holds, at 0 too.
#pragma once

#include <bit>
#include <cstdint>

#if defined(__SSE2__) || defined(_M_X64)
#include <emmintrin.h>
#define RTAMT_SSE2
#endif

namespace rtamt {

inline std::uint64_t bits_of(double x) { return std::bit_cast<std::uint64_t>(x); }
inline bool negative(double x) { return bits_of(x) >> 63 != 0; }
// Whether two doubles are the same bit for bit.
inline bool same(double x, double y) { return bits_of(x) == bits_of(y); }

// Of two zeros that differ, each comparison takes another one; their bits together are the lesser
// or the greater one. Compilers make vectors of these. No operand is nan.
inline double lesser(double x, double y) {
    return std::bit_cast<double>(bits_of(y < x ? y : x) | bits_of(x < y ? x : y));
}
inline double greater(double x, double y) {
    return std::bit_cast<double>(bits_of(y > x ? y : x) & bits_of(x > y ? x : y));
}

// The same outside of loops over arrays, where compilers would move the bits to integer registers
// and back, and make jumps of the comparisons.
namespace alone {
#ifdef RTAMT_SSE2
inline double lesser(double x, double y) {
    const __m128d a = _mm_set_sd(x), b = _mm_set_sd(y);
    return _mm_cvtsd_f64(_mm_or_pd(_mm_min_sd(a, b), _mm_min_sd(b, a)));
}
inline double greater(double x, double y) {
    const __m128d a = _mm_set_sd(x), b = _mm_set_sd(y);
    return _mm_cvtsd_f64(_mm_and_pd(_mm_max_sd(a, b), _mm_max_sd(b, a)));
}
#else
using rtamt::greater;
using rtamt::lesser;
#endif
}  // namespace alone

template <double (*choose)(double, double)>
inline constexpr auto kAlone = alone::greater;
template <>
inline constexpr auto kAlone<lesser> = alone::lesser;

}  // namespace rtamt
