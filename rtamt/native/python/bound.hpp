// What the Python classes of all machines share: samples as arguments, snapshots, references.
#pragma once

#include <nanobind/nanobind.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "discrete/machine.hpp"
#include "python/arguments.hpp"

namespace rtamt {

namespace nb = nanobind;

template <class M>
struct Bound {
    M machine;
    Arguments arguments;
    nb::object reader;
    bool running = false;  // without the lock of the interpreter
};

// Raises the error of a call that the state of a machine does not allow; its text is in Python.
[[noreturn]] inline void refuse_state(const char* call) {
    nb::module_::import_("rtamt.machines.episode.machine").attr(call)();
    throw std::runtime_error("Python did not refuse the call");
}

template <class M>
void require_idle(const Bound<M>& bound) {
    if (bound.running) throw std::runtime_error("the machine is running in another thread");
}

inline nb::list list_of(const double* values, std::size_t n) {
    nb::list list;
    for (std::size_t i = 0; i < n; ++i) list.append(values[i]);
    return list;
}

template <class M>
nb::list inputs(const Bound<M>& bound) {
    const M& machine = bound.machine;
    return list_of(machine.inputs(), machine.samples() > 0 ? machine.variables() : 0);
}

template <class M>
[[noreturn]] void refuse(const Bound<M>& bound, const double* values, std::int64_t sample) {
    bound.reader.attr("refuse")(list_of(values, bound.machine.variables()), sample);
    throw std::runtime_error("the reader did not refuse a term that is nan");
}

inline bool any_nan(const double* values, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        if (values[i] != values[i]) return true;
    return false;
}

// The argument forms that are rare, the nan policy and the messages are the reader's.
template <class M>
void read_slowly(Bound<M>& bound, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    nb::list positional;
    for (Py_ssize_t i = 0; i < n; ++i) positional.append(nb::handle(args[i]));
    nb::dict named;
    const Py_ssize_t keywords = kwnames == nullptr ? 0 : PyTuple_GET_SIZE(kwnames);
    for (Py_ssize_t i = 0; i < keywords; ++i)
        named[nb::handle(PyTuple_GET_ITEM(kwnames, i))] = nb::handle(args[n + i]);
    const nb::object values = bound.reader.attr("read")(nb::tuple(positional), named,
                                                        bound.machine.samples(), inputs(bound));
    require_idle(bound);
    if (nb::len(values) != bound.machine.variables())
        throw std::runtime_error("the reader gave another number of values");
    double* pending = bound.machine.pending();
    for (nb::handle value : values) *pending++ = nb::cast<double>(value);
    if (!bound.machine.take())
        refuse(bound, bound.machine.pending(), bound.machine.samples());
}

template <class M>
bool read_at_once(Bound<M>& bound, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    Arguments& arguments = bound.arguments;
    double* pending = bound.machine.pending();
    if (kwnames != nullptr) return n == 0 && arguments.keywords(args, kwnames, pending);
    if (n == 1) {
        if (PyDict_CheckExact(args[0])) return arguments.dict(args[0], pending);
        if (arguments.is_array(args[0])) return arguments.array(args[0], pending);
    }
    return static_cast<std::size_t>(n) == arguments.size() && arguments.positional(args, pending);
}

template <class M>
PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    if (!nb::inst_ready(self)) [[unlikely]] {
        PyErr_SetString(PyExc_TypeError, "the machine was not made: __init__ was not called");
        return nullptr;
    }
    Bound<M>& bound = *nb::inst_ptr<Bound<M>>(self);
    M& machine = bound.machine;
    try {
        if (bound.running) [[unlikely]] require_idle(bound);
        if constexpr (requires { machine.finished(); }) {
            if (machine.finished()) [[unlikely]] refuse_state("refuse_update");
        }
        if (!read_at_once(bound, args, n, kwnames)) [[unlikely]] {
            read_slowly(bound, args, n, kwnames);
        } else if (!machine.take()) [[unlikely]] {
            if (!any_nan(machine.pending(), machine.variables()))
                refuse(bound, machine.pending(), machine.samples());
            read_slowly(bound, args, n, kwnames);
        }
        return PyFloat_FromDouble(machine.result());
    } catch (nb::python_error& error) {
        error.restore();
    } catch (const std::exception& error) {
        PyErr_SetString(PyExc_RuntimeError, error.what());
    }
    return nullptr;
}

template <class M>
void reset(Bound<M>& bound) {
    require_idle(bound);
    bound.machine.reset();
}

template <class M>
nb::bytes state(const Bound<M>& bound) {
    require_idle(bound);
    const std::string bytes = bound.machine.state();
    return nb::bytes(bytes.data(), bytes.size());
}

template <class M>
void restore(Bound<M>& bound, nb::handle state) {
    require_idle(bound);
    if (!PyBytes_Check(state.ptr())) throw nb::value_error(M::kForeign);
    const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(state.ptr()));
    bound.machine.restore({PyBytes_AS_STRING(state.ptr()), size});
}

template <class M>
int traverse(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (!nb::inst_ready(self)) return 0;
    const Bound<M>& bound = *nb::inst_ptr<Bound<M>>(self);
    Py_VISIT(bound.reader.ptr());
    return bound.arguments.traverse(visit, arg);
}

template <class M>
int clear(PyObject* self) {
    // Names are text and tuples of text: no cycle goes through them.
    if (nb::inst_ready(self)) nb::inst_ptr<Bound<M>>(self)->reader = nb::none();
    return 0;
}

template <class M>
PyMethodDef methods[] = {
    {"update", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(update<M>)),
     METH_FASTCALL | METH_KEYWORDS,
     "update($self, /, *args, **named)\n--\n\n"
     "Take in one sample, by position, by name, as a mapping or as an array; the result."},
    {nullptr, nullptr, 0, nullptr},
};

template <class M>
PyType_Slot slots[] = {
    {Py_tp_methods, methods<M>},
    {Py_tp_traverse, reinterpret_cast<void*>(traverse<M>)},
    {Py_tp_clear, reinterpret_cast<void*>(clear<M>)},
    {0, nullptr},
};

// These add classes to the module.
void bind_episode(nb::module_& m);
void bind_banks(nb::module_& m);
void bind_dense(nb::module_& m);

}  // namespace rtamt
