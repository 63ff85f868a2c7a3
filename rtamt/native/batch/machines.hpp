// One program in many entries in batches: each instruction runs in all entries before the next one.
// The formulas of some episodes run in a machine for each entry instead.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "batch/entries.hpp"
#include "batch/episodes.hpp"
#include "core/columns.hpp"
#include "discrete/columns.hpp"
#include "episode/machine.hpp"

namespace rtamt {

// What both batches have: the terms of all entries and the last samples.
class Batch {
public:
    Batch(const Batch&) = delete;
    Batch& operator=(const Batch&) = delete;

    std::size_t num() const { return entries_.num(); }
    std::size_t variables() const { return program_.variables(); }
    const double* inputs() const { return inputs_.data(); }  // a column for each variable
    std::uint64_t fingerprint() const { return fingerprint_; }

protected:
    Batch(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
          const Observed& result, std::size_t num);

    // Evaluates the terms of one sample of every chosen entry, from its row of the table. Returns
    // the first entry with a nan, of a variable or a term, without changing anything, or num().
    std::size_t take_terms(const Table& table, const std::uint8_t* mask);
    // Keeps the samples of the chosen entries as the last ones.
    void keep_inputs(const Table& table);
    void choose_and_clear(const std::uint8_t* mask);
    void fields(Snapshot& s);

    DiscreteMachine program_;
    RegisterColumns columns_;  // of the chosen entries
    Entries entries_;
    std::vector<double> inputs_;
    std::uint64_t fingerprint_;

private:
    void read(const Table& table, std::size_t variable, double* out) const;
};

// Discrete machines in batches.
class DiscreteBatch : public Batch {
public:
    DiscreteBatch(const std::vector<DiscreteRow>& rows, std::size_t terms, std::size_t variables,
                  const Observed& result, std::size_t num);

    const std::int64_t* samples() const { return samples_.data(); }
    const double* results() const { return results_.data(); }

    // Takes in one sample of every chosen entry, from its row of the table. Returns the first entry
    // with a nan, without changing any entry, or num().
    std::size_t take(const Table& table, const std::uint8_t* mask);
    void reset(const std::uint8_t* mask = nullptr);
    void fields(Snapshot& s);

private:
    struct BatchInstruction {
        Instruction instruction;
        std::vector<std::unique_ptr<Memory>> memories;  // of all entries; none if it has no memory
    };

    template <class Window>
    void push(const BatchInstruction& formula);

    std::vector<BatchInstruction> formulas_;
    std::vector<std::int64_t> samples_;
    std::vector<double> results_;
    std::int64_t least_ = 0;  // samples of the chosen entries
};

// Episode machines in batches.
class EpisodeBatch : public Batch {
public:
    EpisodeBatch(const episode::Program& program, std::size_t num);

    const std::int64_t* samples() const { return values_.samples.data(); }
    const std::uint8_t* finished() const { return values_.finished.data(); }
    const double* results() const { return values_.now.data(); }
    const double* lower() const { return values_.lower.data(); }
    const double* upper() const { return values_.upper.data(); }

    // Does what DiscreteBatch::take does; no chosen entry is finished.
    std::size_t take(const Table& table, const std::uint8_t* mask);
    // Takes in a sample of every chosen entry whose terms are known: for each of them num()
    // numbers, first the numbers of the chosen entries.
    void take(const Table& table, const std::uint8_t* mask, const double* terms);
    void reset(const std::uint8_t* mask = nullptr);
    // Ends the traces of the chosen entries, of at least one sample each.
    void finish(const std::uint8_t* mask, End end);
    void fields(Snapshot& s);

private:
    batch::EpisodeValues values_;
    std::unique_ptr<batch::Episodes> episodes_;
};

}  // namespace rtamt
