/* Steps a unit of FMI 2.0 as a tool does: sets two inputs, makes a step of a second, reads three
   outputs and the verdict.

   fmu_driver LIBRARY LOCATION TOKEN STEPS REPEATS: prints the least nanoseconds a step. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

typedef struct {
    void (*logger)(void*, const char*, int, const char*, const char*, ...);
    void* (*allocate)(size_t, size_t);
    void (*release)(void*);
    void (*finished)(void*, int);
    void* environment;
} Callbacks;

static void heard(void* e, const char* name, int status, const char* category, const char* text,
                  ...) {
    fprintf(stderr, "%s: %s\n", category, text);
}

static void* found(void* library, const char* name) {
    void* function = dlsym(library, name);
    if (function == NULL) exit(2);
    return function;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int argc, char** argv) {
    if (argc != 6) return 2;
    void* library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) return 2;
    void* (*make)(const char*, int, const char*, const char*, const Callbacks*, int, int) =
        found(library, "fmi2Instantiate");
    int (*setup)(void*, int, double, double, int, double) = found(library, "fmi2SetupExperiment");
    int (*enter)(void*) = found(library, "fmi2EnterInitializationMode");
    int (*leave)(void*) = found(library, "fmi2ExitInitializationMode");
    int (*step)(void*, double, double, int) = found(library, "fmi2DoStep");
    int (*set)(void*, const unsigned*, size_t, const double*) = found(library, "fmi2SetReal");
    int (*get)(void*, const unsigned*, size_t, double*) = found(library, "fmi2GetReal");
    int (*get_integer)(void*, const unsigned*, size_t, int*) = found(library, "fmi2GetInteger");
    void (*release)(void*) = found(library, "fmi2FreeInstance");

    const Callbacks callbacks = {heard, NULL, NULL, NULL, NULL};
    const unsigned inputs[] = {8, 9}, outputs[] = {1, 2, 3}, verdict[] = {4};
    const long steps = atol(argv[4]);
    double least = 1e300, sum = 0.0;
    for (long repeat = 0; repeat < atol(argv[5]); ++repeat) {
        void* c = make("unit", 1, argv[3], argv[2], &callbacks, 0, 0);
        if (c == NULL || setup(c, 0, 0.0, 0.0, 0, 0.0) || enter(c) || leave(c)) return 1;
        const double begin = now();
        for (long i = 0; i < steps; ++i) {
            const double given[] = {1.0 + 0.25 * (double)(i * 7919 % 13), 4.0 - (double)(i % 5)};
            double out[3];
            int decided;
            if (set(c, inputs, 2, given) || step(c, (double)i, 1.0, 1) || get(c, outputs, 3, out) ||
                get_integer(c, verdict, 1, &decided))
                return 1;
            sum += out[0] + decided;
        }
        const double each = (now() - begin) / (double)steps;
        if (each < least) least = each;
        release(c);
    }
    printf("%.2f %g\n", least, sum);
    return 0;
}
