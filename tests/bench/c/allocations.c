/* Preloaded before the C library: counts the calls of its allocator. */
#include <stddef.h>
#include <stdint.h>

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);

uint64_t rtamt_bench_allocations;

void *malloc(size_t size) {
    rtamt_bench_allocations++;
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size) {
    rtamt_bench_allocations++;
    return __libc_calloc(count, size);
}

void *realloc(void *old, size_t size) {
    rtamt_bench_allocations++;
    return __libc_realloc(old, size);
}
