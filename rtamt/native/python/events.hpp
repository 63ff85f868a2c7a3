// Reads events: the frequent forms, which run no code of a caller, here; the others, and all errors,
// are left to rtamt.inputs.event_reader.EventReader.
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
#include "python/numpy.hpp"
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

    bool read(PyObject* events, const Clock& clock, dense::Pending& out) const {
        if (PyList_CheckExact(events)) return pairs(events, clock, out);
        if (Py_TYPE(events) == events_) return columns(events, clock, out);
        Py_ssize_t n = 0;
        const double* rows = numpy_.rows(events, 2, n);
        if (rows == nullptr) return PyTuple_CheckExact(events) && pairs(events, clock, out);
        resize(out, n);
        for (Py_ssize_t i = 0; i < n; ++i) out.values[i] = rows[2 * i + 1];
        return clock.count(rows, 2, out.times.size(), out.times.data());
    }

    // Doubles that are times and values; false if they are others.
    bool doubles(nb::handle times, nb::handle values, const double*& t, const double*& v,
                 std::size_t& n) const {
        Py_ssize_t size = 0;
        Py_ssize_t same = 0;
        t = numpy_.column(times.ptr(), size);
        v = numpy_.column(values.ptr(), same);
        n = static_cast<std::size_t>(size);
        return t != nullptr && v != nullptr && size == same;
    }

private:
    static void resize(dense::Pending& out, Py_ssize_t n) {
        out.times.resize(static_cast<std::size_t>(n));
        out.values.resize(static_cast<std::size_t>(n));
    }

    // A list or tuple of lists or tuples.
    bool pairs(PyObject* events, const Clock& clock, dense::Pending& out) const {
        const Py_ssize_t n = PySequence_Fast_GET_SIZE(events);
        PyObject** items = PySequence_Fast_ITEMS(events);
        resize(out, n);
        for (Py_ssize_t i = 0; i < n; ++i) {
            PyObject* item = items[i];
            if ((!PyTuple_CheckExact(item) && !PyList_CheckExact(item)) ||
                PySequence_Fast_GET_SIZE(item) != 2)
                return false;
            PyObject** pair = PySequence_Fast_ITEMS(item);
            double time;
            if (!numpy_.number(pair[0], time) || !numpy_.number(pair[1], out.values[i]))
                return false;
            // The double of a large integer may be another number.
            if (!PyFloat_CheckExact(pair[0]) && !(std::abs(time) < 0x1p53)) return false;
            if (!clock.count(time, out.times[i])) return false;
        }
        return true;
    }

    bool columns(PyObject* events, const Clock& clock, dense::Pending& out) const {
        const auto given = nb::steal(PyObject_GetAttr(events, given_));
        if (!given.is_valid()) nb::raise_python_error();
        const double* times;
        const double* values;
        std::size_t n;
        if (!doubles(given[0], given[1], times, values, n)) return false;
        out.times.resize(n);
        out.values.assign(values, values + n);
        return clock.count(times, 1, n, out.times.data());
    }

    PyTypeObject* events_ = permanent_type("rtamt.inputs.events", "Events");
    PyObject* given_ = PyUnicode_InternFromString("given");
    const Numpy& numpy_ = Numpy::instance();
};

inline Clock clock_of(const std::tuple<double, Time, Time>& clock) {
    const auto [scale, ticks, units] = clock;
    if (!(ticks >= 0 && units > 0)) throw nb::value_error("expected a clock that counts");
    return Clock(scale, ticks, units);
}

// A time for the reader: a tick, or -inf or inf.
inline nb::object tick_of(Time time) {
    if (time == dense::kBefore) return nb::float_(-kInfinity);
    if (time == dense::kAfter) return nb::float_(kInfinity);
    return nb::int_(time);
}

inline nb::object dated(Dating dating) {
    if (dating == Dating::none) return nb::none();
    return nb::bool_(dating == Dating::dates);
}
inline Dating dating_of(nb::handle dated) {
    if (dated.is_none()) return Dating::none;
    return nb::cast<bool>(dated) ? Dating::dates : Dating::numbers;
}

// The time of a tick as a caller sees it.
template <class M>
nb::object time_of(const EventObject<M>& object, Time tick) {
    double time;
    if (object.machine.dating() != Dating::dates && dense::counts(tick) &&
        object.clock.time(tick, time)) [[likely]]
        return nb::float_(time);
    return object.reader.attr("time")(tick_of(tick), dated(object.machine.dating()));
}

inline nb::list times_of(const dense::Sampler& sampler, Time (dense::Sampler::*time)(std::size_t) const) {
    nb::list times;
    for (std::size_t v = 0; v < sampler.variables(); ++v)
        times.append(tick_of((sampler.*time)(v)));
    return times;
}

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
Dating read_events(EventObject<M>& object, PyObject* const* args, Py_ssize_t n,
                   PyObject* kwnames) {
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
        for (const dense::Events& each : events)
            if (!dense::Sampler::fit(dense::kBefore, each))
                throw std::runtime_error("the reader gave events that do not fit");
    }

    std::size_t longest() const {
        std::size_t most = 0;
        for (const dense::Events& each : events) most = std::max(most, each.size);
        return most;
    }

    std::vector<dense::Events> events;

private:
    static constexpr std::size_t kBlock = 1024;

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
