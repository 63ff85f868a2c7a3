#include "fmu/engine.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <string_view>

namespace rtamt::fmu {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Reads or writes the state of a machine as a field of its engine's state.
template <class M>
void machine_fields(Snapshot& s, M& machine) {
    std::string state = s.reads() ? std::string() : state_of(machine);
    std::vector<char> bytes(state.begin(), state.end());
    s.sized(bytes);
    if (s.reads()) restore_from(machine, {bytes.data(), bytes.size()});
}

// Says why values at a time are refused.
[[noreturn]] void refuse(const Program& program, const double* inputs, double time) {
    const std::string when = ", at " + number_text(time) + " s";
    const std::size_t n = program.inputs.size();
    std::string text;
    for (std::size_t i = 0; i < n; ++i) {
        if (std::isnan(inputs[i]))
            throw Refusal("expected a number as input '" + program.inputs[i].name + "', got nan" +
                          when);
        text += (i > 0 ? ", " : "") + program.inputs[i].name + "=" + number_text(inputs[i]);
    }
    throw Refusal("a term of the specification is not a number for " + text + when);
}

// An episode and named formulas, sample by sample.
class SampledEngine final : public Engine {
public:
    SampledEngine(const Program& program, const std::vector<double>& numbers) : program_(program) {
        const std::size_t variables = program.inputs.size();
        if (program.monitor) {
            const MonitorProgram& m = *program.monitor;
            // The machine wants to be observed, even if all formulas are judged by episodes.
            monitor_ = std::make_unique<DiscreteMachine>(
                m.rows.with(numbers), m.terms, variables,
                m.observed.empty() ? std::vector<Observed>{{0, 0}} : m.observed);
        }
        for (const EpisodeProgram& e : program.episodes)
            episodes_.push_back(std::make_unique<EpisodeMachine>(
                e.terms.with(numbers), variables, e.formulas, e.initial, e.streams));
        worst_ = episodes_.front().get();
        best_ = episodes_[program.readings - 1].get();
    }

    void step(const double* inputs, double time, std::size_t samples) override {
        for (; samples > 0; --samples) {
            // The monitor has the terms of the episodes: it refuses what they refuse.
            if (monitor_) take(*monitor_, inputs, time);
            for (const auto& episode : episodes_) take(*episode, inputs, time);
        }
    }

    // Of neutral predicates as 0.0 the robustness and the upper bound, as -0.0 the lower.
    double robustness() const override { return best_->result(); }
    double lower() const override { return worst_->lower(); }
    double upper() const override { return best_->upper(); }

    double formula(std::size_t index) const override {
        const NamedFormula& formula = program_.formulas[index];
        if (formula.episode) return episodes_[*formula.episode]->result();
        const Observed& o = program_.monitor->observed[formula.observed];
        return monitor_->samples() > o.latency ? monitor_->registers()[o.slot] : kNan;
    }

    void fields(Snapshot& s) override {
        if (monitor_) machine_fields(s, *monitor_);
        for (const auto& episode : episodes_) {
            machine_fields(s, *episode);
            s.require(episode->samples() == best_->samples());
        }
        s.require(!monitor_ || monitor_->samples() == best_->samples());
    }

private:
    template <class M>
    void take(M& machine, const double* inputs, double time) {
        std::copy_n(inputs, machine.variables(), machine.pending());
        if (!machine.take()) [[unlikely]] refuse(program_, inputs, time);
    }

    const Program& program_;
    std::unique_ptr<DiscreteMachine> monitor_;
    std::vector<std::unique_ptr<EpisodeMachine>> episodes_;
    EpisodeMachine* worst_;
    EpisodeMachine* best_;
};

// A monitor of events: every variable has one at the begin of every step.
class DenseEngine final : public Engine {
public:
    DenseEngine(const Program& program, const std::vector<double>& numbers)
        : program_(program),
          dense_(*program.dense),
          machine_(dense_.rows.with(numbers), dense_.terms,
                   std::vector<double>(program.inputs.size(), kNan), dense_.result,
                   dense_.observed),
          formulas_(dense_.observed.size(), kNan) {}

    void step(const double* inputs, double time, std::size_t) override {
        dense::Time tick = 0;
        if (!count(time, tick))
            throw Refusal("expected a time that ticks can count, got " + number_text(time) + " s");
        std::vector<dense::Pending>& pending = machine_.pending();
        for (std::size_t v = 0; v < pending.size(); ++v) {
            if (std::isnan(inputs[v])) refuse(program_, inputs, time);
            pending[v].times.assign(1, tick);
            pending[v].values.assign(1, inputs[v]);
            if (!machine_.sampler().fits(v, pending[v].events()))
                throw Refusal("expected steps of a tick at least; two begin on the tick of " +
                              number_text(time) + " s");
        }
        if (!machine_.take()) refuse(program_, inputs, time);
        machine_.drain([this](dense::Time, double value) {
            if (std::isnan(last_)) first_ = value;
            last_ = value;
        });
        formulas_ = machine_.values();
    }

    double robustness() const override { return last_; }
    double lower() const override { return known(Bounds::greatest, -kInfinity); }
    double upper() const override { return known(Bounds::least, kInfinity); }
    double formula(std::size_t index) const override { return formulas_[index]; }

    void fields(Snapshot& s) override {
        machine_fields(s, machine_);
        s(first_, last_);
        s.array(formulas_.data(), formulas_.size());
    }

private:
    bool count(double time, dense::Time& tick) const {
        if (dense_.clock.count(time, tick)) return true;
        // In the middle between two ticks, or a double that no decimal of the clock reads as.
        return dense_.clock.nearest(time, tick);
    }
    // A bound, which is unknown before the first robustness.
    double known(Bounds running, double unknown) const {
        if (std::isnan(last_)) return unknown;
        if (dense_.bounds == Bounds::first) return first_;
        return dense_.bounds == running ? last_ : unknown;
    }

    const Program& program_;
    const DenseProgram& dense_;
    DenseMachine machine_;
    std::vector<double> formulas_;
    double first_ = kNan;  // robustness at the begin of the trace
    double last_ = kNan;   // the last that is settled
};

}  // namespace

std::unique_ptr<Engine> make_engine(const Program& program, const std::vector<double>& parameters) {
    const std::vector<double> numbers = program.numbers(parameters);
    if (program.dense) return std::make_unique<DenseEngine>(program, numbers);
    return std::make_unique<SampledEngine>(program, numbers);
}

}  // namespace rtamt::fmu
