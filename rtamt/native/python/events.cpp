#include "python/events.hpp"

#include <algorithm>
#include <cmath>

namespace rtamt {
namespace {

void resize(dense::Pending& out, Py_ssize_t n) {
    out.times.resize(static_cast<std::size_t>(n));
    out.values.resize(static_cast<std::size_t>(n));
}

}  // namespace

bool Forms::read(PyObject* events, const Clock& clock, dense::Pending& out) const {
    if (PyList_CheckExact(events)) return pairs(events, clock, out);
    if (Py_TYPE(events) == events_) return columns(events, clock, out);
    Py_ssize_t n = 0;
    const double* rows = numpy_.rows(events, 2, n);
    if (rows == nullptr) return PyTuple_CheckExact(events) && pairs(events, clock, out);
    resize(out, n);
    for (Py_ssize_t i = 0; i < n; ++i) out.values[i] = rows[2 * i + 1];
    return clock.count(rows, 2, out.times.size(), out.times.data());
}

bool Forms::doubles(nb::handle times, nb::handle values, const double*& t, const double*& v,
                    std::size_t& n) const {
    Py_ssize_t size = 0;
    Py_ssize_t same = 0;
    t = numpy_.column(times.ptr(), size);
    v = numpy_.column(values.ptr(), same);
    n = static_cast<std::size_t>(size);
    return t != nullptr && v != nullptr && size == same;
}

bool Forms::pairs(PyObject* events, const Clock& clock, dense::Pending& out) const {
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
        if (!numpy_.number(pair[0], time) || !numpy_.number(pair[1], out.values[i])) return false;
        // The double of a large integer may be another number.
        if (!PyFloat_CheckExact(pair[0]) && !(std::abs(time) < 0x1p53)) return false;
        if (!clock.count(time, out.times[i])) return false;
    }
    return true;
}

bool Forms::columns(PyObject* events, const Clock& clock, dense::Pending& out) const {
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

Clock clock_of(const std::tuple<double, Time, Time>& clock) {
    const auto [scale, ticks, units] = clock;
    if (!(ticks >= 0 && units > 0)) throw nb::value_error("expected a clock that counts");
    return Clock(scale, ticks, units);
}

nb::object tick_of(Time time) {
    if (time == dense::kBefore) return nb::float_(-kInfinity);
    if (time == dense::kAfter) return nb::float_(kInfinity);
    return nb::int_(time);
}

nb::object dated(Dating dating) {
    if (dating == Dating::none) return nb::none();
    return nb::bool_(dating == Dating::dates);
}

Dating dating_of(nb::handle dated) {
    if (dated.is_none()) return Dating::none;
    return nb::cast<bool>(dated) ? Dating::dates : Dating::numbers;
}

nb::list times_of(const dense::Sampler& sampler, Time (dense::Sampler::*time)(std::size_t) const) {
    nb::list times;
    for (std::size_t v = 0; v < sampler.variables(); ++v) times.append(tick_of((sampler.*time)(v)));
    return times;
}

EventViews::EventViews(nb::handle pair)
    : size_(nb::len(nb::object(pair[0]))),
      times_(pair[0], size_, PyBUF_ND),
      values_(pair[1], size_, PyBUF_ND) {}

bool CountedEvents::count(const nb::sequence& given, const Clock& clock) {
    constexpr std::size_t kBlock = 1024;
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

void CountedEvents::take(nb::handle columns) {
    events.clear();
    for (nb::handle column : columns) {
        views_.emplace_back(column);
        events.push_back(views_.back().events());
    }
    for (const dense::Events& each : events)
        if (!dense::Sampler::fit(dense::kBefore, each))
            throw std::runtime_error("the reader gave events that do not fit");
}

}  // namespace rtamt
