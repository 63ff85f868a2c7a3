// The machines over dense time as Python classes.
#include <nanobind/nanobind.h>

#include <tuple>
#include <utility>
#include <vector>

#include "dense/episode.hpp"
#include "python/encoding.hpp"
#include "python/events.hpp"

namespace rtamt {
namespace {

using DenseObject = EventObject<DenseMachine>;

void require_declared(const nb::sequence& declared, const nb::tuple& variables) {
    if (nb::len(declared) != nb::len(variables))
        throw nb::value_error("expected a declared value, or nan, for every variable");
}

void construct(DenseObject* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result,
               const std::tuple<double, Time, Time>& clock, const nb::sequence& declared,
               const nb::sequence& observed, nb::object reader) {
    const Clock counts = clock_of(clock);
    require_declared(declared, variables);
    Arguments names(variables);
    new (self) DenseObject{{{DenseMachine(dense_rows(rows), terms, numbers_of(declared), result,
                                          registers_of(observed)),
                             std::move(reader)},
                            std::move(names)},
                           counts};
}

nb::list new_steps(DenseObject& object) {
    nb::list list = nb::steal<nb::list>(PyList_New(0));
    object.machine.drain([&](Time tick, double value) {
        double time;
        nb::object pair;
        if (object.machine.dating() != Dating::dates && object.clock.time(tick, time)) [[likely]] {
            pair = nb::steal(pair_of(time, value));
            if (!pair.is_valid()) nb::raise_python_error();
        } else {
            pair = nb::make_tuple(time_of(object, tick), value);
        }
        if (PyList_Append(list.ptr(), pair.ptr()) != 0) nb::raise_python_error();
    });
    return list;
}

// Has a machine take in the events of an update, by take(object, dating).
template <class T, class Take>
PyObject* take_events(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames,
                      Take take) {
    return call<T>(self, [=](T& object) {
        if (object.running) [[unlikely]] require_idle(object);
        if (object.machine.finished()) [[unlikely]] refuse(object.reader, "refuse_update");
        const Dating dating = read_events(object, args, n, kwnames);
        take(object, dating);
        object.machine.set_dating(dating);
        if constexpr (requires { object.machine.result(); })
            return PyFloat_FromDouble(object.machine.result());
        else
            return new_steps(object).release().ptr();
    });
}

// Adds a class with what machines on events have to a module.
template <class T>
nb::class_<T> event_class(nb::module_& m, const char* name, const char* doc, PyMethodDef* methods,
                          const char* settled) {
    auto made = machine_class<T>(m, name, doc, methods);
    made.def_prop_ro("settled",
                     when_idle<T>([](auto& o) { return time_of(o, o.machine.settled()); }), settled)
        .def_prop_ro("finished", when_idle<T>([](auto& o) { return o.machine.finished(); }),
                     "Whether the trace has ended.")
        .def("retire", retire<T>, "Refuse each further update: the monitor has another machine.")
        .def("reset", reset<T>, "Return to the state before the first event.");
    return made;
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return take_events<DenseObject>(
        self, args, n, kwnames, [](DenseObject& object, Dating dating) {
            if (!object.machine.take()) [[unlikely]] refuse_nan(object, dating);
        });
}

void end(DenseObject& object) {
    if (!object.machine.finish()) refuse_end(object);
}

nb::list finish(DenseObject& object) {
    require_idle(object);
    if (!object.machine.finished()) end(object);
    return new_steps(object);
}

nb::object array_of_times(const DenseObject& object, const std::vector<Time>& ticks) {
    static const NewArray integers("int64");
    static const NewArray doubles("float64");
    const auto at = [&](std::size_t i) { return ticks[i]; };
    bool fine = object.machine.dating() != Dating::dates;
    nb::object times = doubles.make<double>(ticks.size(), [&](std::size_t i) {
        double time = 0.0;
        fine = fine && object.clock.time(ticks[i], time);
        return time;
    });
    if (fine) return times;
    return object.reader.attr("times")(integers.make<Time>(ticks.size(), at),
                                       dated(object.machine.dating()));
}

nb::tuple run(DenseObject& object, const nb::sequence& given) {
    require_idle(object);
    DenseMachine& machine = object.machine;
    const Trace trace(object, given);
    std::vector<Time> ticks;
    std::vector<double> values;
    const auto emit = [&](Time tick, double value) {
        ticks.push_back(tick);
        values.push_back(value);
    };
    const bool fine =
        run_long(object, trace.longest(), [&] { return machine.run(trace.events.data(), emit); });
    if (!fine) refuse_nan(object, machine.dating());
    end(object);
    machine.drain(emit);
    return nb::make_tuple(array_of_times(object, ticks), doubles(values.data(), values.size()));
}

// The ticks of an array of doubles; None if Python should count them.
nb::object ticks_of(const std::tuple<double, Time, Time>& clock, nb::handle times) {
    static const NewArray integers("int64");
    const Clock counts = clock_of(clock);
    Py_ssize_t n = 0;
    const double* given = Numpy::instance().column(times.ptr(), n);
    if (given == nullptr) return nb::none();
    std::vector<Time> ticks(static_cast<std::size_t>(n));
    if (!counts.count(given, 1, ticks.size(), ticks.data())) return nb::none();
    return integers.make<Time>(ticks.size(), [&](std::size_t i) { return ticks[i]; });
}

PyMethodDef methods[] = {
    update_method(update,
                  "update($self, /, *events, **named)\n--\n\n"
                  "Take in new events of variables; return the new steps of the result."),
    {nullptr, nullptr, 0, nullptr},
};

namespace bounds {

using Taken = DenseEpisodeMachine::Taken;
using EpisodeObject = EventObject<DenseEpisodeMachine>;

RegionProgram region_program(nb::handle encoded) {
    const auto terms = nb::cast<nb::sequence>(encoded[0]);
    const auto regions = nb::cast<nb::tuple>(encoded[1]);
    const auto part = [&](std::size_t i) { return nb::cast<nb::sequence>(regions[i]); };
    return {dense_terms(terms), region_rows(part(2)), registers_of(part(3)), registers_of(part(4)),
            registers_of(part(5))};
}

void construct(EpisodeObject* self, const nb::sequence& readings, const nb::tuple& variables,
               const std::tuple<double, Time, Time>& clock, const nb::sequence& declared,
               Time reach, nb::object reader) {
    const Clock counts = clock_of(clock);
    require_declared(declared, variables);
    std::vector<RegionProgram> programs;
    for (nb::handle reading : readings) programs.push_back(region_program(reading));
    if (programs.empty() || programs.size() > 2)
        throw nb::value_error("expected one program, or two with neutral predicates");
    Arguments names(variables);
    new (self) EpisodeObject{
        {{DenseEpisodeMachine(programs, numbers_of(declared), reach, true), std::move(reader)},
         std::move(names)},
        counts};
}

void refuse_other(const EpisodeObject& object, Taken taken, Dating dating) {
    if (taken == Taken::no_number) refuse_nan(object, dating);
    if (taken == Taken::too_long)
        refuse(object.reader, "refuse_length", object.machine.too_long());
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return take_events<EpisodeObject>(
        self, args, n, kwnames, [](EpisodeObject& object, Dating dating) {
            refuse_other(object, object.machine.take(), dating);
        });
}

void run(EpisodeObject& object, const nb::sequence& given, bool decided) {
    require_idle(object);
    DenseEpisodeMachine& machine = object.machine;
    const Trace trace(object, given);
    const Taken taken = run_long(object, trace.longest(), [&] {
        return machine.run(trace.events.data(), decided);
    });
    refuse_other(object, taken, machine.dating());
    if (machine.settled() == dense::kBefore) refuse_end(object);
}

nb::tuple complete(EpisodeObject& object) {
    require_idle(object);
    const std::vector<double> found = object.machine.complete();
    return nb::make_tuple(found.front(), found.back());
}

double finish(EpisodeObject& object, const std::string& end) {
    require_idle(object);
    const End reading = end_of(end);
    DenseEpisodeMachine& machine = object.machine;
    if (!machine.finished()) {
        if (machine.settled() == dense::kBefore) refuse_end(object);
        machine.finish(reading);
    }
    return machine.result();
}

nb::object decided_at(const EpisodeObject& object) {
    require_idle(object);
    const auto decided = object.machine.decided();
    return decided ? time_of(object, *decided) : nb::object(nb::none());
}

template <double (DenseEpisodeMachine::*number)() const>
double get(const EpisodeObject& object) {
    require_idle(object);
    return (object.machine.*number)();
}

PyMethodDef methods[] = {
    update_method(update,
                  "update($self, /, *events, **named)\n--\n\n"
                  "Take in new events of variables; return the robustness of the trace so far."),
    {nullptr, nullptr, 0, nullptr},
};

}  // namespace bounds

}  // namespace

void bind_dense(nb::module_& m) {
    m.def("ticks", ticks_of, nb::arg("clock"), nb::arg("times"),
          "Return the nearest ticks of an array of doubles, None if Python should count them;\n"
          "rtamt.program.encoding.EncodedDense describes the clock.");
    event_class<DenseObject>(
        m, "DenseMachine",
        "Runs a program over dense time, as rtamt.machines.protocols.DenseMachine says.\n\n"
        "Args:\n"
        "    rows: The program, as rtamt.program.encoding encodes it.\n"
        "    terms: The number of rows that are arithmetic over the present values.\n"
        "    variables: Names of the inputs.\n"
        "    result: Register that update returns.\n"
        "    clock: Ticks in a unit of time, as a double and as a quotient of two numbers.\n"
        "    declared: The value of each variable before its first event; nan if there is none.\n"
        "    observed: Registers that values lists.\n"
        "    reader: Reads the rare forms of events, and raises all errors.",
        methods, "The time before which the result is known; when finished, the end.")
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("clock"), nb::arg("declared"), nb::arg("observed"),
             nb::arg("reader"))
        .def_prop_ro("values",
                     when_idle<DenseObject>([](auto& o) {
                         const std::vector<double> values = o.machine.values();
                         return list_of(values.data(), values.size());
                     }),
                     "The last known value of every observed register; nan before the first.")
        .def("finish", finish, "End the trace; return the rest of the result.")
        .def("run", run, nb::arg("given"),
             "Take in a whole trace, with times as they were given; return the times and values of\n"
             "the result. The machine is of no use after that.");
}

