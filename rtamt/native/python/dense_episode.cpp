// The machine that bounds the robustness of a trace in dense time as a Python class.
#include <nanobind/nanobind.h>

#include <tuple>
#include <utility>
#include <vector>

#include "dense/episode.hpp"
#include "python/encoding.hpp"
#include "python/events.hpp"

namespace rtamt {
namespace {

using Taken = DenseEpisodeMachine::Taken;
using DenseEpisodeObject = EventObject<DenseEpisodeMachine>;

RegionProgram region_program(nb::handle encoded) {
    const auto terms = nb::cast<nb::sequence>(encoded[0]);
    const auto regions = nb::cast<nb::tuple>(encoded[1]);
    const auto part = [&](std::size_t i) { return nb::cast<nb::sequence>(regions[i]); };
    return {dense_terms(terms), region_rows(part(2)), registers_of(part(3)), registers_of(part(4)),
            registers_of(part(5))};
}

void construct(DenseEpisodeObject* self, const nb::sequence& readings, const nb::tuple& variables,
               const std::tuple<double, Time, Time>& clock, const nb::sequence& declared,
               Time reach, nb::object reader) {
    const Clock counts = clock_of(clock);
    if (nb::len(declared) != nb::len(variables))
        throw nb::value_error("expected a declared value, or nan, for every variable");
    std::vector<RegionProgram> programs;
    for (nb::handle reading : readings) programs.push_back(region_program(reading));
    if (programs.empty() || programs.size() > 2)
        throw nb::value_error("expected one program, or two with neutral predicates");
    Arguments names(variables);
    new (self) DenseEpisodeObject{
        {{DenseEpisodeMachine(programs, numbers_of(declared), reach, true), std::move(reader)},
         std::move(names)},
        counts};
}

void refuse_other(const DenseEpisodeObject& object, Taken taken, Dating dating) {
    if (taken == Taken::no_number) refuse_nan(object, dating);
    if (taken == Taken::too_long)
        refuse(object.reader, "refuse_length", object.machine.too_long());
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return call<DenseEpisodeObject>(self, [=](DenseEpisodeObject& object) {
        if (object.running) [[unlikely]] require_idle(object);
        if (object.machine.finished()) [[unlikely]] refuse(object.reader, "refuse_update");
        const Dating dating = read_events(object, args, n, kwnames);
        refuse_other(object, object.machine.take(), dating);
        object.machine.set_dating(dating);
        return PyFloat_FromDouble(object.machine.result());
    });
}

void run(DenseEpisodeObject& object, const nb::sequence& given, bool decided) {
    require_idle(object);
    DenseEpisodeMachine& machine = object.machine;
    const Trace trace(object, given);
    const Taken taken = run_long(object, trace.longest(), [&] {
        return machine.run(trace.events.data(), decided);
    });
    refuse_other(object, taken, machine.dating());
    if (machine.settled() == dense::kBefore) refuse_end(object);
}

nb::tuple complete(DenseEpisodeObject& object) {
    require_idle(object);
    const std::vector<double> found = object.machine.complete();
    return nb::make_tuple(found.front(), found.back());
}

double finish(DenseEpisodeObject& object, const std::string& end) {
    require_idle(object);
    const End reading = end_of(end);
    DenseEpisodeMachine& machine = object.machine;
    if (!machine.finished()) {
        if (machine.settled() == dense::kBefore) refuse_end(object);
        machine.finish(reading);
    }
    return machine.result();
}

nb::object decided_at(const DenseEpisodeObject& object) {
    require_idle(object);
    const auto decided = object.machine.decided();
    return decided ? time_of(object, *decided) : nb::object(nb::none());
}

template <double (DenseEpisodeMachine::*number)() const>
double get(const DenseEpisodeObject& object) {
    require_idle(object);
    return (object.machine.*number)();
}

PyMethodDef methods[] = {
    update_method(update,
                  "update($self, /, *events, **named)\n--\n\n"
                  "Take in new events of variables; return the robustness of the trace so far."),
    {nullptr, nullptr, 0, nullptr},
};

}  // namespace

void bind_dense_episode(nb::module_& m) {
    using Machine = DenseEpisodeMachine;
    using Self = DenseEpisodeObject;
    machine_class<Self>(
        m, "DenseEpisodeMachine",
        "Bounds the robustness of a trace in dense time, as\n"
        "rtamt.machines.protocols.DenseEpisodeMachine says.\n\n"
        "Args:\n"
        "    readings: A program, or with neutral predicates two; each a pair of its terms and of\n"
        "        its regions, as rtamt.program.encoding encodes them.\n"
        "    variables: Names of the inputs.\n"
        "    clock: Ticks in a unit of time, as a double and as a quotient of two numbers.\n"
        "    declared: The value of each variable before its first event; nan if there is none.\n"
        "    reach: By how many ticks formulas look away.\n"
        "    reader: Reads the rare forms of events, and raises all errors.",
        methods)
        .def("__init__", construct, nb::arg("readings"), nb::arg("variables"), nb::arg("clock"),
             nb::arg("declared"), nb::arg("reach"), nb::arg("reader"))
        .def_prop_ro("robustness", get<&Machine::result>,
                     "The robustness if the trace ended now; nan before it begins.")
        .def_prop_ro("lower", get<&Machine::lower>,
                     "The least robustness over all continuations and ends.")
        .def_prop_ro("upper", get<&Machine::upper>,
                     "The greatest robustness over all continuations and ends.")
        .def_prop_ro("settled", when_idle<Self>([](auto& o) { return time_of(o, o.machine.settled()); }),
                     "The last time at which all variables are known.")
        .def_prop_ro("span",
                     when_idle<Self>([](auto& o) {
                         return nb::make_tuple(o.machine.begin(), o.machine.settled());
                     }),
                     "The first and the last tick of the trace, which has begun.")
        .def_prop_ro("decided_at", decided_at,
                     "The first time such that the trace up to it decides the verdict, or None.")
        .def_prop_ro("finished", when_idle<Self>([](auto& o) { return o.machine.finished(); }),
                     "Whether the trace has ended.")
        .def("finish", finish, nb::arg("end") = "complete",
             "End the trace, make the bounds those of this reading; return its robustness.")
        .def("run", run, nb::arg("given"), nb::kw_only(), nb::arg("decided") = false,
             "Take in a whole trace, with times as they were given.")
        .def("complete", complete,
             "Return the robustness if the trace is all there is, with neutral predicates -0.0\n"
             "and 0.0.")
        .def("retire", retire<Self>, "Refuse each further update: the monitor has another machine.")
        .def("reset", reset<Self>, "Return to the state before the first event.");
}

}  // namespace rtamt
