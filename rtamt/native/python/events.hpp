// Reads events: the frequent forms, which run no code of a caller, here; the others, and all
// errors, are left to rtamt.inputs.event_reader.EventReader.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <tuple>
#include <vector>

#include "dense/clock.hpp"
#include "dense/machine.hpp"
#include "python/arrays.hpp"
#include "python/object.hpp"

namespace rtamt {

namespace nb = nanobind;

using dense::Dating;

// The object of a machine that takes events.
template <class M>
struct EventObject : NamedObject<M> {
    Clock clock;
};

// Reads the frequent forms of a variable's events; false if they have another form.
class Forms {
public:
    static const Forms& instance() {
        static const Forms forms;
        return forms;
    }

    bool read(PyObject* events, const Clock& clock, dense::Pending& out) const;

    // Doubles that are times and values; false if they are others.
    bool doubles(nb::handle times, nb::handle values, const double*& t, const double*& v,
                 std::size_t& n) const;

private:
    // A list or tuple of lists or tuples.
    bool pairs(PyObject* events, const Clock& clock, dense::Pending& out) const;
    bool columns(PyObject* events, const Clock& clock, dense::Pending& out) const;

    PyTypeObject* events_ = permanent_type("rtamt.inputs.events", "Events");
    PyObject* given_ = PyUnicode_InternFromString("given");
    const Numpy& numpy_ = Numpy::instance();
};

Clock clock_of(const std::tuple<double, Time, Time>& clock);

// A time for the reader: a tick, or -inf or inf.
nb::object tick_of(Time time);

nb::object dated(Dating dating);
Dating dating_of(nb::handle dated);

// The time of a tick as a caller sees it.
template <class M>
nb::object time_of(const EventObject<M>& object, Time tick) {
    double time;
    if (object.machine.dating() != Dating::dates && dense::counts(tick) &&
        object.clock.time(tick, time)) [[likely]]
        return nb::float_(time);
    return object.reader.attr("time")(tick_of(tick), dated(object.machine.dating()));
}

nb::list times_of(const dense::Sampler& sampler, Time (dense::Sampler::*time)(std::size_t) const);

template <class M>
[[noreturn]] void refuse_nan(const EventObject<M>& object, Dating dating) {
    const dense::Sampler& sampler = object.machine.sampler();
    const std::vector<double>& values = sampler.nan_values();
    refuse(object.reader, "refuse", list_of(values.data(), values.size()),
           nb::make_tuple(sampler.nan_time(), dated(dating)));
}

template <class M>
bool fit(const EventObject<M>& object, std::vector<dense::Pending>& pending) {
    for (std::size_t v = 0; v < pending.size(); ++v)
        if (!object.machine.sampler().fits(v, pending[v].events())) return false;
    return true;
}

// Reads a dict of frequent forms, which runs no code of a caller; false if events are not that.
template <class M>
bool read_events_fast(EventObject<M>& object, PyObject* events) {
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

inline bool any(const std::vector<dense::Pending>& pending) {
    for (const dense::Pending& p : pending)
        if (!p.times.empty()) return true;
    return false;
}

// The events of a pair of arrays, with times in ticks.
class EventViews {
public:
    explicit EventViews(nb::handle pair);

    dense::Events events() const { return {times_.data<Time>(), values_.data<double>(), size_}; }

private:
    std::size_t size_;
    ArrayView times_;
    ArrayView values_;
};

// Leaves the rare forms of events and all errors to the reader. Returns what times are then.
template <class M>
Dating read_events_slowly(EventObject<M>& object, PyObject* events) {
    const nb::object read = object.reader.attr("read")(
        nb::handle(events), times_of(object.machine.sampler(), &dense::Sampler::after),
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

// Reads the arguments of an update into pending(). Returns what times are then.
template <class M>
Dating read_events(EventObject<M>& object, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    nb::object events;
    if (n == 1 && !kwnames) [[likely]] {
        events = nb::borrow(args[0]);
    } else {
        const auto [positional, named] = packed(args, n, kwnames);
        events = object.reader.attr("given")(positional, named);
    }
    if (!read_events_fast(object, events.ptr())) [[unlikely]]
        return read_events_slowly(object, events.ptr());
    const Dating dating = object.machine.dating();
    return dating == Dating::none && any(object.machine.pending()) ? Dating::numbers : dating;
}

template <class M>
[[noreturn]] void refuse_end(const EventObject<M>& object) {
    const dense::Sampler& sampler = object.machine.sampler();
    refuse(object.reader, "refuse_end", times_of(sampler, &dense::Sampler::first_time),
           times_of(sampler, &dense::Sampler::last_time), dated(object.machine.dating()));
}

// The events of a whole trace, with times in ticks.
class CountedEvents {
public:
    // Counts times that are doubles; false if there are others, or what is no signal.
    bool count(const nb::sequence& given, const Clock& clock);
    // Takes what the reader has counted.
    void take(nb::handle columns);

    std::size_t longest() const {
        std::size_t most = 0;
        for (const dense::Events& each : events) most = std::max(most, each.size);
        return most;
    }

    std::vector<dense::Events> events;

private:
    std::vector<std::unique_ptr<Time[]>> counted_;
    std::vector<EventViews> views_;
};

// Those of a new machine.
class Trace : public CountedEvents {
public:
    // Takes times as they were given, and tells the machine what they are.
    template <class M>
    Trace(EventObject<M>& object, const nb::sequence& given) {
        const dense::Sampler& sampler = object.machine.sampler();
        if (nb::len(given) != sampler.variables())
            throw nb::value_error("expected events of every variable");
        Dating dating = Dating::numbers;
        if (!count(given, object.clock)) {
            const nb::object counted = object.reader.attr("counted")(
                given, times_of(sampler, &dense::Sampler::last_time), nb::none());
            take(counted[0]);
            dating = dating_of(counted[1]);
        }
        require_idle(object);  // other threads run while the reader counts
        for (std::size_t v = 0; v < sampler.variables(); ++v)
            if (sampler.last_time(v) > dense::kBefore)
                throw nb::value_error("expected a new machine");
        object.machine.set_dating(dating);
    }
};

}  // namespace rtamt
