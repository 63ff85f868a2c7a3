#include "fmu/instance.hpp"

#include <cmath>
#include <limits>
#include <new>
#include <utility>

namespace rtamt::fmu {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMostSamples = 0x1p31;  // in a step

// Importers add steps up, or multiply: what differs by less is the same time or size.
constexpr double kTolerance = 1e-6;

std::vector<double> starts(const std::vector<Named>& variables) {
    std::vector<double> values;
    for (const Named& each : variables) values.push_back(each.start);
    return values;
}

const char* text_of(Phase phase) {
    switch (phase) {
        case Phase::instantiated:
            return "before initialization";
        case Phase::initializing:
            return "in initialization";
        case Phase::stepping:
            return "after initialization";
        case Phase::terminated:
            return "after terminate";
        case Phase::lost:
            break;
    }
    return "after a step in which memory ran out";
}

}  // namespace

Instance::Instance(Program program)
    : program_(std::move(program)),
      now_(initial()),
      engine_(make_engine(program_, now_.parameters)) {}

Instance::Now Instance::initial() const {
    Now now;
    now.stop_on_violation = program_.stop;
    now.stop = kInfinity;
    now.inputs = starts(program_.inputs);
    now.parameters = starts(program_.parameters);
    return now;
}

std::size_t Instance::place(Reference reference) const {
    const std::size_t size = program_.inputs.size() + program_.parameters.size() +
                             program_.fixed.size() + program_.formulas.size();
    if (reference < kFirst || reference - kFirst >= size)
        throw Refusal("expected the value reference of a variable of this type, got " +
                      std::to_string(reference));
    return reference - kFirst;
}

double Instance::other_real(Reference reference) const {
    if (reference == kTime) return now_.time;
    std::size_t i = place(reference);
    if (i < now_.inputs.size()) return now_.inputs[i];
    i -= now_.inputs.size();
    if (i < now_.parameters.size()) return now_.parameters[i];
    i -= now_.parameters.size();
    if (i < program_.fixed.size()) return program_.fixed[i].start;
    return engine_->formula(i - program_.fixed.size());
}

double& Instance::other_settable(Reference reference, double value) {
    if (now_.phase == Phase::lost) refuse_lost();
    if (reference < kFirst)
        throw Refusal("expected the value reference of an input or a parameter, got " +
                      std::to_string(reference));
    std::size_t i = place(reference);
    if (i < now_.inputs.size())
        throw Refusal("an input cannot be set after terminate; reset the instance");
    i -= now_.inputs.size();
    if (i >= now_.parameters.size())
        throw Refusal("expected the value reference of an input or a parameter, got " +
                      std::to_string(reference));
    const std::string& name = program_.parameters[i].name;
    if (now_.phase > Phase::initializing)
        throw Refusal("the parameter '" + name + "' can be set until initialization ends");
    if (!std::isfinite(value))  // as a text's constants have to be
        throw Refusal("expected a finite number as parameter '" + name + "', got " +
                      number_text(value));
    return now_.parameters[i];
}

int Instance::integer(Reference reference) const {
    if (now_.phase == Phase::lost) refuse_lost();
    if (reference != kVerdict)
        throw Refusal("expected the value reference 4, of 'verdict', got " +
                      std::to_string(reference));
    return engine_->verdict();
}

bool Instance::boolean(Reference reference) const {
    if (reference != kStopOnViolation)
        throw Refusal("expected the value reference 5, of 'stop_on_violation', got " +
                      std::to_string(reference));
    return now_.stop_on_violation;
}

bool& Instance::settable(Reference reference, bool) {
    boolean(reference);
    if (now_.phase > Phase::initializing)
        throw Refusal("the parameter 'stop_on_violation' can be set until initialization ends");
    return now_.stop_on_violation;
}

void Instance::refuse_phase(const char* what) const {
    throw Refusal(std::string("expected the call ") + what + ", got it " + text_of(now_.phase));
}

void Instance::refuse_lost() {
    throw Refusal("memory ran out in a step: reset the instance, or restore a state of before");
}