void bind_dense_episode(nb::module_& m) {
    using Machine = DenseEpisodeMachine;
    using Self = bounds::EpisodeObject;
    event_class<Self>(
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
        bounds::methods, "The last time at which all variables are known.")
        .def("__init__", bounds::construct, nb::arg("readings"), nb::arg("variables"), nb::arg("clock"),
             nb::arg("declared"), nb::arg("reach"), nb::arg("reader"))
        .def_prop_ro("robustness", bounds::get<&Machine::result>,
                     "The robustness if the trace ended now; nan before it begins.")
        .def_prop_ro("lower", bounds::get<&Machine::lower>,
                     "The least robustness over all continuations and ends.")
        .def_prop_ro("upper", bounds::get<&Machine::upper>,
                     "The greatest robustness over all continuations and ends.")
        .def_prop_ro("span",
                     when_idle<Self>([](auto& o) {
                         return nb::make_tuple(o.machine.begin(), o.machine.settled());
                     }),
                     "The first and the last tick of the trace, which has begun.")
        .def_prop_ro("decided_at", bounds::decided_at,
                     "The first time such that the trace up to it decides the verdict, or None.")
        .def("finish", bounds::finish, nb::arg("end") = "complete",
             "End the trace, make the bounds those of this reading; return its robustness.")
        .def("run", bounds::run, nb::arg("given"), nb::kw_only(), nb::arg("decided") = false,
             "Take in a whole trace, with times as they were given.")
        .def("complete", bounds::complete,
             "Return the robustness if the trace is all there is, with neutral predicates -0.0\n"
             "and 0.0.");
}

}  // namespace rtamt
