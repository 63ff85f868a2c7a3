#include "episode/traces.hpp"

#include <algorithm>
#include <memory>

#include "core/order.hpp"
#include "core/threads.hpp"

namespace rtamt::episode {
namespace {

// Takes a trace in. Returns false at a nan.
bool take(EpisodeMachine& machine, const Traces& traces, std::size_t trace,
          std::int64_t& decided) {
    const std::int64_t begin = traces.begins[trace];
    const std::size_t variables = machine.variables();
    for (std::int64_t i = 0; i < traces.lengths[trace]; ++i) {
        double* pending = machine.pending();
        for (std::size_t v = 0; v < variables; ++v) pending[v] = traces.columns[v][begin + i];
        if (!machine.take()) return false;
        if (decided < 0 && machine.verdict() != 0) decided = i;
    }
    return traces.lengths[trace] > 0;
}

// Counts the failures in a run of samples that does not touch the run before.
void count(const double* values, std::int64_t first, std::int64_t last, std::int64_t& samples,
           std::int64_t& starts, std::int64_t& first_failure) {
    bool before = false;
    for (std::int64_t i = first; i <= last; ++i) {
        const bool fails = negative(values[i]);
        samples += fails;
        starts += fails && !before;
        if (fails && first_failure < 0) first_failure = i;
        before = fails;
    }
}

}  // namespace

void judge(const Program& program, const Traces& traces, End end, std::size_t threads,
           const Outcomes& outcomes) {
    in_threads(traces.count, threads, [&] {
        auto machine = std::make_unique<EpisodeMachine>(program);
        return [&, machine = std::move(machine)](std::size_t trace) {
            machine->reset();
            std::int64_t& decided = outcomes.decided[trace];
            decided = -1;
            outcomes.refused[trace] = !take(*machine, traces, trace, decided);
            if (outcomes.refused[trace]) return;
            outcomes.complete[trace] = machine->result();
            machine->finish(end);
            outcomes.robustness[trace] = machine->result();
            outcomes.lower[trace] = machine->lower();
            outcomes.upper[trace] = machine->upper();
        };
    });
}

void count_failures(const std::vector<DiscreteRow>& rows, std::size_t terms,
                    std::size_t variables, std::size_t result, const Traces& traces,
                    const Runs& runs, std::size_t threads, const Failures& failures) {
    const std::vector<Observed> observed(2, Observed{result, 0});
    in_threads(traces.count, threads, [&] {
        auto machine = std::make_unique<DiscreteMachine>(rows, terms, variables, observed);
        return [&, machine = std::move(machine), values = std::vector<double>(),
                columns = std::vector<const double*>(variables)](std::size_t trace) mutable {
            const auto n = static_cast<std::size_t>(traces.lengths[trace]);
            for (std::size_t v = 0; v < variables; ++v)
                columns[v] = traces.columns[v] + traces.begins[trace];
            values.resize(std::max(values.size(), n));
            machine->reset();
            double* const output = values.data();
            std::int64_t& samples = failures.samples[trace];
            samples = failures.starts[trace] = 0;
            failures.first[trace] = -1;
            if (machine->run(columns.data(), n, &output) < n) {
                samples = -1;
                return;
            }
            const std::int64_t k = runs.class_of[trace];
            for (std::int64_t run = runs.ends[k]; run < runs.ends[k + 1]; ++run)
                count(output, runs.first[run],
                      std::min(runs.last[run], traces.lengths[trace] - 1), samples,
                      failures.starts[trace], failures.first[trace]);
        };
    });
}

}  // namespace rtamt::episode
