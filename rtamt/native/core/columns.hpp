// Columns: the values of one register at many samples, or in many entries.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/widest.hpp"

namespace rtamt::columns {

RTAMT_LOOP void find_nan(const double* values, std::size_t n, bool* found) {
    std::uint64_t nans = 0;
    for (std::size_t i = 0; i < n; ++i) nans |= values[i] != values[i] ? 1u : 0u;
    *found = nans != 0;
}

// The index of the first nan, or n.
inline std::size_t first_nan(const double* values, std::size_t n) {
    bool found = false;
    widest<find_nan>(values, n, &found);
    if (!found) return n;
    return static_cast<std::size_t>(
        std::find_if(values, values + n, [](double x) { return x != x; }) - values);
}

template <double (*function)(double, double)>
RTAMT_LOOP void apply(const double* __restrict a, const double* __restrict b,
                      double* __restrict out, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) out[i] = function(a[i], b[i]);
}

// Applies a function of MAP to two columns.
template <double (*function)(double, double)>
inline void map(const double* a, const double* b, double* out, std::size_t n) {
    widest<apply<function>>(a, b, out, n);
}

RTAMT_LOOP void turn(const double* __restrict in, double* __restrict out, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) out[i] = in[n - 1 - i];
}

// Copies a column from its end to its begin.
inline void reverse(const double* in, double* out, std::size_t n) { widest<turn>(in, out, n); }

}  // namespace rtamt::columns
