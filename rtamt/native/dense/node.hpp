// What makes the stream of one register out of others.
#pragma once

#include <cstddef>
#include <string>
#include <utility>

#include "dense/joint.hpp"

namespace rtamt::dense {

// A function of MAP, of arrays.
using Function = void (*)(const double*, const double*, double*, std::size_t);

Function function_named(const std::string& name);  // null if there is none

class Node {
public:
    Node() = default;
    Node(const Node&) = delete;
    Node& operator=(const Node&) = delete;
    virtual ~Node() = default;

    virtual void begin(double first) = 0;
    // Goes as far as the operands' frontiers allow; `known` is that of all variables.
    virtual void advance(double known) = 0;
    // Goes to the end of the trace, `after` being the next number; all steps of the operands came.
    virtual void finish(double end, double after) = 0;
    virtual void reset() = 0;
    virtual void save(Writer& out) const = 0;
    virtual void load(Reader& in) = 0;
};

// MAP.
class Pointwise final : public Node {
public:
    Pointwise(Joint in, Function function, Stream& out)
        : in_(std::move(in)), function_(function), out_(out) {}

    void begin(double) override {}
    void advance(double) override {
        const double limit = in_.frontier();
        if (limit > out_.frontier()) run(limit);
    }
    void finish(double, double after) override { run(after); }
    void reset() override {}
    void save(Writer&) const override {}
    void load(Reader&) override {}

private:
    void run(double limit) {
        in_.read([=](double time) { return time < limit; });
        const std::size_t n = in_.size();
        double* values = scratch_.room(n);
        function_(in_.column(0), in_.column(in_.width() - 1), values, n);
        out_.append(in_.times(), values, n);
        in_.consume();
        out_.settle(limit);
    }

    Joint in_;
    Function function_;
    Stream& out_;
    Scratch scratch_;
};

}  // namespace rtamt::dense
