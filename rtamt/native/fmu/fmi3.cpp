// The interface of FMI 3.0 for co-simulation: the functions that fmi-standard.org documents, in
// sections 2 and 4 of version 3.0.1 of the standard. Calls of the other kinds of units, which the
// standard has every unit export, are refused.
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "fmu/unit.hpp"

using namespace rtamt::fmu;

namespace {

using Pointer = void*;  // fmi3Instance
using Log = void (*)(void* environment, int status, const char* category, const char* text);

Pointer make(const char* call, const char* name, const char* token, const char* resources,
             bool logging, bool simulates, void* environment, Log write) noexcept {
    try {
        const Unit::Log log = [=](Status status, const char* category, const std::string& text) {
            if (write != nullptr) write(environment, status, category, text.c_str());
        };
        const auto folder = [=] {
            if (!simulates) throw Refusal("expected co-simulation without event mode");
            if (name == nullptr || *name == '\0') throw Refusal("expected a name of the instance");
            if (resources == nullptr) throw Refusal("expected the folder of the resources");
            return std::string(resources);
        };
        return make_unit(call, folder, token, log, logging);
    } catch (...) {  // no memory for the callbacks
        return nullptr;
    }
}

}  // namespace

RTAMT_FMI const char* fmi3GetVersion() { return "3.0"; }

RTAMT_FMI Pointer fmi3InstantiateCoSimulation(const char* name, const char* token,
                                              const char* resources, bool, bool logging,
                                              bool events, bool, const Reference*, std::size_t,
                                              void* environment, Log log, void (*)()) {
    return make("fmi3InstantiateCoSimulation", name, token, resources, logging, !events,
                environment, log);
}

RTAMT_FMI Pointer fmi3InstantiateModelExchange(const char* name, const char* token,
                                               const char* resources, bool, bool logging,
                                               void* environment, Log log) {
    return make("fmi3InstantiateModelExchange", name, token, resources, logging, false, environment,
                log);
}

RTAMT_FMI Pointer fmi3InstantiateScheduledExecution(const char* name, const char* token,
                                                    const char* resources, bool, bool logging,
                                                    void* environment, Log log, void (*)(),
                                                    void (*)(), void (*)()) {
    return make("fmi3InstantiateScheduledExecution", name, token, resources, logging, false,
                environment, log);
}

RTAMT_FMI void fmi3FreeInstance(Pointer instance) { free_unit(instance); }

RTAMT_FMI Status fmi3SetDebugLogging(Pointer instance, bool on, std::size_t n,
                                     const char* const* categories) {
    return guarded(instance, "fmi3SetDebugLogging", [=](Unit& unit) {
        unit.set_logging(on, n, categories);
        return kOk;
    });
}

RTAMT_FMI Status fmi3EnterInitializationMode(Pointer instance, bool, double, double start,
                                             bool stops, double stop) {
    return guarded(instance, "fmi3EnterInitializationMode", [=](Unit& unit) {
        unit.instance.set_times(start, stops ? stop : std::numeric_limits<double>::infinity());
        unit.instance.begin_initialization();
        return kOk;
    });
}

RTAMT_RUN(fmi3ExitInitializationMode, end_initialization)
RTAMT_RUN(fmi3Terminate, terminate)
RTAMT_RUN(fmi3Reset, reset)

RTAMT_FMI Status fmi3GetFloat64(Pointer instance, const Reference* references, std::size_t n,
                                double* values, std::size_t size) {
    return get_each<&Instance::real>(instance, "fmi3GetFloat64", references, n, values, size);
}

RTAMT_FMI Status fmi3SetFloat64(Pointer instance, const Reference* references, std::size_t n,
                                const double* values, std::size_t size) {
    return set_each(instance, "fmi3SetFloat64", references, n, values, size,
                    [](auto value) { return value; });
}

RTAMT_FMI Status fmi3GetInt32(Pointer instance, const Reference* references, std::size_t n,
                              std::int32_t* values, std::size_t size) {
    return get_each<&Instance::integer>(instance, "fmi3GetInt32", references, n, values, size);
}

RTAMT_FMI Status fmi3GetBoolean(Pointer instance, const Reference* references, std::size_t n,
                                bool* values, std::size_t size) {
    return get_each<&Instance::boolean>(instance, "fmi3GetBoolean", references, n, values, size);
}

RTAMT_FMI Status fmi3SetBoolean(Pointer instance, const Reference* references, std::size_t n,
                                const bool* values, std::size_t size) {
    return set_each(instance, "fmi3SetBoolean", references, n, values, size,
                    [](auto value) { return value; });
}

