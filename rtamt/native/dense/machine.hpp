// Runs a program on events over dense time. The definition is rtamt/machines/dense/machine.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "dense/sampler.hpp"

namespace rtamt::dense {

// Events of a variable that update() will take in.
struct Pending {
    std::vector<Time> times;
    std::vector<double> values;

    Events events() const { return {times.data(), values.data(), times.size()}; }
};

// What the machines on events share.
class EventMachine {
public:
    EventMachine(const EventMachine&) = delete;
    EventMachine& operator=(const EventMachine&) = delete;

    const Sampler& sampler() const { return sampler_; }
    // The new events of every variable, which fit and which the caller writes before take().
    std::vector<Pending>& pending() { return pending_; }
    // What times are is kept for the caller: it is a part of the state.
    Dating dating() const { return dating_; }
    void set_dating(Dating dating) { dating_ = dating; }
    bool finished() const { return finished_; }
    std::uint64_t fingerprint() const { return fingerprint_; }  // of the program

protected:
    EventMachine(const std::vector<DenseRow>& rows, std::size_t terms,
                 const std::vector<double>& declared)
        : sampler_(rows, terms, declared), pending_(declared.size()), events_(declared.size()) {}

    // Adds the pending events.
    void extend() {
        for (std::size_t v = 0; v < pending_.size(); ++v) events_[v] = pending_[v].events();
        sampler_.extend(events_.data());
    }
    void retract() { sampler_.retract(events_.data()); }
    void reset() {
        sampler_.reset();
        finished_ = false;
        dating_ = Dating::none;
    }

    Sampler sampler_;
    std::vector<Pending> pending_;
    std::vector<Events> events_;
    bool finished_ = false;
    Dating dating_ = Dating::none;
    std::uint64_t fingerprint_ = 0;
};

}  // namespace rtamt::dense

namespace rtamt {

class DenseMachine : public dense::EventMachine {
public:
    // Rows are checked as far as memory needs it, as the program was verified in Python.
    // The variables have these declared values, nan where none is.
    DenseMachine(const std::vector<DenseRow>& rows, std::size_t terms,
                 const std::vector<double>& declared, std::size_t result,
                 const std::vector<std::size_t>& observed);

    // Takes in the pending events. Returns false, and changes nothing, if a term is nan.
    bool take();
    // Takes in very many events, and emits the result on the way. If a term is nan, returns false,
    // and only reset() is left to do.
    template <class Emit>
    bool run(const dense::Events* events, Emit emit);
    // Ends the trace at the last time at which all variables are known. Returns false, and changes
    // nothing, if there is none.
    bool finish();
    // Calls emit(time, value) for every new step of the result.
    template <class Emit>
    void drain(Emit emit);

    // The time before which the result is known; when finished, the end.
    dense::Time settled() const;
    // The last known value of every observed register, nan before the first.
    std::vector<double> values() const;

    void reset();
    void fields(Snapshot& s);

private:
    // A reader of a stream outside the program.
    struct Observer {
        dense::Stream* stream;
        std::size_t reader;

        // The number of new steps before the frontier.
        std::size_t fresh() const;
    };

    void compile(std::size_t i, const DenseRow& row);
    Observer observe(std::size_t i) { return {&streams_[i], streams_[i].add_reader()}; }
    void proceed();
    void settle(dense::Time known);
    void trim();

    std::vector<dense::Stream> streams_;  // of the registers that nodes or observers read
    std::vector<std::size_t> published_;  // the registers among them that the sampler computes
    std::vector<std::unique_ptr<dense::StreamNode>> nodes_;
    Observer result_;
    std::vector<Observer> observed_;
};

template <class Emit>
void DenseMachine::drain(Emit emit) {
    const dense::Time* times = result_.stream->times(result_.reader);
    const double* values = result_.stream->values(result_.reader);
    const std::size_t n = result_.fresh();
    for (std::size_t i = 0; i < n; ++i) emit(times[i], values[i]);
    result_.stream->consume(result_.reader, n);
    for (const Observer& o : observed_) o.stream->consume(o.reader, o.fresh());
}

template <class Emit>
bool DenseMachine::run(const dense::Events* events, Emit emit) {
    dense::Parts parts(events, sampler_.variables());
    while (const dense::Events* part = parts.next()) {
        sampler_.extend(part);
        while (sampler_.read()) {
            if (!sampler_.evaluate()) return false;
            proceed();
        }
        drain(emit);
    }
    return true;
}

}  // namespace rtamt
