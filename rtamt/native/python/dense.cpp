// The dense machine as a Python class.
#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/events.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

using dense::Dating;

struct DenseObject : NamedObject<DenseMachine> {
    Clock clock;
};

Clock clock_of(const std::tuple<double, Time, Time>& clock) {
    const auto [scale, ticks, units] = clock;
    if (!(ticks >= 0 && units > 0)) throw nb::value_error("expected a clock that counts");
    return Clock(scale, ticks, units);
}

void construct(DenseObject* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result,
               const std::tuple<double, Time, Time>& clock, const nb::sequence& observed,
               nb::object reader) {
    const Clock counts = clock_of(clock);
    new (self) DenseObject{{{DenseMachine(dense_rows(rows), terms, nb::len(variables), result,
                                          registers_of(observed)),
                             std::move(reader)},
                            Arguments(variables)},
                           counts};
}

// A time for the reader: a tick, or -inf or inf.
nb::object tick_of(Time time) {
    if (time == dense::kBefore) return nb::float_(-kInfinity);
    if (time == dense::kAfter) return nb::float_(kInfinity);
    return nb::int_(time);
}

nb::object dated(Dating dating) {
    return dating == Dating::none ? nb::object(nb::none()) : nb::object(nb::bool_(dating == Dating::dates));
}
Dating dating_of(nb::handle dated) {
    if (dated.is_none()) return Dating::none;
    return nb::cast<bool>(dated) ? Dating::dates : Dating::numbers;
}

// The time of a tick as a caller sees it.
nb::object time_of(const DenseObject& object, Time tick) {
    double time;
    if (object.machine.dating() != Dating::dates && dense::counts(tick) &&
        object.clock.time(tick, time)) [[likely]]
        return nb::float_(time);
    return object.reader.attr("time")(tick_of(tick), dated(object.machine.dating()));
}

nb::list times_of(const dense::Sampler& sampler, Time (dense::Sampler::*time)(std::size_t) const) {
    nb::list times;
    for (std::size_t v = 0; v < sampler.variables(); ++v)
        times.append(tick_of((sampler.*time)(v)));
    return times;
}

[[noreturn]] void refuse_nan(const DenseObject& object, Dating dating) {
    const dense::Sampler& sampler = object.machine.sampler();
    const std::vector<double>& values = sampler.nan_values();
    refuse(object.reader, "refuse", list_of(values.data(), values.size()),
           nb::make_tuple(sampler.nan_time(), dated(dating)));
}

bool fit(const DenseObject& object, std::vector<dense::Pending>& pending) {
    for (std::size_t v = 0; v < pending.size(); ++v)
        if (!object.machine.sampler().fits(v, pending[v].events())) return false;
    return true;
}

// Reads a dict of frequent forms, which runs no code of a caller; false if events are not that.
bool read_events(DenseObject& object, PyObject* events) {
    std::vector<dense::Pending>& pending = object.machine.pending();
    for (dense::Pending& p : pending) {
        p.times.clear();
        p.values.clear();
    }
    if (!PyDict_CheckExact(events) || object.machine.dating() == Dating::dates) return false;
    const Forms& forms = Forms::instance();
    PyObject* name;
    PyObject* value;
    Py_ssize_t place = 0;
    for (std::size_t guess = 0; PyDict_Next(events, &place, &name, &value); ++guess) {
        const std::size_t v = object.arguments.place(name, guess < pending.size() ? guess : 0);
        if (v == pending.size() || !forms.read(value, object.clock, pending[v])) return false;
    }
    return fit(object, pending);
}

bool any(const std::vector<dense::Pending>& pending) {
    for (const dense::Pending& p : pending)
        if (!p.times.empty()) return true;
    return false;
}

// The events of a pair of arrays, with times in ticks.
class EventViews {
public:
    explicit EventViews(nb::handle pair)
        : size_(nb::len(nb::object(pair[0]))),
          times_(pair[0], size_, PyBUF_ND),
          values_(pair[1], size_, PyBUF_ND) {}

    dense::Events events() const {
        return {times_.data<Time>(), values_.data<double>(), size_};
    }

private:
    std::size_t size_;
    ArrayView times_;
    ArrayView values_;
};

