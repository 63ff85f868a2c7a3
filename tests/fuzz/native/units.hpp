// Units of the folders in PROGRAMS, called as tools call them: through the C of FMI 2 and FMI 3.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

extern "C" {
struct Callbacks2 {
    void (*logger)(void*, const char*, int, const char*, const char*, ...);
    void* (*allocate)(std::size_t, std::size_t);
    void (*free)(void*);
    void (*finished)(void*, int);
    void* environment;
};
using Log3 = void (*)(void*, int, const char*, const char*);

void* fmi2Instantiate(const char*, int, const char*, const char*, const Callbacks2*, int, int);
void fmi2FreeInstance(void*);
int fmi2SetupExperiment(void*, int, double, double, int, double);
int fmi2EnterInitializationMode(void*);
int fmi2ExitInitializationMode(void*);
int fmi2Terminate(void*);
int fmi2Reset(void*);
int fmi2GetReal(void*, const std::uint32_t*, std::size_t, double*);
int fmi2SetReal(void*, const std::uint32_t*, std::size_t, const double*);
int fmi2GetInteger(void*, const std::uint32_t*, std::size_t, int*);
int fmi2SetBoolean(void*, const std::uint32_t*, std::size_t, const int*);
int fmi2GetFMUstate(void*, void**);
int fmi2SetFMUstate(void*, void*);
int fmi2FreeFMUstate(void*, void**);
int fmi2SerializedFMUstateSize(void*, void*, std::size_t*);
int fmi2SerializeFMUstate(void*, void*, char*, std::size_t);
int fmi2DeSerializeFMUstate(void*, const char*, std::size_t, void**);
int fmi2DoStep(void*, double, double, int);

void* fmi3InstantiateCoSimulation(const char*, const char*, const char*, bool, bool, bool, bool,
                                  const std::uint32_t*, std::size_t, void*, Log3, void (*)());
void fmi3FreeInstance(void*);
int fmi3EnterInitializationMode(void*, bool, double, double, bool, double);
int fmi3ExitInitializationMode(void*);
int fmi3Terminate(void*);
int fmi3Reset(void*);
int fmi3GetFloat64(void*, const std::uint32_t*, std::size_t, double*, std::size_t);
int fmi3SetFloat64(void*, const std::uint32_t*, std::size_t, const double*, std::size_t);
int fmi3GetInt32(void*, const std::uint32_t*, std::size_t, std::int32_t*, std::size_t);
int fmi3SetBoolean(void*, const std::uint32_t*, std::size_t, const bool*, std::size_t);
int fmi3GetFMUState(void*, void**);
int fmi3SetFMUState(void*, void*);
int fmi3FreeFMUState(void*, void**);
int fmi3SerializedFMUStateSize(void*, void*, std::size_t*);
int fmi3SerializeFMUState(void*, void*, std::uint8_t*, std::size_t);
int fmi3DeserializeFMUState(void*, const std::uint8_t*, std::size_t, void**);
int fmi3DoStep(void*, double, double, bool, bool*, bool*, bool*, double*);
}

namespace fuzz {

inline constexpr const char* kFolders[] = {PROGRAMS "/samples", PROGRAMS "/dense",
                                           PROGRAMS "/neutral"};
inline constexpr std::uint32_t kOutputs[] = {1, 2, 3};  // robustness and its bounds
inline constexpr std::uint32_t kVerdict = 4, kStop = 5, kFirst = 8;
inline constexpr int kOk = 0, kDiscard = 2, kError = 3;

inline thread_local char said[256] = "";  // the last text that was logged, without an allocation

inline void log3(void*, int, const char*, const char* text) {
    std::strncpy(said, text, sizeof said - 1);
}
inline void log2(void*, const char*, int status, const char* category, const char* text, ...) {
    log3(nullptr, status, category, text);
}

// One instance; its calls give the status that the library gives.
class Unit {
public:
    Unit(int version, std::size_t folder) : version_(version) {
        const std::string path = kFolders[folder];
        static const Callbacks2 callbacks = {log2, std::calloc, std::free, nullptr, nullptr};
        pointer_ = version == 2
                       ? fmi2Instantiate("unit", 1, "{token}", ("file://" + path).c_str(),
                                         &callbacks, 0, 1)
                       : fmi3InstantiateCoSimulation("unit", "{token}", path.c_str(), false, true,
                                                     false, false, nullptr, 0, nullptr, log3,
                                                     nullptr);
    }
    Unit(const Unit&) = delete;
    Unit& operator=(const Unit&) = delete;
    ~Unit() {
        if (version_ == 2) fmi2FreeInstance(pointer_);
        else fmi3FreeInstance(pointer_);
    }

