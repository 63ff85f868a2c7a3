// The clocks of temporal operators in many entries. The definition is rtamt/machines/clocks.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/snapshot.hpp"
#include "batch/entries.hpp"

namespace rtamt {

// What a clock counts from, and what the values of its operands do to it, as the fields of
// rtamt.machines.clocks.OperatorClock.
struct ClockRow {
    enum class Kind : std::uint8_t { oldest, newest, last };
    enum class Event : std::uint8_t { holds, fails, until, unless, since };
    struct Operand {
        std::size_t part;
        std::size_t waits;
    };

    Kind kind;
    Event event;
    std::int64_t begin;
    std::int64_t end;  // -1 without one
    std::int64_t late;
    std::vector<Operand> operands;
    std::int64_t asked;  // a part; -1 if it is asked everywhere, or at the first instant
    bool first;
};

// One clock; its arrays have an element for every entry.
class EntryClock {
public:
    EntryClock(ClockRow row, std::size_t num);

    std::size_t operands() const { return row_.operands.size(); }
    // Takes in the newest values of the parts, a row of each, before which so many samples were
    // fed.
    void feed(const Entries& entries, const std::int64_t* samples, const double* parts);
    void reset(const Entries& entries);
    void write_fractions(double* out) const;
    void write_margins(double* out) const;

    void add_to(Fingerprint& print) const;
    void fields(Snapshot& s);

private:
    struct Operand {
        std::vector<double> value;    // the newest that fits the others
        std::vector<double> waiting;  // a ring of rows
    };
    struct Counts {
        std::int64_t count;
        std::int64_t shown;
    };

    bool holds(std::size_t operand, std::size_t entry) const;
    bool fails(std::size_t operand, std::size_t entry) const;
    bool is_asked(std::size_t entry, std::int64_t samples, const double* parts) const;
    void step_oldest(std::size_t entry, std::int64_t samples, const double* parts);
    void step_newest(std::size_t entry, std::int64_t samples, const double* parts);
    void step_last(std::size_t entry, std::int64_t samples);
    Counts of_two(std::size_t entry, std::int64_t samples, std::int64_t count) const;
    std::int64_t ended(bool event, std::int64_t last, std::size_t entry, std::int64_t samples,
                       std::int64_t count) const;

    ClockRow row_;
    std::size_t num_;
    std::int64_t full_;   // what makes a fraction of 1
    std::int64_t most_;   // what an oldest clock counts to
    std::int64_t start_;  // the count before the first sample
    std::size_t depth_;   // of the ring of instants
    std::vector<Operand> operands_;
    std::vector<std::int64_t> count_;
    std::vector<std::int64_t> shown_;
    std::vector<std::uint8_t> recent_;  // whether it was asked, a ring of rows
};

// Several clocks over the same parts, each entry with a time of its own.
class ClockBatch {
public:
    ClockBatch(std::vector<ClockRow> rows, std::size_t parts, std::size_t num);

    std::size_t num() const { return entries_.num(); }
    std::size_t parts() const { return parts_; }
    std::size_t size() const { return clocks_.size(); }
    std::size_t operands() const { return operands_; }
    const std::int64_t* samples() const { return samples_.data(); }

    // Takes in a sample in the entries of the mask: a row of every part.
    void feed(const double* parts, const std::uint8_t* mask);
    void reset(const std::uint8_t* mask = nullptr);
    // Writes a row for every clock, and for every operand of every clock.
    void write_fractions(double* out) const;
    void write_margins(double* out) const;

    std::uint64_t fingerprint() const;
    void fields(Snapshot& s);

private:
    Entries entries_;
    std::size_t parts_;
    std::size_t operands_ = 0;
    std::vector<EntryClock> clocks_;
    std::vector<std::int64_t> samples_;
};

}  // namespace rtamt
