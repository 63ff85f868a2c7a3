// Runs a program on events over dense time: rtamt/dense.py says what that means.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "dense/sampler.hpp"

namespace rtamt::dense {

// Events of a variable that are still to be taken in.
struct Pending {
    std::vector<double> times;
    std::vector<double> values;

    Events events() const { return {times.data(), values.data(), times.size()}; }
};

class DenseMachine {
public:
    // Rows are checked only as far as memory is concerned: the program was verified in Python.
    DenseMachine(const std::vector<Row>& rows, std::size_t terms, std::size_t variables,
            std::size_t result, const std::vector<std::size_t>& observed);
    DenseMachine(const DenseMachine&) = delete;
    DenseMachine& operator=(const DenseMachine&) = delete;

    const Sampler& sampler() const { return sampler_; }

    // New events: write those of every variable, which fit, to pending(), then take them in.
    // False, and nothing changed, if a term is nan.
    std::vector<Pending>& pending() { return pending_; }
    bool take();
    // The same of very many, handing over the result on the way: if a term is nan, only reset() is
    // left to do.
    template <class Emit>
    bool run(const Events* events, Emit emit);
    // The trace ends with the last time at which all variables are known. False, and nothing
    // changed, if there is none.
    bool finish();
    // Hands over what of the result is new: emit(time, value) for every step.
    template <class Emit>
    void drain(Emit emit);

    bool finished() const { return finished_; }
    // The time before which the result is known; when finished, the end.
    double settled() const;
    // The last value of every observed register that is known, nan before the first.
    std::vector<double> values() const;

    static constexpr const char* kForeign =
        "expected a state that a native machine with this program gave; "
        "those of other programs, back-ends or processors do not fit";

    void reset();
    std::string state() const;
    // Throws std::invalid_argument on what is no state of this machine.
    void restore(std::string_view bytes);

private:
    // Who reads a stream from outside.
    struct Observer {
        Stream* stream;
        std::size_t reader;

        // The number of steps that are known and new.
        std::size_t fresh() const;
    };

    void compile(std::size_t i, const Row& row);
    Observer observe(std::size_t i) { return {&streams_[i], streams_[i].add_reader()}; }
    void proceed();
    void settle(double known);
    void trim();

    Sampler sampler_;
    std::vector<Pending> pending_;
    std::vector<Events> events_;
    std::vector<Stream> streams_;         // of the registers that are read behind the sampler
    std::vector<std::size_t> published_;  // those of them that the sampler gives
    std::vector<std::unique_ptr<Node>> nodes_;
    Observer result_;
    std::vector<Observer> observed_;
    bool finished_ = false;
    std::uint64_t fingerprint_;
};

template <class Emit>
void DenseMachine::drain(Emit emit) {
    const double* times = result_.stream->times(result_.reader);
    const double* values = result_.stream->values(result_.reader);
    const std::size_t n = result_.fresh();
    for (std::size_t i = 0; i < n; ++i) emit(times[i], values[i]);
    result_.stream->consume(result_.reader, n);
    for (const Observer& o : observed_) o.stream->consume(o.reader, o.fresh());
}

template <class Emit>
bool DenseMachine::run(const Events* events, Emit emit) {
    const std::size_t variables = sampler_.variables();
    std::vector<Events> rest(events, events + variables);
    std::vector<Events> part(variables);
    for (bool more = true; more;) {
        more = false;
        double upto = kInfinity;
        for (const Events& e : rest)
            if (e.size > Sampler::kBlock) upto = std::min(upto, e.times[Sampler::kBlock - 1]);
        for (std::size_t v = 0; v < variables; ++v) {
            Events& e = rest[v];
            const std::size_t most = std::min(e.size, Sampler::kBlock);
            const auto n = static_cast<std::size_t>(
                std::upper_bound(e.times, e.times + most, upto) - e.times);
            part[v] = {e.times, e.values, n};
            e = {e.times + n, e.values + n, e.size - n};
            more |= e.size > 0;
        }
        sampler_.extend(part.data());
        while (sampler_.read()) {
            if (!sampler_.evaluate()) return false;
            proceed();
        }
        drain(emit);
    }
    return true;
}

}  // namespace rtamt::dense
