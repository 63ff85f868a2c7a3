// Reads the frequent forms of events, which run no code of a caller; the others are left to
// rtamt.inputs.event_reader.EventReader.
#pragma once

#include <nanobind/nanobind.h>

#include <cmath>

#include "dense/machine.hpp"
#include "dense/clock.hpp"
#include "python/numpy.hpp"

namespace rtamt {

namespace nb = nanobind;

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

}  // namespace rtamt
