/* A unit of FMI 2.0 that does nothing: what the calls of a step cost by themselves. */
#include <stddef.h>

#define SEEN __attribute__((visibility("default")))

static double values[64];

SEEN void* fmi2Instantiate(const char* name, int type, const char* guid, const char* location,
                           const void* callbacks, int visible, int logging) {
    return values;
}
SEEN int fmi2SetupExperiment(void* c, int t, double tol, double start, int s, double stop) {
    return 0;
}
SEEN int fmi2EnterInitializationMode(void* c) { return 0; }
SEEN int fmi2ExitInitializationMode(void* c) { return 0; }
SEEN int fmi2DoStep(void* c, double time, double size, int no_set) { return 0; }
SEEN int fmi2SetReal(void* c, const unsigned* refs, size_t n, const double* given) {
    for (size_t i = 0; i < n; ++i) ((double*)c)[refs[i] & 63] = given[i];
    return 0;
}
SEEN int fmi2GetReal(void* c, const unsigned* refs, size_t n, double* out) {
    for (size_t i = 0; i < n; ++i) out[i] = ((double*)c)[refs[i] & 63];
    return 0;
}
SEEN int fmi2GetInteger(void* c, const unsigned* refs, size_t n, int* out) {
    for (size_t i = 0; i < n; ++i) out[i] = (int)((double*)c)[refs[i] & 63];
    return 0;
}
SEEN void fmi2FreeInstance(void* c) {}
