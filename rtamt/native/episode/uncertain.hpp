// An episode some of whose samples are not known, or not exactly. The definition is
// rtamt/machines/uncertain.py.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "discrete/ranges.hpp"
#include "episode/machine.hpp"

namespace rtamt {

// Until the first sample that is not known, one machine runs alone. From there on a twin goes on
// from its state: the one takes the least values of all terms, the twin the greatest. Programs of
// episodes are monotone in their terms, so their bounds enclose every trace's in between.
class UncertainEpisode {
public:
    UncertainEpisode(std::vector<DiscreteRow> terms, std::size_t variables,
                     std::vector<episode::FormulaRow> formulas, std::vector<std::size_t> initial,
                     std::vector<std::size_t> streams)
        : least_(std::make_unique<EpisodeMachine>(terms, variables, formulas, initial, streams)),
          program_{std::move(terms), std::move(formulas), std::move(initial), std::move(streams)} {}

    std::size_t variables() const { return least_->variables(); }
    std::int64_t samples() const { return least_->samples(); }
    const double* inputs() const { return least_->inputs(); }
    const double* upper_inputs() const { return apart_ ? greatest_->inputs() : inputs(); }

    // Takes a sample in as DiscreteMachine does.
    double* pending() { return least_->pending(); }
    bool take() {
        if (!apart_) [[likely]] return least_->take();
        const std::vector<double> sample(pending(), pending() + variables());
        for (const double value : sample)
            if (value != value) return false;  // also of a variable that no term reads
        return take(sample.data(), sample.data());
    }
    // Takes a sample in that lies between two others. Returns false, and changes nothing, if a term
    // has no value.
    bool take(const double* lower, const double* upper) {
        if (!ranges_)
            ranges_ = std::make_unique<TermRanges>(program_.terms, variables());
        if (!ranges_->find(lower, upper, 1)) return false;
        part();
        least_terms_.clear();
        greatest_terms_.clear();
        for (std::size_t i = 0; i < ranges_->terms(); ++i) {
            least_terms_.push_back((*ranges_)[i].lower);
            greatest_terms_.push_back((*ranges_)[i].upper);
        }
        least_->take(lower, least_terms_.data(), 1);
        greatest_->take(upper, greatest_terms_.data(), 1);
        return true;
    }

    // The robustness if the episode ended now, the least one; nan before the first sample.
    double result() const { return moved_ ? *moved_ : least_->result(); }
    double lower() const { return least_->lower(); }
    double upper() const { return apart_ ? greatest_->upper() : least_->upper(); }
    int verdict() const { return verdict_of(lower(), upper()); }
    bool finished() const { return least_->finished(); }
    void finish(End end) {
        if (finished()) return;
        const double robustness = result();
        least_->finish(end);
        if (!apart_) return;
        greatest_->finish(end);
        if (end == End::cut) moved_ = moved(robustness, lower(), upper());
    }

    std::uint64_t fingerprint() const { return least_->fingerprint(); }
    void reset() {
        least_->reset();
        apart_ = false;
        moved_.reset();
    }
    void fields(Snapshot& s) {
        bool apart = apart_;
        s(apart);
        least_->fields(s);
        if (!apart) return;
        if (s.reads()) part();
        greatest_->fields(s);
        double robustness = moved_.value_or(std::nan(""));
        s(robustness);
        moved_ = robustness == robustness ? std::optional(robustness) : std::nullopt;
        s.require(greatest_->samples() == least_->samples() &&
                  greatest_->finished() == least_->finished());
    }

private:
    struct Program {
        std::vector<DiscreteRow> terms;
        std::vector<episode::FormulaRow> formulas;
        std::vector<std::size_t> initial;
        std::vector<std::size_t> streams;
    };

    // Lets the twin go on from the state of the machine.
    void part() {
        if (apart_) return;
        if (!greatest_)
            greatest_ = std::make_unique<EpisodeMachine>(program_.terms, variables(),
                                                         program_.formulas, program_.initial,
                                                         program_.streams);
        restore_from(*greatest_, state_of(*least_));
        apart_ = true;
    }

    std::unique_ptr<EpisodeMachine> least_;
    std::unique_ptr<EpisodeMachine> greatest_;  // null until it is needed
    bool apart_ = false;                        // whether the two differ
    std::optional<double> moved_;  // the robustness inside the bounds of both, if they were cut
    Program program_;
    std::unique_ptr<TermRanges> ranges_;
    std::vector<double> least_terms_;
    std::vector<double> greatest_terms_;
};

}  // namespace rtamt