    bool made() const { return pointer_ != nullptr; }

    int enter(double start, bool stops, double stop) {
        if (version_ == 3)
            return fmi3EnterInitializationMode(pointer_, false, 0.0, start, stops, stop);
        const int status = fmi2SetupExperiment(pointer_, 0, 0.0, start, stops, stop);
        return status != kOk ? status : fmi2EnterInitializationMode(pointer_);
    }
    int leave() {
        return version_ == 2 ? fmi2ExitInitializationMode(pointer_)
                             : fmi3ExitInitializationMode(pointer_);
    }
    int terminate() { return version_ == 2 ? fmi2Terminate(pointer_) : fmi3Terminate(pointer_); }
    int reset() { return version_ == 2 ? fmi2Reset(pointer_) : fmi3Reset(pointer_); }
    int step(double time, double size) {
        if (version_ == 2) return fmi2DoStep(pointer_, time, size, 1);
        bool event = false, ends = false, early = false;
        double last = 0.0;
        return fmi3DoStep(pointer_, time, size, true, &event, &ends, &early, &last);
    }
    int set(const std::uint32_t* references, const double* values, std::size_t n) {
        return version_ == 2 ? fmi2SetReal(pointer_, references, n, values)
                             : fmi3SetFloat64(pointer_, references, n, values, n);
    }
    int get(const std::uint32_t* references, double* values, std::size_t n) {
        return version_ == 2 ? fmi2GetReal(pointer_, references, n, values)
                             : fmi3GetFloat64(pointer_, references, n, values, n);
    }
    int verdict(int* value) {
        return version_ == 2 ? fmi2GetInteger(pointer_, &kVerdict, 1, value)
                             : fmi3GetInt32(pointer_, &kVerdict, 1, value, 1);
    }
    int set_stop(bool stop) {
        const int on = stop;
        return version_ == 2 ? fmi2SetBoolean(pointer_, &kStop, 1, &on)
                             : fmi3SetBoolean(pointer_, &kStop, 1, &stop, 1);
    }
    int take(void** state) {
        return version_ == 2 ? fmi2GetFMUstate(pointer_, state) : fmi3GetFMUState(pointer_, state);
    }
    int restore(void* state) {
        return version_ == 2 ? fmi2SetFMUstate(pointer_, state) : fmi3SetFMUState(pointer_, state);
    }
    int free_state(void** state) {
        return version_ == 2 ? fmi2FreeFMUstate(pointer_, state)
                             : fmi3FreeFMUState(pointer_, state);
    }
    int size_of(void* state, std::size_t* size) {
        return version_ == 2 ? fmi2SerializedFMUstateSize(pointer_, state, size)
                             : fmi3SerializedFMUStateSize(pointer_, state, size);
    }
    int write(void* state, char* bytes, std::size_t size) {
        return version_ == 2
                   ? fmi2SerializeFMUstate(pointer_, state, bytes, size)
                   : fmi3SerializeFMUState(pointer_, state, reinterpret_cast<std::uint8_t*>(bytes),
                                           size);
    }
    int read(const char* bytes, std::size_t size, void** state) {
        return version_ == 2
                   ? fmi2DeSerializeFMUstate(pointer_, bytes, size, state)
                   : fmi3DeserializeFMUState(pointer_, reinterpret_cast<const std::uint8_t*>(bytes),
                                             size, state);
    }

private:
    int version_;
    void* pointer_;
};

}  // namespace fuzz