void Instance::set_times(double start, double stop) {
    require(Phase::instantiated, "before initialization");
    if (!std::isfinite(start) || std::isnan(stop))
        throw Refusal("expected times that are numbers, got " + number_text(start) + " to " +
                      number_text(stop));
    now_.time = start;
    now_.stop = stop;
}

void Instance::begin_initialization() {
    require(Phase::instantiated, "before initialization");
    now_.phase = Phase::initializing;
}

void Instance::end_initialization() {
    require(Phase::initializing, "in initialization");
    for (double& value : now_.parameters) value += 0.0;  // no -0.0, as in a text's constants
    engine_ = make_engine(program_, now_.parameters);
    now_.phase = Phase::stepping;
}

std::size_t Instance::samples(double size, double& fraction) const {
    if (size == program_.period && fraction == 0) return 1;
    const double steps = size / program_.period;
    double end = fraction + steps;
    if (!(end < kMostSamples))
        throw Refusal("expected a step of less than 2^31 periods of " +
                      number_text(program_.period) + " s, got " + number_text(size) + " s");
    const double whole = std::nearbyint(end);
    if (std::abs(end - whole) < kTolerance * std::min(1.0, steps)) end = whole;
    const double due = std::ceil(end) - (fraction > 0 ? 1.0 : 0.0);
    fraction = end - std::floor(end);
    return static_cast<std::size_t>(due);
}

bool Instance::step(double time, double size) {
    require(Phase::stepping, "after initialization");
    if (!(size > 0 && std::isfinite(size)))
        throw Refusal("expected a finite step of more than 0 s, got " + number_text(size) + " s");
    const double slack = kTolerance * size + 1e-12 * std::abs(now_.time);
    if (!(std::abs(time - now_.time) <= slack))
        throw Refusal("expected a step from " + number_text(now_.time) +
                      " s, where the last one ended, got one from " + number_text(time) + " s");
    if (!(time + size <= now_.stop + slack))
        throw Refusal("expected steps until the stop time, " + number_text(now_.stop) +
                      " s, got one to " + number_text(time + size) + " s");
    double fraction = now_.fraction;
    const std::size_t due = program_.period > 0 ? samples(size, fraction) : 1;
    try {
        engine_->step(now_.inputs.data(), time, due);
    } catch (const std::bad_alloc&) {
        now_.phase = Phase::lost;
        refuse_lost();
    }
    now_.fraction = fraction;
    now_.time = time + size;
    now_.ended = now_.stop_on_violation && engine_->verdict() < 0;
    return now_.ended;
}

void Instance::terminate() {
    require(Phase::stepping, "after initialization");
    now_.phase = Phase::terminated;
}

void Instance::reset() {
    Now now = initial();
    engine_ = make_engine(program_, now.parameters);
    now_ = std::move(now);
}

void Instance::Now::fields(Snapshot& s) {
    s(phase, stop_on_violation, ended, time, stop, fraction);
    s.array(inputs.data(), inputs.size());
    s.numbers(parameters.data(), parameters.size());
    s.require(phase <= Phase::terminated && std::isfinite(time) && !std::isnan(stop) &&
              fraction >= 0 && fraction < 1);
}

std::string Instance::state() {
    if (now_.phase == Phase::lost) refuse_lost();
    Snapshot out;
    std::uint64_t fingerprint = program_.fingerprint;
    out(fingerprint);
    now_.fields(out);
    engine_->fields(out);
    return std::move(out).written();
}

Instance::Restored Instance::restored(std::string_view state) const {
    Snapshot in(state);
    std::uint64_t fingerprint = 0;
    in(fingerprint);
    if (fingerprint != program_.fingerprint)
        throw Refusal("expected a state of this unit, got a state of another");
    Restored made{initial(), nullptr};
    made.now.fields(in);
    // Until initialization ends an engine has the constants of the start.
    const bool started = made.now.phase > Phase::initializing;
    made.engine =
        make_engine(program_, started ? made.now.parameters : starts(program_.parameters));
    made.engine->fields(in);
    in.require(in.unread() == 0);
    return made;
}

void Instance::restore(std::string_view state) {
    Restored made = restored(state);
    now_ = std::move(made.now);
    engine_ = std::move(made.engine);
}

}  // namespace rtamt::fmu
