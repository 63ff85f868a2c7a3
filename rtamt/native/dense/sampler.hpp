// Sampler: computes the registers that depend on the present values of the variables alone, at all
// times at which a variable steps.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "dense/stream.hpp"

namespace rtamt {

// One instruction as Python encodes it; its register is the index of the row.
struct DenseRow {
    std::string kind;
    std::string name;
    std::size_t a;
    std::size_t b;
    double value;
    std::optional<dense::Time> lo;  // none where a window has none
    std::optional<dense::Time> hi;
};

}  // namespace rtamt

namespace rtamt::dense {

// Events of a variable.
struct Events {
    const Time* times;
    const double* values;
    std::size_t size;
};

constexpr std::size_t kBlock = 512;  // events of a variable that stay in the cache

// Very many events of some variables in parts: of none are there more than a block, and those of
// the next part come later.
class Parts {
public:
    Parts(const Events* events, std::size_t variables)
        : rest_(events, events + variables), part_(variables) {}

    // Null if nothing is left.
    const Events* next() {
        Time upto = kAfter;
        bool any = false;
        for (const Events& e : rest_) {
            any |= e.size > 0;
            if (e.size > kBlock) upto = std::min(upto, e.times[kBlock - 1]);
        }
        if (!any) return nullptr;
        for (std::size_t v = 0; v < rest_.size(); ++v) {
            Events& e = rest_[v];
            const std::size_t most = std::min(e.size, kBlock);
            const auto n =
                static_cast<std::size_t>(std::upper_bound(e.times, e.times + most, upto) - e.times);
            part_[v] = {e.times, e.values, n};
            e = {e.times + n, e.values + n, e.size - n};
        }
        return part_.data();
    }

private:
    std::vector<Events> rest_;
    std::vector<Events> part_;
};

// Whether row i is a term: it reads a variable, or terms before it, or nothing.
template <class Row>
bool is_term(const Row& row, std::size_t i, std::size_t variables) {
    if (row.kind == "LOAD") return row.a < variables;
    if (row.kind != "MAP") return row.kind == "CONST";
    return row.a < i && row.b < i && function_named(row.name) != nullptr;
}

class Sampler {
public:
    // Takes the value of each variable before its first event; nan where none is declared. Nothing
    // waits for a variable that has one: rtamt/machines/dense/rows.py.
    Sampler(const std::vector<DenseRow>& rows, std::size_t terms,
            const std::vector<double>& declared);
    Sampler(const Sampler&) = delete;
    Sampler& operator=(const Sampler&) = delete;

    std::size_t variables() const { return inputs_.size(); }
    // Whether the sampler computes this register: no window comes before it.
    bool samples(std::size_t i) const { return sampled_[i]; }

    // Whether these events may follow the variable's last ones: times rise, no value is nan.
    bool fits(std::size_t variable, Events events) const { return fit(after(variable), events); }
    static bool fit(Time last, Events events);
    // Adds new events of every variable; removes them again.
    void extend(const Events* events);
    void retract(const Events* events);
    void trim() {
        for (Stream& input : inputs_) input.trim();
    }
    // The time of the first event of a variable, kAfter if there is none. Called before the trace
    // begins.
    Time first_time(std::size_t variable) const { return inputs_[variable].times(0)[0]; }
    // The time of the last event of a variable, kBefore if there is none.
    Time last_time(std::size_t variable) const { return inputs_[variable].last_time(); }
    // The time that the next event of a variable has to be later than. One that has its declared
    // value still has it at all times that are known.
    Time after(std::size_t variable) const {
        const Time last = last_time(variable);
        return last == kBefore && declared_[variable] && started_ ? known() : last;
    }
    // The begin of the trace, kAfter if there is none yet. Called before the trace begins.
    Time begin() const;
    // The time up to which all variables are known.
    Time known() const;
    bool started() const { return started_; }

    // Finds the next times, a block at most. Returns false if there are none.
    bool read() { return read(known()); }
    bool read(Time known);
    // Computes the registers at these times. Returns false if a term is nan.
    bool evaluate();
    void consume();
    // Evaluates all new events without consuming them. Returns false if a term is nan.
    bool rehearse();
    // Whether all new events are one block.
    bool brief() const { return brief(known()); }
    bool brief(Time known) const { return started_ && joint_.upto(known, kBlock) == known; }

    std::size_t size() const { return joint_.size(); }
    const Time* times() const { return joint_.times(); }
    Time upto() const { return upto_; }  // the end of this block
    const double* column(std::size_t i) const { return columns_[i]; }

    Time nan_time() const { return nan_time_; }
    const std::vector<double>& nan_values() const { return nan_values_; }

    void reset();
    void fields(Snapshot& s);

private:
    struct Load {
        std::size_t out;
        std::size_t variable;
    };
    struct Const {
        std::size_t out;
        double value;
    };
    struct Operation {
        Function function;
        std::size_t out;
        std::size_t a;
        std::size_t b;
        bool term;
    };

    void enlarge(std::size_t n);

    std::vector<Stream> inputs_;
    std::vector<bool> declared_;
    Joint joint_;
    std::vector<bool> sampled_;
    std::vector<Load> loads_;
    std::vector<Const> constants_;
    std::vector<Operation> operations_;
    std::vector<const double*> columns_;
    std::vector<double> memory_;
    std::size_t capacity_ = 0;  // of a column
    Time upto_ = kBefore;
    Time nan_time_ = 0;
    std::vector<double> nan_values_;
    bool started_ = false;
};

}  // namespace rtamt::dense
