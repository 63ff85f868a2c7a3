// The interface of FMI 2.0 for co-simulation: the functions that fmi-standard.org documents, in
// sections 2.1 and 4.2 of version 2.0.4 of the standard.
#include <algorithm>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>

#include "fmu/unit.hpp"

using namespace rtamt::fmu;

namespace {

using Component = void*;
using Boolean = int;

// fmi2CallbackFunctions
struct Callbacks {
    void (*logger)(void* environment, const char* instance, int status, const char* category,
                   const char* format, ...);
    void* (*allocate)(std::size_t count, std::size_t size);
    void (*free)(void* memory);
    void (*finished)(void* environment, int status);
    void* environment;
};

constexpr int kCoSimulation = 1;                          // fmi2Type
enum Kind { kDoStep, kPending, kLastTime, kTerminated };  // fmi2StatusKind

// Importers read the text of a message as a format of printf.
std::string format_of(const std::string& text) {
    std::string format;
    for (const char c : text) format.append(c == '%' ? 2 : 1, c);
    return format;
}

int digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

// The folder that a URI such as file:///tmp/a%20b names.
std::string folder_of(const char* location) {
    const std::string_view uri = location == nullptr ? "" : location;
    std::string_view rest = uri;
    constexpr std::string_view scheme = "file:";
    if (rest.substr(0, scheme.size()) != scheme)
        throw Refusal(
            "expected the location of the resources as a URI such as file:///tmp/unit, "
            "got '" +
            std::string(uri) + "'");
    rest.remove_prefix(scheme.size());
    if (rest.substr(0, 2) == "//") {  // behind it the host, which is this one
        rest.remove_prefix(2);
        rest.remove_prefix(std::min(rest.find('/'), rest.size()));
    }
    std::string path;
    for (std::size_t i = 0; i < rest.size(); ++i) {
        const bool coded = rest[i] == '%' && i + 2 < rest.size() && digit(rest[i + 1]) >= 0 &&
                           digit(rest[i + 2]) >= 0;
        path += coded ? static_cast<char>(16 * digit(rest[i + 1]) + digit(rest[i + 2])) : rest[i];
        if (coded) i += 2;
    }
    return path;
}

}  // namespace

RTAMT_FMI const char* fmi2GetTypesPlatform() { return "default"; }
RTAMT_FMI const char* fmi2GetVersion() { return "2.0"; }

RTAMT_FMI Component fmi2Instantiate(const char* name, int type, const char* guid,
                                    const char* location, const Callbacks* callbacks, Boolean,
                                    Boolean logging) try {
    if (callbacks == nullptr) return nullptr;
    const Unit::Log log = [name = std::string(name == nullptr ? "" : name), to = *callbacks](
                              Status status, const char* category, const std::string& text) {
        if (to.logger != nullptr)
            to.logger(to.environment, name.c_str(), status, category, format_of(text).c_str());
    };
    return make_unit(
        "fmi2Instantiate",
        [=] {
            if (type != kCoSimulation) throw Refusal("expected co-simulation, got model exchange");
            if (name == nullptr || *name == '\0') throw Refusal("expected a name of the instance");
            return folder_of(location);
        },
        guid, log, logging != 0);
} catch (...) {  // no memory for the name
    return nullptr;
}

RTAMT_FMI void fmi2FreeInstance(Component component) { free_unit(component); }

RTAMT_FMI Status fmi2SetDebugLogging(Component component, Boolean on, std::size_t n,
                                     const char* const* categories) {
    return guarded(component, "fmi2SetDebugLogging", [=](Unit& unit) {
        unit.set_logging(on != 0, n, categories);
        return kOk;
    });
}

RTAMT_FMI Status fmi2SetupExperiment(Component component, Boolean, double, double start,
                                     Boolean stops, double stop) {
    return guarded(component, "fmi2SetupExperiment", [=](Unit& unit) {
        unit.instance.set_times(start, stops ? stop : std::numeric_limits<double>::infinity());
        return kOk;
    });
}

RTAMT_RUN(fmi2EnterInitializationMode, begin_initialization)
RTAMT_RUN(fmi2ExitInitializationMode, end_initialization)
RTAMT_RUN(fmi2Terminate, terminate)
RTAMT_RUN(fmi2Reset, reset)

