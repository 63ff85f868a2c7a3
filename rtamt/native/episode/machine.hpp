// Bounds the robustness of an episode, whatever its unseen samples are. The definition is
// rtamt/machines/episode/machine.py.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/order.hpp"
#include "discrete/machine.hpp"
#include "episode/streams.hpp"

namespace rtamt {

namespace episode {

class UnsettledStream;
class InitialValue;

struct Program {
    std::vector<DiscreteRow> terms;  // in the order of their registers
    std::size_t variables;
    std::vector<FormulaRow> formulas;  // the registers after the terms
    std::vector<std::size_t> initial;  // registers read at time 0 alone; the last is the result
    std::vector<std::size_t> streams;  // registers read at all times

    const FormulaRow& formula(std::size_t r) const { return formulas.at(r - terms.size()); }
};

}  // namespace episode

class EpisodeMachine {
public:
    // Checks the rows of the program as far as memory needs it.
    explicit EpisodeMachine(const episode::Program& program);
    EpisodeMachine(const EpisodeMachine&) = delete;
    EpisodeMachine& operator=(const EpisodeMachine&) = delete;
    ~EpisodeMachine();

    std::size_t variables() const { return terms_.variables(); }
    std::int64_t samples() const { return terms_.samples(); }
    const double* inputs() const { return terms_.inputs(); }

    // Takes samples in as DiscreteMachine does.
    double* pending() { return terms_.pending(); }
    bool take();
    void take(const double* inputs, const double* terms, std::size_t stride);
    // The robustness if the episode ended now; nan before the first sample.
    double result() const { return values_[episode::kNow]; }

    double lower() const { return values_[episode::kLower]; }
    double upper() const { return values_[episode::kUpper]; }
    // 1 if the bounds say that the specification is satisfied, -1 if violated, else 0.
    int verdict() const { return verdict_of(lower(), upper()); }
    bool finished() const { return finished_; }
    // Ends the trace, of at least one sample, and moves the robustness to the bounds; a trace that
    // has ended stays as it is.
    void finish(End end);

    std::uint64_t fingerprint() const { return fingerprint_; }  // of the program
    void reset();
    void fields(Snapshot& s);

private:
    class Builder;
    struct SettleTask {
        episode::Stream* stream;
        episode::UnsettledStream* unsettled;  // the same stream, if it is one
    };
    struct OpenTask {
        episode::Stream* stream;
        episode::World world;
    };

    void advance();
    void propagate_demands();
    // Finds out what is left to do at sample t and until next_plan_.
    void plan(episode::Time t);
    void settle(episode::Time t, const double* terms);
    void find_values(episode::Time t, const double* terms);
    void cut();

    DiscreteMachine terms_;
    std::uint64_t fingerprint_;
    episode::Workspace workspace_;
    std::vector<std::unique_ptr<episode::Stream>> streams_;        // operands first
    std::vector<std::unique_ptr<episode::InitialValue>> initial_;  // operands first
    std::vector<episode::UnsettledStream*> unsettled_;
    std::vector<SettleTask> settle_tasks_;
    std::vector<OpenTask> open_tasks_;
    bool open_ = true;  // whether a sample may still change a value
    episode::Time next_plan_ = 0;
    using Values = std::array<double, std::size(episode::kAll)>;
    Values values_{};
    Values empty_{};  // before the first sample
    bool finished_ = false;
};

}  // namespace rtamt
