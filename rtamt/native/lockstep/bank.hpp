// One program in many lanes in lockstep: each instruction runs in all lanes before the next one. The
// formulas of some episodes run in a machine for each lane instead.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/table.hpp"
#include "discrete/columns.hpp"
#include "episode/machine.hpp"
#include "lockstep/episodes.hpp"
#include "lockstep/lanes.hpp"

namespace rtamt {

// What both banks have: the terms of all lanes and the last samples.
class Bank {
public:
    Bank(const Bank&) = delete;
    Bank& operator=(const Bank&) = delete;

    std::size_t num() const { return lanes_.num(); }
    std::size_t variables() const { return program_.variables(); }
    const double* inputs() const { return inputs_.data(); }  // a column for each variable
    std::uint64_t fingerprint() const { return fingerprint_; }

protected:
    Bank(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
         const Observed& result, std::size_t num);

    // Evaluates the terms of one sample of every chosen lane, from its row of the table. Returns
    // the first lane with a nan, of a variable or a term, without changing anything, or num().
    std::size_t take_terms(const Table& table, const std::uint8_t* mask);
    // Keeps the samples of the chosen lanes as the last ones.
    void keep_inputs(const Table& table);
    void choose_and_clear(const std::uint8_t* mask);
    void fields(Snapshot& s);

    DiscreteMachine program_;
    RegisterColumns columns_;  // of the chosen lanes
    Lanes lanes_;
    std::vector<double> inputs_;
    std::uint64_t fingerprint_;

private:
    void read(const Table& table, std::size_t variable, double* out) const;
};

// Discrete machines in lockstep.
class DiscreteBank : public Bank {
public:
    DiscreteBank(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
                 const Observed& result, std::size_t num);

    const std::int64_t* samples() const { return samples_.data(); }
    const double* results() const { return results_.data(); }

    // Takes in one sample of every chosen lane, from its row of the table. Returns the first lane
    // with a nan, without changing any lane, or num().
    std::size_t take(const Table& table, const std::uint8_t* mask);
    void reset(const std::uint8_t* mask = nullptr);
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
    std::vector<double> results_;
    std::int64_t least_ = 0;  // samples of the chosen lanes
};

// Episode machines in lockstep.
class EpisodeBank : public Bank {
public:
    EpisodeBank(const episode::Program& program, std::size_t num);

    const std::int64_t* samples() const { return values_.samples.data(); }
    const std::uint8_t* finished() const { return values_.finished.data(); }
    const double* results() const { return values_.now.data(); }
    const double* lower() const { return values_.lower.data(); }
    const double* upper() const { return values_.upper.data(); }

    // Does what DiscreteBank::take does; no chosen lane is finished.
    std::size_t take(const Table& table, const std::uint8_t* mask);
    // Takes in a sample of every chosen lane whose terms are known: for each of them num() numbers,
    // first the numbers of the chosen lanes.
    void take(const Table& table, const std::uint8_t* mask, const double* terms);
    void reset(const std::uint8_t* mask = nullptr);
    // Ends the traces of the chosen lanes, of at least one sample each.
    void finish(const std::uint8_t* mask, End end);
    void fields(Snapshot& s);

private:
    lockstep::EpisodeValues values_;
    std::unique_ptr<lockstep::Episodes> episodes_;
};

}  // namespace rtamt
