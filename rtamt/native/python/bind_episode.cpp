// The episode machine as a Python class.
#include <nanobind/nanobind.h>

#include <optional>
#include <utility>
#include <vector>

#include "episode/machine.hpp"
#include "python/bound.hpp"
#include "python/encoded.hpp"

namespace rtamt {
namespace {

using BoundEpisode = Bound<EpisodeMachine>;

void construct(BoundEpisode* self, const nb::sequence& terms,
               const nb::sequence& formulas, const nb::sequence& tops,
               const nb::sequence& streams, const nb::tuple& variables, nb::object reader) {
    new (self) BoundEpisode{
        EpisodeMachine(rows_of(terms), nb::len(variables), formulas_of(formulas),
                       registers_of(tops), registers_of(streams)),
        Arguments(variables), std::move(reader)};
}

double finish(BoundEpisode& bound) {
    if (bound.machine.samples() == 0) refuse_state("refuse_finish");
    bound.machine.finish();
    return bound.machine.result();
}

// What is read after every update: plain getters and methods cost half of nanobind's.
const EpisodeMachine* machine_of(PyObject* self) {
    if (nb::inst_ready(self)) [[likely]] return &nb::inst_ptr<BoundEpisode>(self)->machine;
    PyErr_SetString(PyExc_TypeError, "the machine was not made: __init__ was not called");
    return nullptr;
}

template <double (EpisodeMachine::*value)() const>
PyObject* get(PyObject* self, void*) {
    const EpisodeMachine* machine = machine_of(self);
    return machine ? PyFloat_FromDouble((machine->*value)()) : nullptr;
}

PyObject* bounds(PyObject* self, PyObject*) {
    const EpisodeMachine* machine = machine_of(self);
    if (!machine) return nullptr;
    PyObject* both = PyTuple_New(2);
    PyObject* lower = PyFloat_FromDouble(machine->lower());
    PyObject* upper = PyFloat_FromDouble(machine->upper());
    if (both && lower && upper) [[likely]] {
        PyTuple_SET_ITEM(both, 0, lower);
        PyTuple_SET_ITEM(both, 1, upper);
        return both;
    }
    Py_XDECREF(both);
    Py_XDECREF(lower);
    Py_XDECREF(upper);
    return nullptr;
}

PyMethodDef episode_methods[] = {
    methods<EpisodeMachine>[0],
    {"bounds", bounds, METH_NOARGS, "bounds($self, /)\n--\n\nThe lower and the upper bound."},
    {nullptr, nullptr, 0, nullptr},
};

PyGetSetDef values[] = {
    {"robustness", get<&EpisodeMachine::result>, nullptr, "Robustness if the episode ended now.",
     nullptr},
    {"lower", get<&EpisodeMachine::lower>, nullptr, "The least over all continuations.", nullptr},
    {"upper", get<&EpisodeMachine::upper>, nullptr, "The greatest over all continuations.",
     nullptr},
    {nullptr, nullptr, nullptr, nullptr, nullptr},
};

PyType_Slot episode_slots[] = {
    {Py_tp_getset, values},
    {Py_tp_methods, episode_methods},
    {Py_tp_traverse, reinterpret_cast<void*>(traverse<EpisodeMachine>)},
    {Py_tp_clear, reinterpret_cast<void*>(clear<EpisodeMachine>)},
    {0, nullptr},
};

}  // namespace

void bind_episode(nb::module_& m) {
    nb::class_<BoundEpisode>(
        m, "EpisodeMachine", nb::type_slots(episode_slots),
        "Bounds the robustness of an episode, as rtamt.machines.protocols.EpisodeMachine says.\n\n"
        "Args:\n"
        "    terms: The first instructions, as rtamt.program.schedule.encoded writes them.\n"
        "    formulas: The others, as rtamt.program.placement writes them.\n"
        "    tops: Registers that are read at time 0 alone, the result last.\n"
        "    streams: Registers that are read at all times.\n"
        "    variables: Names of the inputs.\n"
        "    reader: Reads the arguments that are rare, and makes all messages.")
        .def("__init__", construct, nb::arg("terms"), nb::arg("formulas"), nb::arg("tops"),
             nb::arg("streams"), nb::arg("variables"), nb::arg("reader"))
        .def_prop_ro("samples", [](const BoundEpisode& b) { return b.machine.samples(); },
                     "Samples taken in since the reset.")
        .def_prop_ro("inputs", inputs<EpisodeMachine>, "The last sample, empty before the first.")
        .def_prop_ro("finished", [](const BoundEpisode& b) { return b.machine.finished(); },
                     "Whether the trace has ended.")
        .def("finish", finish, "End the trace.")
        .def("reset", reset<EpisodeMachine>, "Forget every sample.")
        .def("state", state<EpisodeMachine>,
             "Values one behind the other, with a mark of the program.")
        .def("restore", restore<EpisodeMachine>, nb::arg("state").none(),
             "Continue from where the state was taken.\n\n"
             "Raises:\n"
             "    ValueError: If another program's machine gave it (then nothing changes), or it\n"
             "        is damaged (then the machine is reset).");
}

}  // namespace rtamt
