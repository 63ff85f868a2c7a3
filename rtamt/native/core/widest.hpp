// Loops over columns, compiled for the vectors of every processor: the widest it has is taken when
// the loop runs. The numbers are the same.
#pragma once

#include <cstddef>
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
                                : __builtin_cpu_supports("avx2") ? Vectors::avx2
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
