// The order of doubles in which -0.0 is below 0.0: the sign bit of a robustness says whether the
// formula holds, at 0 too. And how traces end, and what bounds say then.
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

// How a trace ends: with nothing after it, at a time that no one chose, or as a mere beginning.
enum class End { complete, cut, open };

// 1 if bounds say that a specification is satisfied, -1 if violated, else 0.
inline int verdict_of(double lower, double upper) {
    return negative(upper) ? -1 : !negative(lower);
}

// The robustness, or the bound that is nearest to it.
inline double moved(double robustness, double lower, double upper) {
    return alone::greater(lower, alone::lesser(robustness, upper));
}

}  // namespace rtamt
