// One instance of a unit: its variables, its time and its engine, without any interface of C.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/snapshot.hpp"
#include "fmu/program.hpp"

namespace rtamt::fmu {

// The machines of a unit, and what they find in a step.
class Engine {
public:
    virtual ~Engine() = default;

    // Takes in the values of the inputs on [time, time + size), of which samples are taken at these
    // many times. Throws Refusal, and changes nothing, if they are refused.
    virtual void step(const double* inputs, double time, std::size_t samples) = 0;

    virtual double robustness() const = 0;
    virtual double lower() const = 0;
    virtual double upper() const = 0;
    virtual double formula(std::size_t index) const = 0;
    int verdict() const { return verdict_of(lower(), upper()); }

    // Reading is done by a new engine, of which nothing is left if it throws.
    virtual void fields(Snapshot& s) = 0;
};

// The engine of a program whose parameters have these values. Throws Refusal if there is none.
std::unique_ptr<Engine> make_engine(const Program& program, const std::vector<double>& parameters);

// The value references of a unit's own variables; the other variables begin at kFirst.
// rtamt/export/fmu.py lists them.
using Reference = std::uint32_t;
enum : Reference {
    kTime,
    kRobustness,
    kLower,
    kUpper,
    kVerdict,
    kStopOnViolation,
    kFirst = 8,
};

// Memory can run out in the middle of a step: what the instance knew is lost then.
enum class Phase : std::uint8_t { instantiated, initializing, stepping, terminated, lost };

// Every call either does what it says, or throws an exception and changes nothing, but for a step
// in which memory runs out: until the instance is reset, or a state is restored, it refuses others.
class Instance {
public:
    explicit Instance(Program program);
    Instance(const Instance&) = delete;
    Instance& operator=(const Instance&) = delete;

    double real(Reference reference) const {
        if (now_.phase == Phase::lost) [[unlikely]]
            refuse_lost();
        if (reference == kRobustness) return engine_->robustness();
        if (reference == kLower) return engine_->lower();
        if (reference == kUpper) return engine_->upper();
        return other_real(reference);
    }
    int integer(Reference reference) const;
    bool boolean(Reference reference) const;
    // The variable that may be set to a value now.
    double& settable(Reference reference, double value) {
        const std::size_t i = std::size_t{reference} - kFirst;
        if (i < now_.inputs.size() && now_.phase < Phase::terminated) return now_.inputs[i];
        return other_settable(reference, value);
    }
    bool& settable(Reference reference, bool value);

    // These go through the phases.
    void set_times(double start, double stop);  // stop: inf if there is none
    void begin_initialization();
    void end_initialization();
    // Returns whether the simulation is to end.
    bool step(double time, double size);
    void terminate();
    void reset();

    void require(Phase phase, const char* what) const {
        if (now_.phase != phase) refuse_phase(what);
    }
    double time() const { return now_.time; }  // of the end of the last step
    bool ended() const { return now_.ended; }  // whether the last step asked to end the simulation

    std::string state();
    void restore(std::string_view state);
    // Throws what restoring the state would throw.
    void require_state(std::string_view state) const { restored(state); }

private:
    // All that changes but the engine.
    struct Now {
        Phase phase = Phase::instantiated;
        bool stop_on_violation = false;
        bool ended = false;
        double time = 0.0;
        double stop = 0.0;
        double fraction = 0.0;  // of a period since the last time of a sample; 0: it is now
        std::vector<double> inputs;
        std::vector<double> parameters;

        void fields(Snapshot& s);
    };

    struct Restored {
        Now now;
        std::unique_ptr<Engine> engine;
    };

    Now initial() const;
    Restored restored(std::string_view state) const;
    double other_real(Reference reference) const;
    double& other_settable(Reference reference, double value);
    [[noreturn]] void refuse_phase(const char* what) const;
    [[noreturn]] static void refuse_lost();
    // The variable behind a reference, counted from the first input.
    std::size_t place(Reference reference) const;
    // The samples of a step, and what `fraction` is after it.
    std::size_t samples(double size, double& fraction) const;

    const Program program_;
    Now now_;
    std::unique_ptr<Engine> engine_;
};

}  // namespace rtamt::fmu
