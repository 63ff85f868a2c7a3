// Reads the frequent forms of the arguments of update(*args, **named): values of exact types, whose
// conversion runs no code of a caller. The functions return false on other forms, which are left to
// the reader, rtamt.inputs.samples.SampleReader, as are all errors.
#pragma once

#include <nanobind/nanobind.h>

#include <vector>

#include "python/numpy.hpp"

namespace rtamt {

namespace nb = nanobind;

class Arguments {
public:
    // Throws an error of Python if a name is no text. Made before the object that holds it: GCC frees
    // the other members of an aggregate twice if the last one throws.
    explicit Arguments(const nb::tuple& names) : names_(interned(names)), order_(nb::len(names)) {}

    bool positional(PyObject* const* args, double* out) const {
        const std::size_t n = order_.size();
        for (std::size_t i = 0; i < n; ++i)
            if (!number(args[i], out[i])) return false;
        return true;
    }

    // Remembers the place of each name for the next call: calls from one line of a program have the
    // same tuple of names.
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
        for (Py_ssize_t i = 0; PyDict_Next(dict, &place, &key, &value); ++i) {
            // Most dicts have the same interned names in the same order.
            if (key != name(i)) return looked_up(dict, i, out);
            if (!number(value, out[i])) return false;
        }
        return true;
    }

    bool array(PyObject* array, double* out) const {
        return numpy_.row(array, static_cast<Py_ssize_t>(order_.size()), out);
    }

    std::size_t size() const { return order_.size(); }
    // The place of a name, or size(). Most often the guess is right.
    std::size_t place(PyObject* name, std::size_t guess) const {
        return PyUnicode_CheckExact(name) ? find(name, guess) : size();
    }
    bool is_array(PyObject* object) const { return numpy_.is_array(object); }

    int traverse(visitproc visit, void* arg) const {
        Py_VISIT(names_.ptr());
        Py_VISIT(kwnames_.ptr());
        return 0;
    }

private:
    // The names in calls and dict displays are interned, so that identity mostly decides.
    static nb::tuple interned(const nb::tuple& names) {
        nb::list list;
        for (nb::handle name : names) {
            PyObject* text = PyUnicode_FromObject(name.ptr());
            if (text == nullptr) nb::raise_python_error();
            PyUnicode_InternInPlace(&text);
            list.append(nb::steal(text));
        }
        return nb::tuple(list);
    }

    PyObject* name(std::size_t i) const { return PyTuple_GET_ITEM(names_.ptr(), i); }

    bool number(PyObject* object, double& out) const { return numpy_.number(object, out); }

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
        // No name stands twice in a call, so n known names are all the names.
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
    const Numpy& numpy_ = Numpy::instance();
};

}  // namespace rtamt
