// The dense machine as a Python class.
#include <nanobind/nanobind.h>

#include <tuple>
#include <utility>
#include <vector>

#include "python/encoding.hpp"
#include "python/events.hpp"

namespace rtamt {
namespace {

using DenseObject = EventObject<DenseMachine>;

void construct(DenseObject* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result,
               const std::tuple<double, Time, Time>& clock, const nb::sequence& declared,
               const nb::sequence& observed, nb::object reader) {
    const Clock counts = clock_of(clock);
    if (nb::len(declared) != nb::len(variables))
        throw nb::value_error("expected a declared value, or nan, for every variable");
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

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return call<DenseObject>(self, [=](DenseObject& object) {
        if (object.running) [[unlikely]] require_idle(object);
        if (object.machine.finished()) [[unlikely]] refuse(object.reader, "refuse_update");
        const Dating dating = read_events(object, args, n, kwnames);
        if (!object.machine.take()) [[unlikely]] refuse_nan(object, dating);
        object.machine.set_dating(dating);
        return new_steps(object).release().ptr();
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

}  // namespace

void bind_dense(nb::module_& m) {
    m.def("ticks", ticks_of, nb::arg("clock"), nb::arg("times"),
          "Return the nearest ticks of an array of doubles, None if Python should count them;\n"
          "rtamt.program.encoding.EncodedDense describes the clock.");
    machine_class<DenseObject>(
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
        methods)
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("clock"), nb::arg("declared"), nb::arg("observed"),
             nb::arg("reader"))
        .def_prop_ro("settled", when_idle<DenseObject>([](auto& o) { return time_of(o, o.machine.settled()); }),
                     "The time before which the result is known; when finished, the end.")
        .def_prop_ro("finished", when_idle<DenseObject>([](auto& o) { return o.machine.finished(); }),
                     "Whether the trace has ended.")
        .def_prop_ro("values",
                     when_idle<DenseObject>([](auto& o) {
                         const std::vector<double> values = o.machine.values();
                         return list_of(values.data(), values.size());
                     }),
                     "The last known value of every observed register; nan before the first.")
        .def("finish", finish, "End the trace; return the rest of the result.")
        .def("run", run, nb::arg("given"),
             "Take in a whole trace, with times as they were given; return the times and values of\n"
             "the result. The machine is of no use after that.")
        .def("retire", retire<DenseObject>, "Refuse each further update: the monitor has another machine.")
        .def("reset", reset<DenseObject>, "Return to the state before the first event.");
}

}  // namespace rtamt