// Leaves the rare forms of events and all errors to the reader. Returns what times are then.
Dating read_events_slowly(DenseObject& object, PyObject* events) {
    const nb::object read = object.reader.attr("read")(
        nb::handle(events), times_of(object.machine.sampler(), &dense::Sampler::last_time),
        dated(object.machine.dating()));
    require_idle(object);
    if (object.machine.finished()) refuse(object.reader, "refuse_update");
    const nb::object columns = read[0];
    std::vector<dense::Pending>& pending = object.machine.pending();
    if (nb::len(columns) != pending.size())
        throw std::runtime_error("the reader gave another number of columns");
    for (std::size_t v = 0; v < pending.size(); ++v) {
        const EventViews views(columns[v]);
        const dense::Events events = views.events();
        pending[v].times.assign(events.times, events.times + events.size);
        pending[v].values.assign(events.values, events.values + events.size);
    }
    if (!fit(object, pending)) throw std::runtime_error("the reader gave events that do not fit");
    return dating_of(read[1]);
}

nb::list new_steps(DenseObject& object) {
    nb::list list = nb::steal<nb::list>(PyList_New(0));
    object.machine.drain([&](Time tick, double value) {
        double time;
        nb::object pair;
        if (object.machine.dating() != Dating::dates && object.clock.time(tick, time)) [[likely]] {
            pair = nb::steal(pair_of(time, value));
            if (!pair.is_valid()) nb::raise_python_error();
        } else {
            pair = nb::make_tuple(time_of(object, tick), value);
        }
        if (PyList_Append(list.ptr(), pair.ptr()) != 0) nb::raise_python_error();
    });
    return list;
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return call<DenseObject>(self, [=](DenseObject& object) {
        if (object.running) [[unlikely]] require_idle(object);
        if (object.machine.finished()) [[unlikely]] refuse(object.reader, "refuse_update");
        nb::object events;
        if (n == 1 && !kwnames) [[likely]] {
            events = nb::borrow(args[0]);
        } else {
            const auto [positional, named] = packed(args, n, kwnames);
            events = object.reader.attr("given")(positional, named);
        }
        Dating dating = object.machine.dating();
        if (!read_events(object, events.ptr())) [[unlikely]] {
            dating = read_events_slowly(object, events.ptr());
        } else if (dating == Dating::none && any(object.machine.pending())) {
            dating = Dating::numbers;
        }
        if (!object.machine.take()) [[unlikely]] refuse_nan(object, dating);
        object.machine.set_dating(dating);
        return new_steps(object).release().ptr();
    });
}

void end(DenseObject& object) {
    if (object.machine.finish()) return;
    const dense::Sampler& sampler = object.machine.sampler();
    refuse(object.reader, "refuse_end", times_of(sampler, &dense::Sampler::first_time),
           times_of(sampler, &dense::Sampler::last_time), dated(object.machine.dating()));
}

nb::list finish(DenseObject& object) {
    require_idle(object);
    if (!object.machine.finished()) end(object);
    return new_steps(object);
}

// The events of a whole trace, with times in ticks.
class Trace {
public:
    // Counts times that are doubles; false if there are others, or what is no signal.
    bool count(const nb::sequence& given, const Clock& clock) {
        for (nb::handle pair : given) {
            const double* times;
            const double* values;
            std::size_t n;
            if (!Forms::instance().doubles(pair[0], pair[1], times, values, n)) return false;
            counted_.push_back(std::make_unique_for_overwrite<Time[]>(n));
            Time* ticks = counted_.back().get();
            Time last = dense::kBefore;
            for (std::size_t i = 0; i < n; i += kBlock) {
                const std::size_t size = std::min(kBlock, n - i);
                if (!clock.count(times + i, 1, size, ticks + i) ||
                    !dense::Sampler::fit(last, {ticks + i, values + i, size}))
                    return false;
                last = ticks[i + size - 1];
            }
            events.push_back({ticks, values, n});
        }
        return true;
    }
    // Takes what the reader has counted.
    void take(nb::handle columns) {
        events.clear();
        for (nb::handle column : columns) {
            views_.emplace_back(column);
            events.push_back(views_.back().events());
        }
    }

    std::vector<dense::Events> events;

private:
    static constexpr std::size_t kBlock = 1024;

    std::vector<std::unique_ptr<Time[]>> counted_;
    std::vector<EventViews> views_;
};

nb::object array_of_times(const DenseObject& object, const std::vector<Time>& ticks) {
    static const NewArray integers("int64");
    static const NewArray doubles("float64");
    const auto at = [&](std::size_t i) { return ticks[i]; };
    bool fine = object.machine.dating() != Dating::dates;
    nb::object times = doubles.make<double>(ticks.size(), [&](std::size_t i) {
        double time = 0.0;
        fine = fine && object.clock.time(ticks[i], time);
        return time;
    });
    if (fine) return times;
    return object.reader.attr("times")(integers.make<Time>(ticks.size(), at),
                                       dated(object.machine.dating()));
}

