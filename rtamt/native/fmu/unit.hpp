// What the interfaces of FMI 2.0 and 3.0 share: an instance behind a pointer of C, its log, and the
// states that were taken of it.
#pragma once

#include <cstddef>
#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "fmu/instance.hpp"

// The functions of FMI, which alone are seen from outside.
#if defined(_WIN32)
#define RTAMT_FMI extern "C" __declspec(dllexport)
#else
#define RTAMT_FMI extern "C" __attribute__((visibility("default")))
#endif

namespace rtamt::fmu {

// In both versions these statuses have these numbers.
enum Status : int { kOk, kWarning, kDiscard, kError, kFatal };

inline constexpr const char* kErrors = "logStatusError";  // always logged
inline constexpr const char* kEvents = "logEvents";       // logged on demand

class Unit {
public:
    using Log = std::function<void(Status, const char* category, const std::string& text)>;

    // Reads the program of a folder. Throws Refusal if its token is another.
    Unit(const std::string& folder, std::string_view token, Log log, bool logging);

    Instance instance;

    // Logs why a call is refused.
    Status refuse(const char* call, const char* why) noexcept;
    void tell(const std::string& event) const {
        if (logging_) log_(kOk, kEvents, event);
    }
    void set_logging(bool on, std::size_t n, const char* const* categories);

    // Takes the state, in place of the given one if there is one; gives the address of it.
    void* take_state(void* given);
    void restore(void* state) { instance.restore(*find(state)); }
    void free_state(void* state);
    std::size_t size_of(void* state) { return find(state)->size() + sizeof(std::uint64_t); }
    // The state as bytes with their hash, and back.
    void write_state(void* state, char* bytes, std::size_t size);
    void* read_state(const char* bytes, std::size_t size, void* given);

private:
    using State = std::unique_ptr<std::string>;

    State& find(void* state);
    void* keep(std::string state, void* given);

    Log log_;
    bool logging_;
    std::vector<State> states_;
};

// What is told where a violation ends the simulation.
inline std::string violation_text(const Instance& instance) {
    return "violated: the simulation is to end at " + number_text(instance.time()) + " s";
}

// Makes a unit; null, with the reason logged, if it cannot be made.
void* make_unit(const char* call, const std::function<std::string()>& folder, const char* token,
                const Unit::Log& log, bool logging) noexcept;

inline void free_unit(void* unit) noexcept { delete static_cast<Unit*>(unit); }

// Throws Refusal if values are asked for or given in an array that is not there.
void require_array(const void* array, std::size_t n);
void refuse_arrays(const void* references, std::size_t n, const void* values, std::size_t size);
inline void require_arrays(const void* references, std::size_t n, const void* values,
                           std::size_t size) {
    if (references == nullptr || values == nullptr || size != n) [[unlikely]]
        refuse_arrays(references, n, values, size);
}

// Runs a call of C on a unit: no exception leaves it.
template <class Call>
Status guarded(void* pointer, const char* name, Call call) noexcept {
    if (pointer == nullptr) return kError;
    Unit& unit = *static_cast<Unit*>(pointer);
    try {
        return call(unit);
    } catch (const std::exception& error) {
        return unit.refuse(name, error.what());
    } catch (...) {
        return unit.refuse(name, "unknown error");
    }
}

// Asks for a value for every reference, by a method of the instance.
template <auto get, class T>
Status get_each(void* pointer, const char* name, const Reference* references, std::size_t n,
                T* values, std::size_t size) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        require_arrays(references, n, values, size);
        for (std::size_t i = 0; i < n; ++i) values[i] = (unit.instance.*get)(references[i]);
        return kOk;
    });
}

// Sets the variables of these references, all or none, to what `as` makes of the values.
template <class T, class As>
Status set_each(void* pointer, const char* name, const Reference* references, std::size_t n,
                const T* values, std::size_t size, As as) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        require_arrays(references, n, values, size);
        for (std::size_t i = 0; i < n; ++i) unit.instance.settable(references[i], as(values[i]));
        for (std::size_t i = 0; i < n; ++i)
            unit.instance.settable(references[i], as(values[i])) = as(values[i]);
        return kOk;
    });
}

// Refuses references of a type that no variable has.
inline Status no_variables(void* pointer, const char* name, std::size_t n) noexcept {
    return guarded(pointer, name, [=](Unit&) {
        if (n > 0) throw Refusal("expected no value references, as no variable has this type");
        return kOk;
    });
}

// Runs a call that the instance has too.
inline Status run(void* pointer, const char* name, void (Instance::*call)()) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        (unit.instance.*call)();
        return kOk;
    });
}

// The calls about states: where one is given at `state`, it is written again.
Status get_state(void* pointer, const char* name, void** state) noexcept;
Status set_state(void* pointer, const char* name, void* state) noexcept;
Status free_state(void* pointer, const char* name, void** state) noexcept;
Status state_size(void* pointer, const char* name, void* state, std::size_t* size) noexcept;
Status serialize(void* pointer, const char* name, void* state, void* bytes,
                 std::size_t size) noexcept;
Status deserialize(void* pointer, const char* name, const void* bytes, std::size_t size,
                   void** state) noexcept;

// A call that this kind of unit does not have.
inline Status unsupported(void* unit, const char* name) noexcept {
    return guarded(unit, name, [](Unit&) -> Status {
        throw Refusal("this unit has no such call; modelDescription.xml says what it has");
    });
}

}  // namespace rtamt::fmu

// Calls that both versions have under their own names. A unit is a pointer of C here.
#define RTAMT_RUN(name, method) \
    RTAMT_FMI Status name(void* unit) { return run(unit, #name, &Instance::method); }
#define RTAMT_STATES(get, set, free, size_of, write, read, Byte)                               \
    RTAMT_FMI Status get(void* unit, void** state) { return get_state(unit, #get, state); }    \
    RTAMT_FMI Status set(void* unit, void* state) { return set_state(unit, #set, state); }     \
    RTAMT_FMI Status free(void* unit, void** state) { return free_state(unit, #free, state); } \
    RTAMT_FMI Status size_of(void* unit, void* state, std::size_t* size) {                     \
        return state_size(unit, #size_of, state, size);                                        \
    }                                                                                          \
    RTAMT_FMI Status write(void* unit, void* state, Byte* bytes, std::size_t size) {           \
        return serialize(unit, #write, state, bytes, size);                                    \
    }                                                                                          \
    RTAMT_FMI Status read(void* unit, const Byte* bytes, std::size_t size, void** state) {     \
        return deserialize(unit, #read, bytes, size, state);                                   \
    }
// Calls about types that no variable has, after the array of n references.
#define RTAMT_NO_VARIABLES(name, ...)                                                 \
    RTAMT_FMI Status name(void* unit, const Reference*, std::size_t n, __VA_ARGS__) { \
        return no_variables(unit, #name, n);                                          \
    }
// Calls that units of this kind do not have; their capabilities state it. Every list of parameters
// begins with `void* unit`.
#define RTAMT_UNSUPPORTED(name, ...) \
    RTAMT_FMI Status name(__VA_ARGS__) { return unsupported(unit, #name); }
