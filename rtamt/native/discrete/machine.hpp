// Runs a program whose every register has a latency: rtamt/discrete.py says what that means.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/functions.hpp"
#include "core/window.hpp"

namespace rtamt {

// One instruction, as rtamt/schedule.py encodes it.
struct Row {
    std::size_t slot;
    std::string kind;
    std::string name;
    std::size_t a;
    std::size_t b;
    double value;
    std::size_t length;
    std::int64_t start;
};

// A register to look at, and the samples by which it is late.
struct Observed {
    std::size_t slot;
    std::int64_t latency;
};

#define RTAMT_KINDS(X) X(LOAD) X(CONST) X(MAP) X(WINDOW) X(DELAY)

// What an instruction does, down to the class of the part that it pushes to.
enum class Opcode : std::uint8_t {
#define RTAMT_OPCODE(name, arity, value) map_##name,
    RTAMT_FUNCTIONS(RTAMT_OPCODE)
#undef RTAMT_OPCODE
#define RTAMT_OPCODE(name, Type) latest_##name, running_##name, sliding_##name,
    RTAMT_FOLDS(RTAMT_OPCODE)
#undef RTAMT_OPCODE
    delay,
};

struct Step {
    Opcode opcode;
    std::uint32_t out;
    std::uint32_t a;
    std::uint32_t b;
    std::int64_t start;  // of a window: the first sample at which there is something to take in
    Part* part;
};

struct Load {
    std::uint32_t out;
    std::uint32_t variable;
};

class DiscreteMachine {
public:
    // Rows are checked only as far as memory is concerned: the program was verified in Python.
    // observed[0] is the result; the others are what run gives.
    DiscreteMachine(const std::vector<Row>& rows, std::size_t terms, std::size_t variables,
            const std::vector<Observed>& observed);
    DiscreteMachine(const DiscreteMachine&) = delete;
    DiscreteMachine& operator=(const DiscreteMachine&) = delete;

    std::size_t variables() const { return variables_; }
    std::size_t observed() const { return observed_.size() - 1; }
    std::int64_t samples() const { return samples_; }
    const std::vector<double>& registers() const { return registers_; }
    const double* inputs() const { return inputs_; }  // of no meaning before the first sample

    // One sample: write the variables to pending(), then take it in. False, and nothing changed,
    // if a variable or a term is nan.
    double* pending() { return pending_; }
    bool take();
    // The same, of a sample whose terms are known: registers that stand `stride` apart. There must
    // be no formulas.
    void take(const double* inputs, const double* terms, std::size_t stride);
    // The robustness of time t - latency, nan before there is one.
    double result() const;

    // n samples at once, all or none; outputs are n values for each register that is observed.
    // Final: the trace ends with them, outputs are the values of times 0 to n - 1, and the machine
    // is of no use after that. Gives the place of the first sample with a nan, or n.
    std::size_t run(const double* const* columns, std::size_t n, bool final,
                    double* const* outputs);

    static constexpr const char* kForeign =
        "expected a state that a native machine with this program gave; "
        "those of other programs, back-ends or processors do not fit";

    std::uint64_t mark() const { return fingerprint_; }  // of the program

    void reset();
    std::string state() const;
    // Throws std::invalid_argument on what is no state of this machine.
    void restore(std::string_view bytes);

private:
    class Block;
    friend class DiscreteBank;
    friend class LaneColumns;

    void compile(const Row& row, std::size_t terms);
    Step window(const Row& row);

    std::vector<double> registers_;
    std::vector<double> initial_;
    std::size_t variables_;
    std::vector<Load> loads_;
    std::vector<Step> terms_;
    std::vector<Step> formulas_;
    std::vector<std::unique_ptr<Part>> parts_;
    std::vector<Observed> observed_;
    std::vector<double> samples_in_;
    double* pending_;
    double* inputs_;
    std::int64_t samples_ = 0;
    std::uint64_t fingerprint_;
};

}  // namespace rtamt
