// Nodes: each computes the stream of one register from the streams of its operands.
#pragma once

#include <cstddef>
#include <string>
#include <utility>

#include "dense/joint.hpp"

namespace rtamt::dense {

// Applies a function to two columns of n values: operands, result, n.
using Function = void (*)(const double*, const double*, double*, std::size_t);

// Null if there is no such function.
Function function_named(const std::string& name);

class StreamNode {
public:
    StreamNode() = default;
    StreamNode(const StreamNode&) = delete;
    StreamNode& operator=(const StreamNode&) = delete;
    virtual ~StreamNode() = default;

    // The trace begins.
    virtual void begin(Time) {}
    // Computes as far as the frontiers of the operands allow; all variables are known before
    // `known`.
    virtual void advance(Time known) = 0;
    // Computes up to the end of the trace; `after` is the next tick. The operands are complete.
    virtual void finish(Time end, Time after) = 0;
    virtual void reset() {}
    virtual void fields(Snapshot&) {}
};

// Applies a function to the values that its operands have at the same time.
class MapNode final : public StreamNode {
public:
    MapNode(Joint in, Function function, Stream& out)
        : in_(std::move(in)), function_(function), out_(out) {}

    void advance(Time) override {
        const Time limit = in_.frontier();
        if (limit > out_.frontier()) run(limit);
    }
    void finish(Time, Time after) override { run(after); }

private:
    void run(Time limit) {
        in_.read([=](Time time) { return time < limit; });
        const std::size_t n = in_.size();
        double* values = scratch_.reserve(n);
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