RTAMT_NO_VARIABLES(fmi3GetFloat32, float*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetInt8, std::int8_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetUInt8, std::uint8_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetInt16, std::int16_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetUInt16, std::uint16_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetUInt32, std::uint32_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetInt64, std::int64_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetUInt64, std::uint64_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetString, const char**, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetBinary, std::size_t*, const std::uint8_t**, std::size_t)
RTAMT_NO_VARIABLES(fmi3GetClock, bool*)
RTAMT_NO_VARIABLES(fmi3SetFloat32, const float*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetInt8, const std::int8_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetUInt8, const std::uint8_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetInt16, const std::int16_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetUInt16, const std::uint16_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetInt32, const std::int32_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetUInt32, const std::uint32_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetInt64, const std::int64_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetUInt64, const std::uint64_t*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetString, const char* const*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetBinary, const std::size_t*, const std::uint8_t* const*, std::size_t)
RTAMT_NO_VARIABLES(fmi3SetClock, const bool*)
RTAMT_NO_VARIABLES(fmi3GetIntervalDecimal, double*, int*)
RTAMT_NO_VARIABLES(fmi3GetIntervalFraction, std::uint64_t*, std::uint64_t*, int*)
RTAMT_NO_VARIABLES(fmi3GetShiftDecimal, double*)
RTAMT_NO_VARIABLES(fmi3GetShiftFraction, std::uint64_t*, std::uint64_t*)
RTAMT_NO_VARIABLES(fmi3SetIntervalDecimal, const double*)
RTAMT_NO_VARIABLES(fmi3SetIntervalFraction, const std::uint64_t*, const std::uint64_t*)
RTAMT_NO_VARIABLES(fmi3SetShiftDecimal, const double*)
RTAMT_NO_VARIABLES(fmi3SetShiftFraction, const std::uint64_t*, const std::uint64_t*)

RTAMT_STATES(fmi3GetFMUState, fmi3SetFMUState, fmi3FreeFMUState, fmi3SerializedFMUStateSize,
             fmi3SerializeFMUState, fmi3DeserializeFMUState, std::uint8_t)

// With `stop_on_violation` a violation asks to end the simulation.
RTAMT_FMI Status fmi3DoStep(Pointer instance, double time, double size, bool, bool* event,
                            bool* terminate, bool* early, double* last) {
    return guarded(instance, "fmi3DoStep", [=](Unit& unit) {
        for (const void* given : {static_cast<void*>(event), static_cast<void*>(terminate),
                                  static_cast<void*>(early), static_cast<void*>(last)})
            require_array(given, 1);
        *event = *early = false;
        *terminate = unit.instance.step(time, size);
        *last = unit.instance.time();
        if (*terminate) unit.tell(violation_text(unit.instance));
        return kOk;
    });
}

RTAMT_UNSUPPORTED(fmi3EnterEventMode, void* unit)
RTAMT_UNSUPPORTED(fmi3EnterStepMode, void* unit)
RTAMT_UNSUPPORTED(fmi3EnterConfigurationMode, void* unit)
RTAMT_UNSUPPORTED(fmi3ExitConfigurationMode, void* unit)
RTAMT_UNSUPPORTED(fmi3GetNumberOfVariableDependencies, void* unit, Reference, std::size_t*)
RTAMT_UNSUPPORTED(fmi3GetVariableDependencies, void* unit, Reference, std::size_t*, Reference*,
                  std::size_t*, int*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetDirectionalDerivative, void* unit, const Reference*, std::size_t,
                  const Reference*, std::size_t, const double*, std::size_t, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetAdjointDerivative, void* unit, const Reference*, std::size_t,
                  const Reference*, std::size_t, const double*, std::size_t, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetOutputDerivatives, void* unit, const Reference*, std::size_t,
                  const std::int32_t*, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3EvaluateDiscreteStates, void* unit)
RTAMT_UNSUPPORTED(fmi3UpdateDiscreteStates, void* unit, bool*, bool*, bool*, bool*, bool*, double*)
RTAMT_UNSUPPORTED(fmi3EnterContinuousTimeMode, void* unit)
RTAMT_UNSUPPORTED(fmi3CompletedIntegratorStep, void* unit, bool, bool*, bool*)
RTAMT_UNSUPPORTED(fmi3SetTime, void* unit, double)
RTAMT_UNSUPPORTED(fmi3SetContinuousStates, void* unit, const double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetContinuousStateDerivatives, void* unit, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetEventIndicators, void* unit, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetContinuousStates, void* unit, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetNominalsOfContinuousStates, void* unit, double*, std::size_t)
RTAMT_UNSUPPORTED(fmi3GetNumberOfEventIndicators, void* unit, std::size_t*)
RTAMT_UNSUPPORTED(fmi3GetNumberOfContinuousStates, void* unit, std::size_t*)
RTAMT_UNSUPPORTED(fmi3ActivateModelPartition, void* unit, Reference, double)
