// Machines of one program in lockstep: each lane has a machine, and each instruction runs in all
// lanes before the next one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "discrete/columns.hpp"
#include "episode/machine.hpp"

namespace rtamt {

// The lanes that a call is about, in rising order.
class Lanes {
public:
    explicit Lanes(std::size_t num);
    // Chooses the lanes where the mask is true; all lanes without a mask.
    void choose(const bool* mask);

    std::size_t num() const { return all_.size(); }
    std::size_t count() const { return chosen_ == all_.data() ? all_.size() : some_.size(); }
    std::uint32_t operator[](std::size_t i) const { return chosen_[i]; }

private:
    std::vector<std::uint32_t> all_;
    std::vector<std::uint32_t> some_;
    const std::uint32_t* chosen_;
};

// What both banks have: the terms of all lanes, the last samples and the results.
class Bank {
public:
    Bank(const Bank&) = delete;
    Bank& operator=(const Bank&) = delete;

    std::size_t num() const { return lanes_.num(); }
    std::size_t variables() const { return program_.variables(); }
    const double* inputs() const { return inputs_.data(); }  // a row for each lane
    const double* results() const { return results_.data(); }
    std::uint64_t fingerprint() const { return fingerprint_; }

protected:
    Bank(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
         const Observed& result, std::size_t num);

    // Evaluates the terms of one sample of every chosen lane, from its row of the table. Returns
    // the first lane with a nan, without changing anything, or num().
    std::size_t take_terms(const double* table, const bool* mask);
    void choose_and_clear(const bool* mask);
    void fields(Snapshot& s);

    DiscreteMachine program_;
    RegisterColumns columns_;  // of the chosen lanes
    Lanes lanes_;
    std::vector<double> inputs_;
    std::vector<double> results_;
    std::uint64_t fingerprint_;
};

// Discrete machines in lockstep.
class DiscreteBank : public Bank {
public:
    DiscreteBank(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
                 const Observed& result, std::size_t num);

    std::int64_t samples(std::size_t lane) const { return samples_[lane]; }

    // Takes in one sample of every chosen lane, from its row of the table. Returns the first lane
    // with a nan, without changing any lane, or num().
    std::size_t take(const double* table, const bool* mask);
    void reset(const bool* mask = nullptr);
    void fields(Snapshot& s);

private:
    struct LaneInstruction {
        Instruction instruction;
        std::vector<std::unique_ptr<Memory>> memories;  // of all lanes; none if it has no memory
    };

    template <class Window>
    void push(const LaneInstruction& formula);

    std::vector<LaneInstruction> formulas_;
    std::vector<std::int64_t> samples_;
    std::int64_t least_ = 0;  // samples of the chosen lanes
};

// Episode machines in lockstep.
class EpisodeBank : public Bank {
public:
    EpisodeBank(const std::vector<DiscreteRow>& terms, std::size_t variables,
                const std::vector<episode::FormulaRow>& formulas,
                const std::vector<std::size_t>& initial, const std::vector<std::size_t>& streams,
                std::size_t num);

    std::int64_t samples(std::size_t lane) const { return machines_[lane]->samples(); }
    bool finished(std::size_t lane) const { return machines_[lane]->finished(); }
    const double* lower() const { return lower_.data(); }
    const double* upper() const { return upper_.data(); }

    // Does what DiscreteBank::take does; no chosen lane is finished.
    std::size_t take(const double* table, const bool* mask);
    void reset(const bool* mask = nullptr);
    // Ends the traces of the chosen lanes, of at least one sample each.
    void finish(const bool* mask);
    void fields(Snapshot& s);

private:
    void publish(std::size_t lane);

    std::vector<std::unique_ptr<EpisodeMachine>> machines_;
    std::vector<double> lower_;
    std::vector<double> upper_;
};

}  // namespace rtamt
