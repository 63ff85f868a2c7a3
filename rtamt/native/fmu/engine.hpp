// Engines: the machines of a unit, and what they say after a step.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "core/snapshot.hpp"
#include "fmu/program.hpp"

namespace rtamt::fmu {

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

}  // namespace rtamt::fmu
