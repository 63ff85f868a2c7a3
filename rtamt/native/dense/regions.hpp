// The registers of a program over the regions of dense time: what is settled of a trace, and what
// each world adds. The definitions are rtamt/machines/dense/regions.py and the class Regions of
// rtamt/machines/dense/episode.py.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/snapshot.hpp"
#include "dense/runs.hpp"
#include "discrete/instruction.hpp"

namespace rtamt::dense {

// These throw std::invalid_argument if a condition fails, or if rows are no formulas behind so many
// terms.
void require(bool condition);
void require_rows(const std::vector<FormulaRow>& rows, std::size_t terms);

struct RegionConstant {
    std::size_t reg;
    double value;
};

class Leaf;
class RegionFuture;
class RegionStream;
class AtBegin;
struct RegionTrace;

class Regions {
public:
    enum World { now, lower, upper, cut_lower, cut_upper, worlds };
    using Values = std::array<double, worlds>;

    // Takes how many registers are terms and the constants among them; the formulas behind them;
    // and the registers that are read at position 0 alone, at all positions, and which of the
    // latter never settle. Throws std::invalid_argument on rows that are none.
    Regions(std::size_t terms, const std::vector<RegionConstant>& constants,
            const std::vector<FormulaRow>& rows, const std::vector<std::size_t>& initial,
            const std::vector<std::size_t>& streams, const std::vector<std::size_t>& unknowns);
    Regions(Regions&&) noexcept;
    Regions& operator=(Regions&&) noexcept;
    ~Regions();

    std::size_t terms() const { return terms_; }
    Time last() const { return t_; }
    // Takes in columns of the terms at n new positions; all positions up to t have been seen.
    void advance(const Time* positions, const double* const* terms, std::size_t n, Time t);
    // The robustness at position 0 in the first worlds; `now` is no number before position 0.
    Values look(std::size_t worlds);

    void reset();
    void fields(Snapshot& s);
    std::uint64_t fingerprint() const { return fingerprint_; }

private:
    // A MAP over terms, which is known where they are.
    struct Instant {
        std::size_t reg;
        RegionFold fold;
        std::vector<double> column;
    };
    // A register that is read at all positions, as what it is if it is a leaf, or has an unknown.
    struct Stream {
        std::size_t reg;
        RegionStream* stream;
        Leaf* leaf;
        RegionFuture* future;
    };

    void make_streams(const std::vector<std::size_t>& streams,
                      const std::vector<std::size_t>& unknowns);
    void evaluate(const double* const* terms, std::size_t n);
    void substitute(RegionFuture& future);
    Values at_zero(std::size_t reg, std::size_t worlds) const;

    std::size_t terms_;
    std::vector<std::optional<double>> constants_;  // of the terms
    std::vector<FormulaRow> rows_;
    std::vector<std::size_t> initial_;
    std::vector<RegionFold> fold_of_;  // of the rows
    std::vector<Instant> instants_;
    std::vector<const double*> columns_;               // of terms and instants, by register
    std::vector<std::unique_ptr<RegionStream>> made_;  // by register; null: none
    std::vector<Stream> streams_;
    std::vector<std::unique_ptr<AtBegin>> folds_;  // by register; null: none
    std::vector<AtBegin*> order_of_folds_;
    std::vector<Values> found_;  // what look() finds, by register
    std::unique_ptr<RegionTrace> trace_;
    Time t_ = -1;
    std::vector<double> first_;  // the terms at position 0
    Time reach_ = 0;             // how far beyond a position registers look
    std::uint64_t fingerprint_;
};

}  // namespace rtamt::dense
