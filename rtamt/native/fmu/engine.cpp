#include "fmu/instance.hpp"

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
            episodes_.push_back(std::make_unique<EpisodeMachine>(episode::Program{
                e.terms.with(numbers), variables, e.formulas, e.initial, e.streams}));
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
        for (const auto& episode : episodes_) machine_fields(s, *episode);
        for (const auto& episode : episodes_) s.require(episode->samples() == best_->samples());
        s.require(!monitor_ || monitor_->samples() == best_->samples());
    }

private:
    template <class M>
    void take(M& machine, const double* inputs, double time) {
        std::copy_n(inputs, machine.variables(), machine.pending());
        if (!machine.take()) [[unlikely]]
            refuse(program_, inputs, time);
    }

    const Program& program_;
    std::unique_ptr<DiscreteMachine> monitor_;
    std::vector<std::unique_ptr<EpisodeMachine>> episodes_;
    EpisodeMachine* worst_;
    EpisodeMachine* best_;
};

// An episode and named formulas over dense time: every variable has an event at the begin of every
// step.
class DenseEngine final : public Engine {
public:
    DenseEngine(const Program& program, const std::vector<double>& numbers) : program_(program) {
        const std::vector<double> declared(program.inputs.size(), kNan);
        if (program.dense) {
            const DenseProgram& m = *program.dense;
            monitor_ = std::make_unique<DenseMachine>(m.rows.with(numbers), m.terms, declared, 0,
                                                      m.observed);
            values_.assign(m.observed.size(), kNan);
        }
        std::vector<RegionProgram> readings;
        for (const EpisodeProgram& e : program.regions) {
            readings.push_back({{}, e.formulas, e.initial, e.streams, e.unknowns});
            for (DiscreteRow& row : e.terms.with(numbers))
                readings.back().terms.push_back(
                    {row.kind, row.name, row.a, row.b, row.value, {}, {}});
            if (episodes_.empty() && readings.size() < program.readings) continue;
            episodes_.push_back(
                std::make_unique<DenseEpisodeMachine>(readings, declared, e.reach, false));
            readings.clear();
        }
    }

    void step(const double* inputs, double time, std::size_t) override {
        dense::Time tick = 0;
        if (!count(time, tick))
            throw Refusal("expected a time that ticks can count, got " + number_text(time) + " s");
        for (std::size_t v = 0; v < program_.inputs.size(); ++v)
            if (std::isnan(inputs[v])) refuse(program_, inputs, time);
        if (!(tick > episodes_.front()->settled()))
            throw Refusal("expected steps of a tick at least; two begin on the tick of " +
                          number_text(time) + " s");
        for (const auto& episode : episodes_)
            if (!episode->reaches(tick))
                throw Refusal(
                    "expected a trace of less than 2^62 ticks with the bounds of the "
                    "formula, got a step at " +
                    number_text(time) + " s; export with a greater resolution");
        // The monitor has the terms of the episodes: it refuses what they refuse.
        if (monitor_) {
            give(*monitor_, inputs, tick);
            if (!monitor_->take()) refuse(program_, inputs, time);
            monitor_->drain([](dense::Time, double) {});
            values_ = monitor_->values();
        }
        for (const auto& episode : episodes_) {
            give(*episode, inputs, tick);
            if (episode->take() != DenseEpisodeMachine::Taken::all) refuse(program_, inputs, time);
        }
    }

    double robustness() const override { return episodes_.front()->result(); }
    double lower() const override { return episodes_.front()->lower(); }
    double upper() const override { return episodes_.front()->upper(); }
    double formula(std::size_t index) const override {
        const NamedFormula& formula = program_.formulas[index];
        if (formula.episode) return episodes_[*formula.episode]->result();
        return values_[formula.observed];
    }

    void fields(Snapshot& s) override {
        if (monitor_) machine_fields(s, *monitor_);
        s.array(values_.data(), values_.size());
        for (const auto& episode : episodes_) {
            machine_fields(s, *episode);
            s.require(episode->settled() == episodes_.front()->settled());
        }
        s.require(!monitor_ || monitor_->sampler().known() == episodes_.front()->settled());
    }

private:
    bool count(double time, dense::Time& tick) const {
        if (program_.clock->count(time, tick)) return true;
        // In the middle between two ticks, or a double that no decimal of the clock reads as.
        return program_.clock->nearest(time, tick);
    }

    template <class M>
    static void give(M& machine, const double* inputs, dense::Time tick) {
        std::vector<dense::Pending>& pending = machine.pending();
        for (std::size_t v = 0; v < pending.size(); ++v) {
            pending[v].times.assign(1, tick);
            pending[v].values.assign(1, inputs[v]);
        }
    }

    const Program& program_;
    std::unique_ptr<DenseMachine> monitor_;
    std::vector<double> values_;  // of the named formulas that the monitor observes
    std::vector<std::unique_ptr<DenseEpisodeMachine>> episodes_;
};

}  // namespace

std::unique_ptr<Engine> make_engine(const Program& program, const std::vector<double>& parameters) {
    const std::vector<double> numbers = program.numbers(parameters);
    if (program.clock) return std::make_unique<DenseEngine>(program, numbers);
    return std::make_unique<SampledEngine>(program, numbers);
}

}  // namespace rtamt::fmu