nb::tuple run(DenseObject& object, const nb::sequence& given) {
    require_idle(object);
    DenseMachine& machine = object.machine;
    const dense::Sampler& sampler = machine.sampler();
    if (nb::len(given) != sampler.variables())
        throw nb::value_error("expected events of every variable");
    for (std::size_t v = 0; v < sampler.variables(); ++v)
        if (sampler.last_time(v) > dense::kBefore)
            throw nb::value_error("expected a new machine");
    Trace trace;
    if (trace.count(given, object.clock)) {
        machine.set_dating(Dating::numbers);
    } else {
        const nb::object counted = object.reader.attr("counted")(
            given, times_of(sampler, &dense::Sampler::last_time), nb::none());
        trace.take(counted[0]);
        for (const dense::Events& events : trace.events)
            if (!dense::Sampler::fit(dense::kBefore, events))
                throw std::runtime_error("the reader gave events that do not fit");
        machine.set_dating(dating_of(counted[1]));
    }
    std::size_t most = 0;
    for (const dense::Events& events : trace.events) most = std::max(most, events.size);
    std::vector<Time> ticks;
    std::vector<double> values;
    const auto emit = [&](Time tick, double value) {
        ticks.push_back(tick);
        values.push_back(value);
    };
    const bool fine =
        run_long(object, most, [&] { return machine.run(trace.events.data(), emit); });
    if (!fine) refuse_nan(object, machine.dating());
    end(object);
    machine.drain(emit);
    return nb::make_tuple(array_of_times(object, ticks), doubles(values.data(), values.size()));
}

// The ticks of an array of doubles; None if Python should count them.
nb::object ticks_of(const std::tuple<double, Time, Time>& clock, nb::handle times) {
    static const NewArray integers("int64");
    const Clock counts = clock_of(clock);
    Py_ssize_t n = 0;
    const double* given = Numpy::instance().column(times.ptr(), n);
    if (given == nullptr) return nb::none();
    std::vector<Time> ticks(static_cast<std::size_t>(n));
    if (!counts.count(given, 1, ticks.size(), ticks.data())) return nb::none();
    return integers.make<Time>(ticks.size(), [&](std::size_t i) { return ticks[i]; });
}

PyMethodDef methods[] = {
    update_method(update,
                  "update($self, /, *events, **named)\n--\n\n"
                  "Take in new events of variables; return the new steps of the result."),
    {nullptr, nullptr, 0, nullptr},
};

}  // namespace

void bind_dense(nb::module_& m) {
    m.def("ticks", ticks_of, nb::arg("clock"), nb::arg("times"),
          "Return the nearest ticks of an array of doubles, None if Python should count them;\n"
          "rtamt.program.encoding.EncodedDense describes the clock.");
    machine_class<DenseObject>(
        m, "DenseMachine",
        "Runs a program over dense time, as rtamt.machines.protocols.DenseMachine says.\n\n"
        "Args:\n"
        "    rows: The program, as rtamt.program.encoding encodes it.\n"
        "    terms: The number of rows that are arithmetic over the present values.\n"
        "    variables: Names of the inputs.\n"
        "    result: Register that update returns.\n"
        "    clock: Ticks in a unit of time, as a double and as a quotient of two numbers.\n"
        "    observed: Registers that values lists.\n"
        "    reader: Reads the rare forms of events, and raises all errors.",
        methods)
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("clock"), nb::arg("observed"), nb::arg("reader"))
        .def_prop_ro("settled", [](const DenseObject& o) { return time_of(o, o.machine.settled()); },
                     "The time before which the result is known; when finished, the end.")
        .def_prop_ro("finished", [](const DenseObject& o) { return o.machine.finished(); },
                     "Whether the trace has ended.")
        .def_prop_ro("values",
                     [](const DenseObject& o) {
                         const std::vector<double> values = o.machine.values();
                         return list_of(values.data(), values.size());
                     },
                     "The last known value of every observed register; nan before the first.")
        .def("finish", finish, "End the trace; return the rest of the result.")
        .def("run", run, nb::arg("given"),
             "Take in a whole trace, with times as they were given; return the times and values of\n"
             "the result. The machine is of no use after that.")
        .def("reset", reset<DenseObject>, "Return to the state before the first event.");
}

}  // namespace rtamt
