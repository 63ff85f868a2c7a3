// What the Python classes of all machines share: references, snapshots, errors, threads.
#pragma once

#include <nanobind/nanobind.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "core/snapshot.hpp"
#include "python/arrays.hpp"

namespace rtamt {

namespace nb = nanobind;
using namespace nb::literals;

// Reads the frequent forms of the arguments of update(*args, **named): values of exact types, whose
// conversion runs no code of a caller. The functions return false on other forms, which are left to
// the reader, rtamt.inputs.samples.SampleReader, as are all errors.
class Arguments {
public:
    // Throws an error of Python if a name is no text. Made before the object that holds it: GCC
    // frees the other members of an aggregate twice if the last one throws.
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

// What a Python object holds. The reader is a Python object that reads the rare forms of arguments
// and raises the errors of all calls.
template <class M>
struct Object {
    M machine;
    nb::object reader;
    bool running = false;  // in another thread, without the lock of the interpreter; or stale
    bool stale = false;    // its monitor has another machine
};

// The object of a machine whose update takes arguments by name.
template <class M>
struct NamedObject : Object<M> {
    Arguments arguments;
};

// Has the reader, or a module, raise the error of a call.
template <class... Args>
[[noreturn]] void refuse(const nb::object& reader, const char* call, Args&&... args) {
    reader.attr(call)(std::forward<Args>(args)...);
    throw std::runtime_error("Python did not refuse the call");
}

template <class M>
void require_idle(const Object<M>& object) {
    if (object.stale) [[unlikely]]
        refuse(nb::module_::import_("rtamt.machines.state"), "refuse_stale");
    if (object.running) [[unlikely]]
        refuse(nb::module_::import_("rtamt.machines.native"), "refuse_running");
}

// Reads an attribute of a machine that no other thread is running.
template <class T, class Read>
auto when_idle(Read read) {
    return [read](const T& object) {
        require_idle(object);
        return read(object);
    };
}

// The arguments of an update as Python's (*args, **named).
inline std::pair<nb::tuple, nb::dict> packed(PyObject* const* args, Py_ssize_t n,
                                             PyObject* kwnames) {
    nb::list positional;
    for (Py_ssize_t i = 0; i < n; ++i) positional.append(nb::handle(args[i]));
    nb::dict named;
    const Py_ssize_t names = kwnames == nullptr ? 0 : PyTuple_GET_SIZE(kwnames);
    for (Py_ssize_t i = 0; i < names; ++i)
        named[nb::handle(PyTuple_GET_ITEM(kwnames, i))] = nb::handle(args[n + i]);
    return {nb::tuple(positional), named};
}

// Sets a flag while it exists.
struct WhileSet {
    explicit WhileSet(bool& flag) : flag(flag) { flag = true; }
    ~WhileSet() { flag = false; }
    bool& flag;
};

// Runs a call over n elements, and lets other threads run meanwhile if n is large.
template <class M, class Run>
auto run_long(Object<M>& object, std::size_t n, Run run) {
    if (n < kWorthAThread) return run();
    const WhileSet running(object.running);
    const nb::gil_scoped_release others;
    return run();
}

// Calls a function with the object of a method that is written against Python's own interface, and
// raises its exceptions in Python. Such methods cost half of nanobind's. Inlined always: one more
// call with these arguments would take a seventh of an update.
template <class T, class Call>
[[gnu::always_inline]] inline PyObject* call(PyObject* self, Call function) {
    if (!nb::inst_ready(self)) [[unlikely]] {
        PyErr_SetString(PyExc_TypeError, "the machine was not made: __init__ was not called");
        return nullptr;
    }
    try {
        return function(*nb::inst_ptr<T>(self));
    } catch (nb::python_error& error) {
        error.restore();
    } catch (const std::exception& error) {
        PyErr_SetString(PyExc_RuntimeError, error.what());
    }
    return nullptr;
}

// A new tuple of two numbers, or null with an error.
inline PyObject* pair_of(double a, double b) {
    PyObject* pair = PyTuple_New(2);
    PyObject* first = PyFloat_FromDouble(a);
    PyObject* second = PyFloat_FromDouble(b);
    if (pair && first && second) [[likely]] {
        PyTuple_SET_ITEM(pair, 0, first);
        PyTuple_SET_ITEM(pair, 1, second);
        return pair;
    }
    Py_XDECREF(pair);
    Py_XDECREF(first);
    Py_XDECREF(second);
    return nullptr;
}

template <class T>
int traverse(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (!nb::inst_ready(self)) return 0;
    const T& object = *nb::inst_ptr<T>(self);
    Py_VISIT(object.reader.ptr());
    if constexpr (requires { object.arguments; }) return object.arguments.traverse(visit, arg);
    return 0;
}

template <class T>
int clear(PyObject* self) {
    // Names are text and tuples of text: no cycle goes through them.
    if (nb::inst_ready(self)) nb::inst_ptr<T>(self)->reader = nb::none();
    return 0;
}

template <class T>
nb::bytes state(T& object) {
    require_idle(object);
    const std::string bytes = state_of(object.machine);
    return nb::bytes(bytes.data(), bytes.size());
}

// A new reference to the result of an update; null with an error.
template <class T>
PyObject* result_of(T& object) {
    if constexpr (requires { object.readout; }) {
        return object.readout.show(object.machine);
    } else {
        return PyFloat_FromDouble(object.machine.result());
    }
}

// Shows what a call other than an update has changed.
template <class T>
void refresh(T& object) {
    if constexpr (requires { object.readout; })
        if (!nb::steal(result_of(object)).is_valid()) nb::raise_python_error();
}

template <class T>
void restore(T& object, nb::handle state) {
    require_idle(object);
    if (!PyBytes_Check(state.ptr())) throw nb::value_error(kForeign);
    const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(state.ptr()));
    try {
        restore_from(object.machine, {PyBytes_AS_STRING(state.ptr()), size});
    } catch (const std::invalid_argument&) {
        refresh(object);
        throw;
    }
    refresh(object);
}

template <class T>
void reset(T& object) {
    require_idle(object);
    object.machine.reset();
    refresh(object);
}

// Refuses each further call that changes the machine.
template <class T>
void retire(T& object) {
    require_idle(object);
    object.running = object.stale = true;
}

// Adds a class with what all machines have to a module.
template <class T>
nb::class_<T> machine_class(nb::module_& m, const char* name, const char* doc,
                            PyMethodDef* methods = nullptr) {
    std::vector<PyType_Slot> slots{
        {Py_tp_traverse, reinterpret_cast<void*>(traverse<T>)},
        {Py_tp_clear, reinterpret_cast<void*>(clear<T>)},
    };
    if (methods != nullptr) slots.push_back({Py_tp_methods, methods});
    slots.push_back({0, nullptr});
    nb::class_<T> made(m, name, nb::type_slots(slots.data()), doc);
    made.def("state", state<T>).def("restore", restore<T>, nb::arg("state").none());
    return made;
}

using Update = PyObject*(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames);

inline PyMethodDef update_method(Update* update, const char* doc) {
    return {"update", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(update)),
            METH_FASTCALL | METH_KEYWORDS, doc};
}

// These add classes to the module.
void bind_discrete(nb::module_& m);
void bind_episode(nb::module_& m);
void bind_dense(nb::module_& m);
void bind_batches(nb::module_& m);
void bind_verdict_logs(nb::module_& m);
void bind_columns(nb::module_& m);

}  // namespace rtamt
