#include "fmu/unit.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "core/snapshot.hpp"

namespace rtamt::fmu {
namespace {

Program program_of(const std::string& folder, std::string_view token) {
    Program program = read_program(folder);
    if (program.token != token)
        throw Refusal("expected the token " + program.token + " of program.rtamt, got '" +
                      std::string(token) + "'; the files of the unit do not belong together");
    return program;
}

std::uint64_t hash_of(std::string_view bytes) {
    Fingerprint print;
    for (const char c : bytes) print.add(c);
    return print.value();
}

std::string said(const char* call, const char* what) { return std::string(call) + ": " + what; }

}  // namespace

Unit::Unit(const std::string& folder, std::string_view token, Log log, bool logging)
    : instance(program_of(folder, token)), log_(std::move(log)), logging_(logging) {}

Status Unit::refuse(const char* call, const char* why) noexcept {
    try {
        log_(kError, kErrors, said(call, why));
    } catch (...) {  // no memory for the text
    }
    return kError;
}

void Unit::set_logging(bool on, std::size_t n, const char* const* categories) {
    require_array(categories, n);
    bool events = n == 0;
    for (std::size_t i = 0; i < n; ++i) {
        const std::string_view category = categories[i] == nullptr ? "" : categories[i];
        if (category != kErrors && category != kEvents)
            throw Refusal(std::string("expected the categories ") + kErrors + " and " + kEvents +
                          ", got '" + std::string(category) + "'");
        events |= category == kEvents;
    }
    if (events) logging_ = on;
}

Unit::State& Unit::find(void* state) {
    const auto found = std::find_if(states_.begin(), states_.end(),
                                    [=](const State& each) { return each.get() == state; });
    if (found == states_.end())
        throw Refusal("expected a state that was taken of this instance and is not freed");
    return *found;
}

void* Unit::keep(std::string state, void* given) {
    if (given != nullptr) {
        State& kept = find(given);
        *kept = std::move(state);
        return kept.get();
    }
    states_.push_back(std::make_unique<std::string>(std::move(state)));
    return states_.back().get();
}

void* Unit::take_state(void* given) {
    if (given != nullptr) find(given);
    return keep(instance.state(), given);
}

void Unit::free_state(void* state) {
    std::swap(find(state), states_.back());
    states_.pop_back();
}

void Unit::write_state(void* state, char* bytes, std::size_t size) {
    const std::string& kept = *find(state);
    require_array(bytes, size);
    if (size < size_of(state))
        throw Refusal("expected room for " + std::to_string(size_of(state)) + " bytes, got " +
                      std::to_string(size));
    const std::uint64_t hash = hash_of(kept);
    std::memcpy(bytes, kept.data(), kept.size());
    std::memcpy(bytes + kept.size(), &hash, sizeof hash);
}

void* Unit::read_state(const char* bytes, std::size_t size, void* given) {
    require_array(bytes, size);
    std::uint64_t hash = 0;
    std::string state;
    if (size >= sizeof hash) {
        state.assign(bytes, size - sizeof hash);
        std::memcpy(&hash, bytes + state.size(), sizeof hash);
    }
    if (state.empty() || hash != hash_of(state))
        throw Refusal("expected the bytes of a state, got damaged ones");
    // That it fits is found out here, and not when the simulation is to go on from it.
    instance.require_state(state);
    return keep(std::move(state), given);
}

void* make_unit(const char* call, const std::function<std::string()>& folder, const char* token,
                const Unit::Log& log, bool logging) noexcept {
    try {
        try {
            return new Unit(folder(), token == nullptr ? "" : token, log, logging);
        } catch (const std::exception& error) {
            log(kError, kErrors, said(call, error.what()));
        }
    } catch (...) {  // no memory for the text
    }
    return nullptr;
}

void require_array(const void* array, std::size_t n) {
    if (array == nullptr && n > 0) throw Refusal("expected an array, got a null pointer");
}

// Nothing may be there for no values.
void refuse_arrays(const void* references, std::size_t n, const void* values, std::size_t size) {
    require_array(references, n);
    require_array(values, n);
    if (size != n)
        throw Refusal("expected a value for each of " + std::to_string(n) +
                      " value references, got " + std::to_string(size));
}

Status get_state(void* pointer, const char* name, void** state) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        require_array(state, 1);
        *state = unit.take_state(*state);
        return kOk;
    });
}

Status set_state(void* pointer, const char* name, void* state) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        unit.restore(state);
        return kOk;
    });
}

Status free_state(void* pointer, const char* name, void** state) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        require_array(state, 1);
        if (*state != nullptr) unit.free_state(*state);
        *state = nullptr;
        return kOk;
    });
}

Status state_size(void* pointer, const char* name, void* state, std::size_t* size) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        require_array(size, 1);
        *size = unit.size_of(state);
        return kOk;
    });
}

Status serialize(void* pointer, const char* name, void* state, void* bytes,
                 std::size_t size) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        unit.write_state(state, static_cast<char*>(bytes), size);
        return kOk;
    });
}

Status deserialize(void* pointer, const char* name, const void* bytes, std::size_t size,
                   void** state) noexcept {
    return guarded(pointer, name, [=](Unit& unit) {
        require_array(state, 1);
        *state = unit.read_state(static_cast<const char*>(bytes), size, *state);
        return kOk;
    });
}

}  // namespace rtamt::fmu
