/* Counts the steps of a library in C++ that is compiled with -fsanitize-coverage=trace-pc and
 * linked with this file: the branches that it takes, and the words of memory that it moves. */
#include <stddef.h>
#include <stdint.h>

uint64_t steps;

void __sanitizer_cov_trace_pc(void) { ++steps; }

/* The compiler calls these for loops that copy and fill. Hidden: only the library moves by them. */
#define HIDDEN __attribute__((visibility("hidden")))

HIDDEN void *memmove(void *to, const void *from, size_t n) {
    char *out = to;
    const char *in = from;
    steps += n / sizeof(uint64_t);
    if (out < in)
        for (size_t i = 0; i < n; ++i) out[i] = in[i];
    else
        for (size_t i = n; i-- > 0;) out[i] = in[i];
    return to;
}

HIDDEN void *memcpy(void *to, const void *from, size_t n) { return memmove(to, from, n); }

HIDDEN void *memset(void *to, int byte, size_t n) {
    char *out = to;
    steps += n / sizeof(uint64_t);
    for (size_t i = 0; i < n; ++i) out[i] = (char)byte;
    return to;
}
