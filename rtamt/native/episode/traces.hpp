// Judges many traces of one program, each from its first sample.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/order.hpp"
#include "discrete/machine.hpp"
#include "episode/machine.hpp"

namespace rtamt::episode {

// Traces of unequal length in shared columns: trace i has the samples begins[i] to
// begins[i] + lengths[i] - 1 of every column.
struct Traces {
    const double* const* columns;  // one for each variable
    const std::int64_t* begins;
    const std::int64_t* lengths;
    std::size_t count;
};

// Where the outcome of each trace is written. A trace is refused, and has no outcome, if it has no
// sample, or if a variable or a term is nan.
struct Outcomes {
    double* robustness;
    double* complete;  // the robustness if the trace is complete
    double* lower;
    double* upper;
    std::int64_t* decided;  // the first sample that decides the open end, or -1
    bool* refused;
};

void judge(const Program& program, const Traces& traces, End end, std::size_t threads,
           const Outcomes& outcomes);

// Runs of samples, for several classes of traces: class c has the runs ends[c] to ends[c + 1] - 1.
struct Runs {
    const std::int64_t* ends;
    const std::int64_t* first;
    const std::int64_t* last;
    const std::int64_t* class_of;  // of each trace
};

// How often a formula fails in runs of a trace: samples, starts, and the first sample or -1. A
// trace with a nan has -1 samples.
struct Failures {
    std::int64_t* samples;
    std::int64_t* starts;
    std::int64_t* first;
};

// Counts in each trace the samples at which the result of a program without latency fails.
void count_failures(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
                    std::size_t result, const Traces& traces, const Runs& runs, std::size_t threads,
                    const Failures& failures);

}  // namespace rtamt::episode
