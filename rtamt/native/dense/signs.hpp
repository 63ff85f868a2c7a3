// Where a formula fails or holds for certain on a whole trace in dense time. The definition is
// rtamt/machines/dense/episode.py.
//
// Folds choose among the numbers of their operands by order alone, so the sign of a fold is the
// fold of signs: a number that fails is -inf here, another one +inf, and runs are as few as
// changes. The same passes compute the numbers themselves for callers that need them.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "core/order.hpp"
#include "dense/regions.hpp"
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
    // the trace and after it; the last run lasts for ever. Of signs, from the first position on.
    const Runs& result(std::size_t world) { return runs(result_, world); }

private:
    // A number, or its sign.
    double kept(double number) const {
        return numbers_ ? number : negative(number) ? -kInfinity : kInfinity;
    }
    std::size_t world(bool best) const;
    void settle(std::size_t world);
    const Runs& runs(std::size_t reg, std::size_t world);
    // The runs of a register from a position on, which lie in the memory if they are put together.
    RunsView from(std::size_t reg, std::size_t world, Time begin, Runs& memory);
    Runs windowed(std::size_t reg, std::size_t world, Time begin);
    // The parts of the trace in which the result has one sign in a world.
    Spans parts(std::size_t world, bool negative);

    struct Operation {
        Function function;
        std::size_t out;
        std::size_t a;
        std::size_t b;
    };

    std::size_t variables_;
    std::vector<std::optional<std::size_t>> loads_;  // of the terms: the variables
    std::vector<std::optional<double>> constants_;   // of the terms
    std::vector<Operation> operations_;
    std::vector<FormulaRow> rows_;
    std::vector<RegionFold> folds_;  // of the rows
    std::vector<std::size_t> read_;  // terms that formulas read
    std::vector<Runs> seen_;         // of those
    std::size_t result_;
    End end_;
    bool numbers_;
    bool ahead_ = false;
    Time t_ = 0;                                                           // the last position
    std::vector<std::array<std::optional<Runs>, Regions::worlds>> found_;  // by register
    // The first position at which a register may differ from the world `now`. Signs are read in one
    // world alone, and are computed there from the first position on.
    std::vector<std::array<Time, Regions::worlds>> settled_;
};

}  // namespace rtamt::dense
