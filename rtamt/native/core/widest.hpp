// Loops over columns, compiled for the vectors of every processor: the widest it has is taken when
// the loop runs. The numbers are the same.
#pragma once

#include <cstddef>
#include <memory>
#include <new>

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

template <auto loop, class... Args>
inline void widest(Args... args) {
    loop(args...);
}

#endif

}  // namespace rtamt
