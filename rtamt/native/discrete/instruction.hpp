// Instructions of the discrete machine, and the rows that encode them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "core/functions.hpp"
#include "core/windows.hpp"

namespace rtamt {

#define RTAMT_KINDS(X) X(LOAD) X(CONST) X(MAP) X(WINDOW) X(DELAY)

// One instruction as Python encodes it.
struct DiscreteRow {
    std::size_t slot;
    std::string kind;
    std::string name;
    std::size_t a;
    std::size_t b;
    double value;
    std::size_t length;
    std::int64_t start;
};

// One instruction behind the terms as Python encodes it: MAP, or WINDOW over the offsets lo to hi,
// in samples or in positions of dense time. It writes the next register after the row before.
struct FormulaRow {
    std::string kind;
    std::string name;
    std::size_t a;
    std::size_t b;
    std::optional<std::int64_t> lo;  // nothing: no bound
    std::optional<std::int64_t> hi;
    bool guard;  // these two as in rtamt/program/instructions.py
    bool endless;
};

enum class Opcode : std::uint8_t {
#define RTAMT_OPCODE(name, arity, value) map_##name,
    RTAMT_FUNCTIONS(RTAMT_OPCODE)
#undef RTAMT_OPCODE
#define RTAMT_OPCODE(name, Type) latest_##name, running_##name, sliding_##name,
        RTAMT_FOLDS(RTAMT_OPCODE)
#undef RTAMT_OPCODE
            delay,
};

struct Instruction {
    Opcode opcode;
    std::uint32_t out;
    std::uint32_t a;
    std::uint32_t b;
    std::int64_t start;  // of a window: the first sample at which it takes its operands in
    Memory* memory;
};

struct Load {
    std::uint32_t out;
    std::uint32_t variable;
};

// Calls what the opcode says: `map` for a function, `window` for a class of windows, or `delay`.
template <class Map, class Window, class Delay>
inline void dispatch(Opcode opcode, Map map, Window window, Delay delay) {
    switch (opcode) {
#define RTAMT_CASE(name, arity, value) \
    case Opcode::map_##name:           \
        return map.template operator()<functions::name>();
        RTAMT_FUNCTIONS(RTAMT_CASE)
#undef RTAMT_CASE
#define RTAMT_CASE(name, Type)                                    \
    case Opcode::latest_##name:                                   \
        return window.template operator()<LatestWindow<Type>>();  \
    case Opcode::running_##name:                                  \
        return window.template operator()<RunningWindow<Type>>(); \
    case Opcode::sliding_##name:                                  \
        return window.template operator()<SlidingWindow<Type>>();
        RTAMT_FOLDS(RTAMT_CASE)
#undef RTAMT_CASE
        case Opcode::delay:
            return delay();
    }
}

}  // namespace rtamt