RTAMT_FMI Status fmi2GetReal(Component component, const Reference* references, std::size_t n,
                             double* values) {
    return get_each<&Instance::real>(component, "fmi2GetReal", references, n, values, n);
}

RTAMT_FMI Status fmi2GetInteger(Component component, const Reference* references, std::size_t n,
                                int* values) {
    return get_each<&Instance::integer>(component, "fmi2GetInteger", references, n, values, n);
}

RTAMT_FMI Status fmi2GetBoolean(Component component, const Reference* references, std::size_t n,
                                Boolean* values) {
    return get_each<&Instance::boolean>(component, "fmi2GetBoolean", references, n, values, n);
}

RTAMT_NO_VARIABLES(fmi2GetString, const char**)

RTAMT_FMI Status fmi2SetReal(Component component, const Reference* references, std::size_t n,
                             const double* values) {
    return set_each(component, "fmi2SetReal", references, n, values, n,
                    [](double value) { return value; });
}

RTAMT_NO_VARIABLES(fmi2SetInteger, const int*)

RTAMT_FMI Status fmi2SetBoolean(Component component, const Reference* references, std::size_t n,
                                const Boolean* values) {
    return set_each(component, "fmi2SetBoolean", references, n, values, n,
                    [](Boolean value) { return value != 0; });
}

RTAMT_NO_VARIABLES(fmi2SetString, const char* const*)
RTAMT_STATES(fmi2GetFMUstate, fmi2SetFMUstate, fmi2FreeFMUstate, fmi2SerializedFMUstateSize,
             fmi2SerializeFMUstate, fmi2DeSerializeFMUstate, char)

RTAMT_UNSUPPORTED(fmi2GetDirectionalDerivative, void* unit, const Reference*, std::size_t,
                  const Reference*, std::size_t, const double*, double*)
RTAMT_UNSUPPORTED(fmi2SetRealInputDerivatives, void* unit, const Reference*, std::size_t,
                  const int*, const double*)
RTAMT_UNSUPPORTED(fmi2GetRealOutputDerivatives, void* unit, const Reference*, std::size_t,
                  const int*, double*)

// With `stop_on_violation` a violation discards the steps behind it, and fmi2Terminated says why.
RTAMT_FMI Status fmi2DoStep(Component component, double time, double size, Boolean) {
    return guarded(component, "fmi2DoStep", [=](Unit& unit) {
        if (!unit.instance.step(time, size)) return kOk;
        unit.tell(violation_text(unit.instance));
        return kDiscard;
    });
}

RTAMT_UNSUPPORTED(fmi2CancelStep, void* unit)

RTAMT_FMI Status fmi2GetStatus(Component component, int kind, int* status) {
    return guarded(component, "fmi2GetStatus", [=](Unit& unit) {
        require_array(status, 1);
        if (kind != kDoStep) throw Refusal("expected the kind fmi2DoStepStatus");
        *status = unit.instance.ended() ? kDiscard : kOk;
        return kOk;
    });
}

RTAMT_FMI Status fmi2GetRealStatus(Component component, int kind, double* value) {
    return guarded(component, "fmi2GetRealStatus", [=](Unit& unit) {
        require_array(value, 1);
        if (kind != kLastTime) throw Refusal("expected the kind fmi2LastSuccessfulTime");
        *value = unit.instance.time();
        return kOk;
    });
}

RTAMT_UNSUPPORTED(fmi2GetIntegerStatus, void* unit, int, int*)

RTAMT_FMI Status fmi2GetBooleanStatus(Component component, int kind, Boolean* value) {
    return guarded(component, "fmi2GetBooleanStatus", [=](Unit& unit) {
        require_array(value, 1);
        if (kind != kTerminated) throw Refusal("expected the kind fmi2Terminated");
        *value = unit.instance.ended();
        return kOk;
    });
}

RTAMT_FMI Status fmi2GetStringStatus(Component component, int kind, const char** value) {
    return guarded(component, "fmi2GetStringStatus", [=](Unit&) {
        require_array(value, 1);
        if (kind != kPending) throw Refusal("expected the kind fmi2PendingStatus");
        *value = "";
        return kOk;
    });
}
