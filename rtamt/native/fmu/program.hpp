// The program of a functional mock-up unit, from the file resources/program.rtamt.
// rtamt/export/program_file.py writes it, and says what its records mean.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "dense/clock.hpp"
#include "dense/episode.hpp"
#include "dense/machine.hpp"
#include "discrete/machine.hpp"
#include "episode/machine.hpp"

namespace rtamt::fmu {

// What a unit refuses: a call, or a file. The text is logged.
class Refusal : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

// The shortest text that reads as this number.
std::string number_text(double number);

// A number of a program: a literal, or one of those that follow from parameters.
struct Number {
    double literal = 0.0;
    std::optional<std::size_t> index;  // first the parameters, then the derived numbers
};

struct Derived {
    double (*function)(double, double);
    Number a;
    Number b;
};

struct Named {
    std::string name;
    double start;
};

// Rows whose values are computed when the parameters are known.
template <class Row>
struct Rows {
    std::vector<Row> rows;
    std::vector<Number> values;

    std::vector<Row> with(const std::vector<double>& numbers) const {
        std::vector<Row> known = rows;
        for (std::size_t i = 0; i < known.size(); ++i)
            if (values[i].index) known[i].value = numbers[*values[i].index];
        return known;
    }
};

// A program of an episode over samples, or over the regions of dense time.
struct EpisodeProgram {
    Rows<DiscreteRow> terms;
    std::vector<FormulaRow> formulas;
    std::vector<std::size_t> initial;
    std::vector<std::size_t> streams;
    std::vector<std::size_t> unknowns;  // these two of regions alone
    dense::Time reach = 0;
};

struct MonitorProgram {
    std::size_t terms = 0;
    Rows<DiscreteRow> rows;
    std::vector<Observed> observed;
};

// A named formula: an episode gives its robustness, or else an observed register holds it. Over
// dense time the specification has one episode, whatever its readings are.
struct NamedFormula {
    std::string name;
    std::optional<std::size_t> episode;
    std::size_t observed;
};

struct DenseProgram {
    std::size_t terms = 0;
    Rows<DenseRow> rows;
    std::vector<std::size_t> observed;
};

struct Program {
    std::string token;
    double period = 0.0;  // seconds between samples; 0: dense time
    std::vector<Named> inputs;
    std::vector<Named> parameters;
    std::vector<Named> fixed;
    std::vector<NamedFormula> formulas;
    bool stop = false;  // whether a violation ends the simulation, unless said otherwise
    std::vector<Derived> derived;
    std::size_t readings = 0;  // of the episodes: how many are of the specification
    std::vector<EpisodeProgram> episodes;
    std::optional<MonitorProgram> monitor;
    std::optional<Clock> clock;  // over dense time: counts ticks in a second
    std::vector<EpisodeProgram> regions;
    std::optional<DenseProgram> dense;
    std::uint64_t fingerprint = 0;

    // The numbers that follow from parameters of these values. Throws Refusal on a nan.
    std::vector<double> numbers(const std::vector<double>& parameters) const;
};

// The program that the bytes of a file say. Throws Refusal if they are damaged.
Program parse_program(std::string_view bytes);

// Reads the file of a folder. Throws Refusal if it is missing or damaged.
Program read_program(const std::string& folder);

}  // namespace rtamt::fmu
