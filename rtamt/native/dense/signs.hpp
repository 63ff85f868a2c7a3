// Where a formula fails or holds for certain on a whole trace in dense time. The definition is
// rtamt/machines/dense/episode.py.
//
// Folds choose among the numbers of their operands by order alone, so the sign of a fold is the
// fold of signs: a number that fails is -inf here, another one +inf, and runs are as few as
// changes. The same passes compute the numbers themselves for callers that need them.
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "core/order.hpp"
#include "dense/region_streams.hpp"
#include "dense/sampler.hpp"

namespace rtamt::dense {

class Signs {
public:
    // Takes the terms of a program of some variables, the formulas behind them, its result, the
    // reading of the end, and whether to compute numbers instead of signs. Throws
    // std::invalid_argument on rows that are no program.
    Signs(const std::vector<DenseRow>& terms, std::size_t variables,
          const std::vector<FormulaRow>& rows, std::size_t result, End end, bool numbers);

    // Reads the events of every variable on a trace from one tick to another; each has one at its
    // begin or before. False if a term is nan. Called once.
    bool read(const Events* events, Time begin, Time last);

    using Spans = std::vector<std::pair<Time, Time>>;  // first and last position, in order

    struct Count {
        Time ticks = 0;  // between which it lasts
        Time occasions = 0;
        Time first = -1;  // none
    };
    // How often it fails for certain at some positions; those beyond the trace count for nothing.
    Count fails_at(const Spans& spans);
    // Whether it holds for certain at all of some positions.
    bool holds_at(const Spans& spans);
    // The result in a world from the first position on where it may differ from the world `now`, on
    // the trace and after it; the last run lasts for ever.
    RunsView result(std::size_t world);

private:
    class Term;

    void settle(std::size_t world);
    std::size_t world(bool best) const;
    // The parts of the trace in which the result has one sign in a world.
    Spans parts(std::size_t world, bool negative);

    std::size_t variables_;
    std::vector<FormulaRow> rows_;
    std::size_t result_;
    End end_;
    bool numbers_;
    bool ahead_ = false;
    std::unique_ptr<RegionTrace> trace_;
    std::unique_ptr<Sampler> sampler_;
    std::vector<Term*> read_;                             // terms that formulas read
    std::vector<std::unique_ptr<RegionStream>> streams_;  // by register; null: nobody reads it
};

}  // namespace rtamt::dense
