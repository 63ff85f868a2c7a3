// The episode machine as a Python class.
#include <nanobind/nanobind.h>

#include <utility>

#include "python/encoding.hpp"
#include "python/samples.hpp"

namespace rtamt {
namespace {

using EpisodeObject = NamedObject<EpisodeMachine>;

void construct(EpisodeObject* self, const nb::sequence& terms, const nb::sequence& formulas,
               const nb::sequence& initial, const nb::sequence& streams,
               const nb::tuple& variables, nb::object reader) {
    new (self) EpisodeObject{
        {EpisodeMachine(discrete_rows(terms), nb::len(variables), formula_rows(formulas),
                        registers_of(initial), registers_of(streams)),
         std::move(reader)},
        Arguments(variables)};
}

double finish(EpisodeObject& object) {
    if (object.machine.samples() == 0) refuse_state("refuse_finish");
    object.machine.finish();
    return object.machine.result();
}

// Callers read these after every update, so they are written against Python's own interface.
template <double (EpisodeMachine::*value)() const>
PyObject* get(PyObject* self, void*) {
    return call<EpisodeObject>(self, [](const EpisodeObject& object) {
        return PyFloat_FromDouble((object.machine.*value)());
    });
}

PyObject* bounds(PyObject* self, PyObject*) {
    return call<EpisodeObject>(self, [](const EpisodeObject& object) {
        return pair_of(object.machine.lower(), object.machine.upper());
    });
}

PyMethodDef methods[] = {
    sample_update<EpisodeMachine>(),
    {"bounds", bounds, METH_NOARGS,
     "bounds($self, /)\n--\n\nReturn the lower and the upper bound."},
    {nullptr, nullptr, 0, nullptr},
};

PyGetSetDef values[] = {
    {"robustness", get<&EpisodeMachine::result>, nullptr,
     "The robustness if the episode ended now.", nullptr},
    {"lower", get<&EpisodeMachine::lower>, nullptr,
     "The least robustness over all continuations.", nullptr},
    {"upper", get<&EpisodeMachine::upper>, nullptr,
     "The greatest robustness over all continuations.", nullptr},
    {nullptr, nullptr, nullptr, nullptr, nullptr},
};

}  // namespace

void bind_episode(nb::module_& m) {
    sample_class<EpisodeMachine>(
        m, "EpisodeMachine",
        "Bounds the robustness of an episode, as rtamt.machines.protocols.EpisodeMachine says.\n\n"
        "Args:\n"
        "    terms: The first rows of the program, as rtamt.program.encoding encodes them.\n"
        "    formulas: The other rows.\n"
        "    initial: Registers that are read at time 0 alone, the result last.\n"
        "    streams: Registers that are read at all times.\n"
        "    variables: Names of the inputs.\n"
        "    reader: Reads the rare forms of arguments, and raises all errors.",
        methods, values)
        .def("__init__", construct, nb::arg("terms"), nb::arg("formulas"), nb::arg("initial"),
             nb::arg("streams"), nb::arg("variables"), nb::arg("reader"))
        .def_prop_ro("finished", [](const EpisodeObject& o) { return o.machine.finished(); },
                     "Whether the episode has ended.")
        .def("finish", finish, "End the episode; return its robustness.");
}

}  // namespace rtamt
