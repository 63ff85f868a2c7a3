// Columns: the values of one register at many samples, or in many entries, and loops over them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>

// Says of the next loop that its rounds do not read what others write.
#if defined(__clang__)
#define RTAMT_INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define RTAMT_INDEPENDENT _Pragma("GCC ivdep")
#else
#define RTAMT_INDEPENDENT __pragma(loop(ivdep))
#endif

namespace rtamt {

// Loops over columns, compiled for the vectors of every processor: the widest it has is taken when
// the loop runs. The numbers are the same.

// Memory for columns. The widest vectors lie within one line of the cache each.
constexpr std::align_val_t kCacheLine{64};
struct FreeColumns {
    void operator()(double* p) const { ::operator delete[](p, kCacheLine); }
};
using ColumnMemory = std::unique_ptr<double[], FreeColumns>;
inline ColumnMemory column_memory(std::size_t n) {
    return ColumnMemory(static_cast<double*>(::operator new[](n * sizeof(double), kCacheLine)));
}

#if defined(__GNUC__) && defined(__x86_64__)

#define RTAMT_LOOP [[gnu::always_inline]] inline
// The same of a lambda, between its parameters and its body.
#define RTAMT_LOOP_BODY __attribute__((always_inline))

enum class Vectors { narrow, avx2, avx512 };

inline const Vectors kVectors = __builtin_cpu_supports("avx512f") ? Vectors::avx512
                                : __builtin_cpu_supports("avx2")  ? Vectors::avx2
                                                                  : Vectors::narrow;

template <auto loop, class... Args>
[[gnu::target("avx512f")]] void run_avx512(Args... args) {
    loop(args...);
}

template <auto loop, class... Args>
[[gnu::target("avx2")]] void run_avx2(Args... args) {
    loop(args...);
}

template <auto loop, class... Args>
inline void widest(Args... args) {
    switch (kVectors) {
        case Vectors::avx512:
            return run_avx512<loop>(args...);
        case Vectors::avx2:
            return run_avx2<loop>(args...);
        case Vectors::narrow:
            return loop(args...);
    }
}

#else

#define RTAMT_LOOP inline
#define RTAMT_LOOP_BODY

template <auto loop, class... Args>
inline void widest(Args... args) {
    loop(args...);
}

#endif

template <class Body>
RTAMT_LOOP void run_body(const Body* body) {
    (*body)();
}

// Runs a body of loops, a lambda with RTAMT_LOOP_BODY, as widest runs a function.
template <class Body>
inline void widely(const Body& body) {
    widest<run_body<Body>>(&body);
}

}  // namespace rtamt

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

namespace rtamt {

// Numbers in rows and columns, somewhere in memory.
struct Table {
    const double* data = nullptr;
    std::ptrdiff_t row = 0;  // from a number to the one below it
    std::ptrdiff_t column = 0;
    const std::size_t* picked = nullptr;  // the columns that are meant; null: the first ones

    // A column, whose numbers are `row` apart.
    const double* at(std::size_t index) const {
        const std::size_t place = picked == nullptr ? index : picked[index];
        return data + static_cast<std::ptrdiff_t>(place) * column;
    }
};

}  // namespace rtamt
