#include "episode/traces.hpp"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <memory>
#include <system_error>
#include <thread>
#include <vector>

#include "core/columns.hpp"
#include "core/order.hpp"
#include "discrete/columns.hpp"

namespace rtamt {

// Calls worker(i) for each of n items, in up to so many threads. Each thread takes blocks of items
// from one counter, and has a worker of its own: make_worker() returns one. The first exception of
// a thread ends the work, and is thrown again here.
template <class MakeWorker>
void in_threads(std::size_t n, std::size_t threads, MakeWorker make_worker) {
    const std::size_t block =
        std::clamp<std::size_t>(n / (8 * std::max<std::size_t>(1, threads)), 1, 256);
    threads =
        std::clamp<std::size_t>((n + block - 1) / block, 1, std::max<std::size_t>(1, threads));
    std::atomic<std::size_t> next{0};
    std::vector<std::exception_ptr> errors(threads);
    const auto run = [&](std::size_t thread) {
        try {
            auto worker = make_worker();
            for (std::size_t i; (i = next.fetch_add(block)) < n;)
                for (const std::size_t end = std::min(n, i + block); i < end; ++i) worker(i);
        } catch (...) {
            errors[thread] = std::current_exception();
            next = n;
        }
    };
    std::vector<std::thread> others;
    try {
        for (std::size_t thread = 1; thread < threads; ++thread) others.emplace_back(run, thread);
    } catch (const std::system_error&) {
        // The system refuses another thread: those that run do all the work.
    }
    run(0);
    for (std::thread& other : others) other.join();
    for (const std::exception_ptr& error : errors)
        if (error) std::rethrow_exception(error);
}

}  // namespace rtamt

namespace rtamt::episode {
namespace {

// Judges traces one after the other, with the terms of many samples at once.
class Judge {
public:
    Judge(const Program& program, const Traces& traces, End end, const Outcomes& outcomes)
        : program_(std::make_unique<DiscreteMachine>(program.terms, program.variables)),
          terms_(std::make_unique<RegisterColumns>(*program_, kBlock)),
          traces_(traces),
          end_(end),
          outcomes_(outcomes),
          columns_(program.variables),
          inputs_(program.variables),
          machine_(std::make_unique<EpisodeMachine>(program)) {}

    void operator()(std::size_t trace) {
        std::int64_t& decided = outcomes_.decided[trace];
        decided = -1;
        outcomes_.refused[trace] = !take(trace, decided);
        if (outcomes_.refused[trace]) return;
        outcomes_.complete[trace] = machine_->result();
        machine_->finish(end_);
        outcomes_.robustness[trace] = machine_->result();
        outcomes_.lower[trace] = machine_->lower();
        outcomes_.upper[trace] = machine_->upper();
    }

private:
    // Takes a trace in. Returns false at a nan.
    bool take(std::size_t trace, std::int64_t& decided) {
        machine_->reset();
        const auto n = static_cast<std::size_t>(traces_.lengths[trace]);
        for (std::size_t v = 0; v < columns_.size(); ++v)
            columns_[v] = traces_.columns[v] + traces_.begins[trace];
        for (std::size_t from = 0; from < n; from += kBlock) {
            const std::size_t count = std::min(kBlock, n - from);
            if (terms_->copied_terms(columns_.data(), from, count) < count) return false;
            for (std::size_t i = 0; i < count; ++i) {
                // No one asks for the inputs of the last sample.
                machine_->take(inputs_.data(), terms_->at(0) + i, kBlock);
                if (decided < 0 && machine_->verdict() != 0)
                    decided = static_cast<std::int64_t>(from + i);
            }
        }
        return n > 0;
    }

    // Samples that stay in the cache; columns at a power of two from each other would not.
    static constexpr std::size_t kBlock = 520;

    std::unique_ptr<DiscreteMachine> program_;
    std::unique_ptr<RegisterColumns> terms_;
    const Traces& traces_;
    End end_;
    const Outcomes& outcomes_;
    std::vector<const double*> columns_;
    std::vector<double> inputs_;
    std::unique_ptr<EpisodeMachine> machine_;
};

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
    in_threads(traces.count, threads, [&] { return Judge(program, traces, end, outcomes); });
}

void count_failures(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
                    std::size_t result, const Traces& traces, const Runs& runs, std::size_t threads,
                    const Failures& failures) {
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
                count(output, runs.first[run], std::min(runs.last[run], traces.lengths[trace] - 1),
                      samples, failures.starts[trace], failures.first[trace]);
        };
    });
}

}  // namespace rtamt::episode
