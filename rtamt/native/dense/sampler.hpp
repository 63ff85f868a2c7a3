// What depends on the variables' present values alone, at all times at which one of them steps.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "dense/node.hpp"

namespace rtamt::dense {

// One instruction, as rtamt/dense.py encodes it; its register is the index of the row.
struct Row {
    std::string kind;
    std::string name;
    std::size_t a;
    std::size_t b;
    double value;
    double lo;
    double hi;
};

// Events of a variable.
struct Events {
    const double* times;
    const double* values;
    std::size_t size;
};

class Sampler {
public:
    static constexpr std::size_t kBlock = 512;  // events of a variable that stay in the cache

    Sampler(const std::vector<Row>& rows, std::size_t terms, std::size_t variables);
    Sampler(const Sampler&) = delete;
    Sampler& operator=(const Sampler&) = delete;

    std::size_t variables() const { return inputs_.size(); }
    // Whether no window comes before this register.
    bool samples(std::size_t i) const { return sampled_[i]; }

    // Whether these may follow what the variable has: times that rise, values that are numbers.
    bool fits(std::size_t variable, Events events) const;
    // New events of every variable, and back.
    void extend(const Events* events);
    void retract(const Events* events);
    void trim() {
        for (Stream& input : inputs_) input.trim();
    }
    // The first event of a variable, inf if there is none; before the trace has begun.
    double first_time(std::size_t variable) const { return inputs_[variable].times(0)[0]; }
    // The last one, -inf if there is none.
    double last_time(std::size_t variable) const { return inputs_[variable].last_time(); }
    // The time up to which all variables are known.
    double known() const;
    bool started() const { return started_; }

    // Finds the next times, not too many: false if there are none.
    bool read();
    // False if a term is nan then.
    bool evaluate();
    void consume();
    // Whether there will be no nan, and whether one block is all.
    bool rehearse();
    bool brief() const {
        const double known = this->known();
        return started_ && joint_.upto(known, kBlock) == known;
    }

    std::size_t size() const { return joint_.size(); }
    const double* times() const { return joint_.times(); }
    double upto() const { return upto_; }  // later times come in later blocks
    const double* column(std::size_t i) const { return columns_[i]; }

    double nan_time() const { return nan_time_; }
    const std::vector<double>& nan_values() const { return nan_values_; }

    void reset();
    void save(Writer& out) const;
    void load(Reader& in);

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

    void make_room(std::size_t n);

    std::vector<Stream> inputs_;
    Joint joint_;
    std::vector<bool> sampled_;
    std::vector<Load> loads_;
    std::vector<Const> constants_;
    std::vector<Operation> operations_;
    std::vector<const double*> columns_;
    std::vector<double> memory_;
    std::size_t room_ = 0;
    double upto_ = -kInfinity;
    double nan_time_ = 0.0;
    std::vector<double> nan_values_;
    bool started_ = false;
};

}  // namespace rtamt::dense
