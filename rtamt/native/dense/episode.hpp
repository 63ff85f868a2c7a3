// Robustness and bounds at the begin of a trace, from events in chunks of any size. The definition
// is PythonDenseEpisodeMachine in rtamt/machines/dense/episode.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "core/order.hpp"
#include "dense/machine.hpp"
#include "dense/regions.hpp"

namespace rtamt {

// The terms of a program over regions, of which the last is followed by its formulas.
struct RegionProgram {
    std::vector<DenseRow> terms;
    std::vector<FormulaRow> rows;
    std::vector<std::size_t> initial;
    std::vector<std::size_t> streams;
    std::vector<std::size_t> unknowns;
};

class DenseEpisodeMachine : public dense::EventMachine {
public:
    // Takes the program, or with neutral predicates two: where they are -0.0, and where they are
    // 0.0; the values of the variables before their first events, nan where none is declared; by
    // how many ticks formulas look away; and whether to find when the verdict is decided. Throws
    // std::invalid_argument on rows that are no program.
    DenseEpisodeMachine(const std::vector<RegionProgram>& readings,
                        const std::vector<double>& declared, dense::Time reach, bool decides);

    enum class Taken { all, no_number, too_long };
    // Takes in the pending events. Changes nothing if a term is nan, or if the trace is too long.
    Taken take();
    // Takes in very many events. If not all are taken, only reset() is left to do.
    Taken run(const dense::Events* events, bool decides);
    // Ends the trace. Called once, when it has begun.
    void finish(End end);

    double result() const { return robustness_; }
    double lower() const { return lower_; }
    double upper() const { return upper_; }
    int verdict() const { return verdict_of(lower_, upper_); }
    // The last time at which all variables are known; kBefore if there is none.
    dense::Time settled() const { return sampler_.started() ? sampler_.known() : dense::kBefore; }
    // The first time of the trace, which has begun.
    dense::Time begin() const { return begin_; }
    // The first time such that the trace up to it decides the verdict.
    std::optional<dense::Time> decided() const {
        if (decided_ < 0) return std::nullopt;
        return begin_ + decided_;
    }
    // Whether positions are numbers if all variables have an event at a later time.
    bool reaches(dense::Time time) const {
        const auto ticks = static_cast<std::uint64_t>(time) - static_cast<std::uint64_t>(begin_);
        return !sampler_.started() || ticks + static_cast<std::uint64_t>(reach_) <
                                          static_cast<std::uint64_t>(dense::kTicks);
    }
    // How many ticks a trace had that was too long, with what formulas look away.
    std::uint64_t too_long() const { return too_long_; }
    // The robustness if the trace is all there is: two zeros where it hangs on neutral predicates.
    std::vector<double> complete();

    void reset();
    void fields(Snapshot& s);

private:
    // The terms of all readings at some positions.
    struct Columns {
        explicit Columns(std::size_t count = 0) : terms(count) {}

        void add(const Columns& others);
        void clear();
        std::size_t place(dense::Time position) const;  // of the first that is later

        std::vector<dense::Time> positions;
        std::vector<std::vector<double>> terms;
    };

    // From the begin to the last time that is known, and how far formulas look away.
    std::uint64_t length(dense::Time known) const;
    void append_positions(std::vector<dense::Time>& to) const;
    void append(Columns& to) const;
    void take_block(dense::Time before, dense::Time known);
    // Goes on to a tick with the columns behind the last position that was seen.
    void advance(const Columns& columns, dense::Time tick);
    void conclude();
    void decide();
    // The readings alone.
    void reading_fields(Snapshot& s);
    std::string reading_state();
    void restore_readings(const std::string& state);
    void begin_journal();

    std::vector<dense::Regions> readings_;
    dense::Time reach_;
    bool decides_;
    Columns new_;
    std::vector<const double*> sources_;

    // A state that is undecided, and the terms since: where decide() looks.
    std::string journal_state_;
    dense::Time journal_tick_ = -1;
    Columns journal_;

    dense::Time begin_ = 0;
    dense::Time decided_ = -1;  // ticks since the begin
    std::uint64_t too_long_ = 0;
    double robustness_;
    double lower_;
    double upper_;
};

}  // namespace rtamt
