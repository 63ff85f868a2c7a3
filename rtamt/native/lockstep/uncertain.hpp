// Episodes in lockstep some of whose samples are not known, or not exactly; see
// episode/uncertain.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "discrete/ranges.hpp"
#include "lockstep/bank.hpp"

namespace rtamt {

// Until the first sample that is not known, in any lane, one bank runs alone. From there on a twin
// goes on from its state, until no lane is left whose episode has such a sample.
class UncertainBank {
public:
    UncertainBank(std::vector<DiscreteRow> terms, std::size_t variables,
                  std::vector<episode::FormulaRow> formulas, std::vector<std::size_t> initial,
                  std::vector<std::size_t> streams, std::size_t num);

    std::size_t num() const { return least_->num(); }
    std::size_t variables() const { return least_->variables(); }
    const double* inputs() const { return least_->inputs(); }
    const double* upper_inputs() const { return greatest().inputs(); }
    const std::int64_t* samples() const { return least_->samples(); }
    const std::uint8_t* finished() const { return least_->finished(); }
    const double* results() const { return apart_ ? results_.data() : least_->results(); }
    const double* lower() const { return least_->lower(); }
    const double* upper() const { return greatest().upper(); }

    // Takes samples in as DiscreteBank does.
    std::size_t take(const Table& table, const std::uint8_t* mask);
    // Takes in a sample of every chosen lane that lies between two rows. Returns the first lane in
    // which a term has no value, without changing any lane, or num().
    std::size_t take(const Table& lower, const Table& upper, const std::uint8_t* mask);
    void reset(const std::uint8_t* mask = nullptr);
    void finish(const std::uint8_t* mask, End end);

    std::uint64_t fingerprint() const { return least_->fingerprint(); }
    void fields(Snapshot& s);

private:
    struct Program {
        std::vector<DiscreteRow> terms;
        std::vector<episode::FormulaRow> formulas;
        std::vector<std::size_t> initial;
        std::vector<std::size_t> streams;
    };

    const EpisodeBank& greatest() const { return apart_ ? *greatest_ : *least_; }
    // Lets the twin go on from the state of the bank.
    void part();
    void publish();

    std::unique_ptr<EpisodeBank> least_;
    std::unique_ptr<EpisodeBank> greatest_;  // null until it is needed
    bool apart_ = false;                     // whether the two differ
    std::vector<std::uint8_t> uncertain_;    // the lanes in which they do
    std::vector<double> moved_;    // the robustness of lanes that were cut, inside the bounds of both
    std::vector<double> results_;  // while the two differ
    Program program_;
    std::unique_ptr<TermRanges> ranges_;
    std::vector<double> least_terms_;
    std::vector<double> greatest_terms_;
};

}  // namespace rtamt
