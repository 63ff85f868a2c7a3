// What the Python classes of the machines on samples share: update, inputs, samples.
#pragma once

#include <nanobind/nanobind.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "python/arrays.hpp"
#include "python/object.hpp"

namespace rtamt {

// Whether a machine takes in samples that are not known.
template <class M>
concept Uncertain = requires(M& machine, const double* ends) { machine.take(ends, ends); };

// A sample that lies between two others: numbers, and intervals where it is not known.
inline nb::list sample_between(const double* lower, const double* upper, std::size_t n) {
    nb::list sample = list_of(lower, n);
    for (std::size_t i = 0; i < n; ++i)
        if (!same(lower[i], upper[i]))
            sample[i] = nb::module_::import_("rtamt.inputs.between")
                            .attr("UncertainValue")(lower[i], upper[i]);
    return sample;
}

template <class M>
nb::list inputs(const NamedObject<M>& object) {
    const M& machine = object.machine;
    const std::size_t n = machine.samples() > 0 ? machine.variables() : 0;
    if constexpr (Uncertain<M>)
        return sample_between(machine.inputs(), machine.upper_inputs(), n);
    else
        return list_of(machine.inputs(), n);
}

// Raises the error of a call that the state of an episode does not allow; its text is in Python.
[[noreturn]] inline void refuse_state(const char* call) {
    refuse(nb::module_::import_("rtamt.machines.episode.machine"), call);
}

template <class M>
[[noreturn]] void refuse_nan(const Object<M>& object, const double* values, std::int64_t sample) {
    refuse(object.reader, "refuse", list_of(values, object.machine.variables()), sample);
}

// Takes in a sample that the reader has made, if a value of it is not known.
template <Uncertain M>
bool take_between(NamedObject<M>& object, nb::handle values) {
    std::vector<double> lower;
    std::vector<double> upper;
    bool known = true;
    for (nb::handle value : values) {
        const bool number = PyFloat_Check(value.ptr());
        known &= number;
        lower.push_back(nb::cast<double>(number ? value : value.attr("lower")));
        upper.push_back(nb::cast<double>(number ? value : value.attr("upper")));
    }
    if (known) return false;
    if (!object.machine.take(lower.data(), upper.data()))
        refuse(object.reader, "refuse", values, object.machine.samples());
    return true;
}

// Takes in the pending sample, nan being what is not known. Returns false if there is none, or if a
// term has no value.
template <class T>
bool take_unknown(T& object) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    const double* sample = object.machine.pending();
    std::vector<double> lower(sample, sample + object.machine.variables());
    std::vector<double> upper = lower;
    bool unknown = false;
    for (std::size_t i = 0; i < lower.size(); ++i) {
        if (lower[i] == lower[i]) continue;
        unknown = true;
        lower[i] = -inf;
        upper[i] = inf;
    }
    return unknown && object.machine.take(lower.data(), upper.data());
}

// Leaves the rare forms of arguments, nan and all errors to the reader.
template <class M>
void take_slowly(NamedObject<M>& object, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    M& machine = object.machine;
    const auto [positional, named] = packed(args, n, kwnames);
    const char* const form = Uncertain<M> ? "read_sample" : "read";
    const nb::object values =
        object.reader.attr(form)(positional, named, machine.samples(), inputs(object));
    require_idle(object);
    // What the reader converts may run code of a caller.
    if constexpr (requires { machine.finished(); }) {
        if (machine.finished()) [[unlikely]]
            refuse_state("refuse_update");
    }
    if (nb::len(values) != machine.variables())
        throw std::runtime_error("the reader gave another number of values");
    if constexpr (Uncertain<M>) {
        if (take_between(object, values)) return;
    }
    double* pending = machine.pending();
    for (nb::handle value : values) *pending++ = nb::cast<double>(value);
    if (!machine.take()) refuse_nan(object, machine.pending(), machine.samples());
}

// Reads the frequent forms of arguments; false if they have another form.
inline bool read_at_once(Arguments& arguments, PyObject* const* args, Py_ssize_t n,
                         PyObject* kwnames, double* pending) {
    if (kwnames != nullptr) return n == 0 && arguments.keywords(args, kwnames, pending);
    if (n == 1) {
        if (PyDict_CheckExact(args[0])) return arguments.dict(args[0], pending);
        if (arguments.is_array(args[0])) return arguments.array(args[0], pending);
    }
    return static_cast<std::size_t>(n) == arguments.size() && arguments.positional(args, pending);
}

// Takes in the sample that was read to pending(); the arguments are what it was read from.
template <class T>
void take_pending(T& object, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    auto& machine = object.machine;
    if (machine.take()) [[likely]]
        return;
    if constexpr (requires { object.nan_is_unknown; }) {
        if (object.nan_is_unknown && take_unknown(object)) return;
    }
    const double* values = machine.pending();
    if (std::none_of(values, values + machine.variables(), [](double x) { return x != x; }))
        refuse_nan(object, values, machine.samples());
    take_slowly(object, args, n, kwnames);
}

template <class T>
void require_open(const T& object) {
    if (object.running) [[unlikely]]
        require_idle(object);
    if constexpr (requires { object.machine.finished(); }) {
        if (object.machine.finished()) [[unlikely]]
            refuse_state("refuse_update");
    }
}

template <class T>
PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return call<T>(self, [=](T& object) {
        require_open(object);
        if (read_at_once(object.arguments, args, n, kwnames, object.machine.pending())) [[likely]]
            take_pending(object, args, n, kwnames);
        else
            take_slowly(object, args, n, kwnames);
        return result_of(object);
    });
}

template <class T>
PyMethodDef sample_update() {
    return update_method(
        update<T>,
        "update($self, /, *args, **named)\n--\n\n"
        "Take in one sample, by position, by name, as a mapping or an array; return the result.");
}

// Adds a class with what machines on samples have to a module.
template <class T>
nb::class_<T> sample_class(nb::module_& m, const char* name, const char* doc,
                           PyMethodDef* methods) {
    auto made = machine_class<T>(m, name, doc, methods);
    made.def_prop_ro("samples", when_idle<T>([](auto& object) { return object.machine.samples(); }))
        .def_prop_ro("inputs", when_idle<T>([](auto& object) { return inputs(object); }))
        .def("retire", retire<T>)
        .def("reset", reset<T>);
    return made;
}

}  // namespace rtamt
