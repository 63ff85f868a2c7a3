// The arguments of update(*args, **named) that are read at once: exact types, where no code of a
// caller can run. False leaves an argument, and every message, to rtamt.inputs.SampleReader.
#pragma once

#include <nanobind/nanobind.h>

#include <cstring>
#include <string>
#include <vector>

namespace rtamt {

namespace nb = nanobind;

// What numpy says about itself, asked once. Borrowed for ever: numpy cannot be unloaded.
struct Numpy {
    PyTypeObject* ndarray;
    PyTypeObject* float64;
    PyTypeObject* float32;

    Numpy() {
        const auto numpy = nb::module_::import_("numpy");
        const auto type = [&](const char* name) {
            return reinterpret_cast<PyTypeObject*>(nb::object(numpy.attr(name)).release().ptr());
        };
        ndarray = type("ndarray");
        float64 = type("float64");
        float32 = type("float32");
    }
};

class Arguments {
public:
    explicit Arguments(const nb::tuple& names) : names_(names), order_(nb::len(names)) {}

    bool positional(PyObject* const* args, double* out) const {
        const std::size_t n = order_.size();
        for (std::size_t i = 0; i < n; ++i)
            if (!number(args[i], out[i])) return false;
        return true;
    }

    // Values in the order of the call; where each goes is remembered for the next call, which from
    // the same line of a program comes with the same tuple of names.
    bool keywords(PyObject* const* args, PyObject* kwnames, double* out) {
        if (kwnames != kwnames_.ptr() && !learn(kwnames)) return false;
        const std::size_t n = order_.size();
        for (std::size_t i = 0; i < n; ++i)
            if (!number(args[i], out[order_[i]])) return false;
        return true;
    }

    bool dict(PyObject* dict, double* out) const {
        const auto n = static_cast<Py_ssize_t>(order_.size());
        if (PyDict_GET_SIZE(dict) != n) return false;
        PyObject* key;
        PyObject* value;
        Py_ssize_t place = 0;
        for (Py_ssize_t i = 0; i < n; ++i) {
            // Most dicts list the variables in our order, with the same interned names.
            if (!PyDict_Next(dict, &place, &key, &value)) return false;
            if (key != name(i)) return looked_up(dict, i, out);
            if (!number(value, out[i])) return false;
        }
        return true;
    }

    bool array(PyObject* array, double* out) const {
        Py_buffer view;
        if (PyObject_GetBuffer(array, &view, PyBUF_ND | PyBUF_FORMAT) != 0) {
            PyErr_Clear();
            return false;
        }
        const auto n = static_cast<Py_ssize_t>(order_.size());
        const bool fits = view.ndim == 1 && view.shape[0] == n && view.itemsize == sizeof(double) &&
                          view.format != nullptr && std::strcmp(view.format, "d") == 0;
        if (fits) std::memcpy(out, view.buf, n * sizeof(double));
        PyBuffer_Release(&view);
        return fits;
    }

    std::size_t size() const { return order_.size(); }
    const Numpy& numpy() const { return numpy_; }

    int traverse(visitproc visit, void* arg) const {
        Py_VISIT(names_.ptr());
        Py_VISIT(kwnames_.ptr());
        return 0;
    }

private:
    PyObject* name(std::size_t i) const { return PyTuple_GET_ITEM(names_.ptr(), i); }

    bool number(PyObject* object, double& out) const {
        if (PyFloat_CheckExact(object)) [[likely]] {
            out = PyFloat_AS_DOUBLE(object);
            return true;
        }
        return other_number(object, out);
    }

    bool other_number(PyObject* object, double& out) const {
        if (Py_TYPE(object) != numpy_.float64 && Py_TYPE(object) != numpy_.float32 &&
            !PyLong_CheckExact(object) && !PyBool_Check(object))
            return false;
        out = PyFloat_AsDouble(object);
        if (out == -1.0 && PyErr_Occurred()) {  // an int that no double holds
            PyErr_Clear();
            return false;
        }
        return true;
    }

    bool looked_up(PyObject* dict, std::size_t from, double* out) const {
        for (std::size_t i = from; i < order_.size(); ++i) {
            PyObject* value = PyDict_GetItemWithError(dict, name(i));
            if (value == nullptr) {
                PyErr_Clear();
                return false;
            }
            if (!number(value, out[i])) return false;
        }
        return true;
    }

    bool learn(PyObject* kwnames) {
        const std::size_t n = order_.size();
        if (static_cast<std::size_t>(PyTuple_GET_SIZE(kwnames)) != n) return false;
        kwnames_ = nb::tuple();
        for (std::size_t i = 0; i < n; ++i) {
            const std::size_t place = find(PyTuple_GET_ITEM(kwnames, i), i);
            if (place == n) return false;
            order_[i] = place;
        }
        // A call names nothing twice: as many names, all known, are all of them.
        kwnames_ = nb::borrow<nb::tuple>(kwnames);
        return true;
    }

    std::size_t find(PyObject* name_, std::size_t guess) const {
        const std::size_t n = order_.size();
        for (std::size_t i = 0, place = guess; i < n; ++i, place = place + 1 < n ? place + 1 : 0)
            if (name_ == name(place)) return place;
        for (std::size_t i = 0; i < n; ++i)
            if (PyUnicode_Compare(name_, name(i)) == 0) return i;
        PyErr_Clear();
        return n;
    }

    nb::tuple names_;
    nb::tuple kwnames_;
    std::vector<std::size_t> order_;
    Numpy numpy_;
};

}  // namespace rtamt
