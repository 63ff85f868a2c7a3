// The machines over dense time, their registers over regions, and signs, as Python classes.
#include <nanobind/nanobind.h>

#include <tuple>
#include <utility>
#include <vector>

#include "dense/episode.hpp"
#include "dense/signs.hpp"
#include "python/arrays.hpp"
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
        if (object.running) [[unlikely]]
            require_idle(object);
        if (object.machine.finished()) [[unlikely]]
            refuse(object.reader, "refuse_update");
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
nb::class_<T> event_class(nb::module_& m, const char* name, const char* doc, PyMethodDef* methods) {
    auto made = machine_class<T>(m, name, doc, methods);
    made.def_prop_ro("settled",
                     when_idle<T>([](auto& o) { return time_of(o, o.machine.settled()); }))
        .def_prop_ro("finished", when_idle<T>([](auto& o) { return o.machine.finished(); }))
        .def("retire", retire<T>)
        .def("reset", reset<T>);
    return made;
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return take_events<DenseObject>(self, args, n, kwnames, [](DenseObject& object, Dating dating) {
        if (!object.machine.take()) [[unlikely]]
            refuse_nan(object, dating);
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
    return {dense_terms(terms), formula_rows(part(2)), registers_of(part(3)), registers_of(part(4)),
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
    if (taken == Taken::too_long) refuse(object.reader, "refuse_length", object.machine.too_long());
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return take_events<EpisodeObject>(self, args, n, kwnames,
                                      [](EpisodeObject& object, Dating dating) {
                                          refuse_other(object, object.machine.take(), dating);
                                      });
}

void run(EpisodeObject& object, const nb::sequence& given, bool decided) {
    require_idle(object);
    DenseEpisodeMachine& machine = object.machine;
    const Trace trace(object, given);
    const Taken taken = run_long(object, trace.longest(),
                                 [&] { return machine.run(trace.events.data(), decided); });
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

using dense::Regions;

struct RegionsObject : Object<Regions> {};

void construct_regions(RegionsObject* self, std::size_t terms, const nb::sequence& constants,
                       const nb::sequence& rows, const nb::sequence& initial,
                       const nb::sequence& streams, const nb::sequence& unknowns) {
    new (self) RegionsObject{
        {Regions(terms, region_constants(constants), formula_rows(rows), registers_of(initial),
                 registers_of(streams), registers_of(unknowns)),
         nb::none()}};
}

void advance(RegionsObject& object, const nb::object& positions, const nb::sequence& terms,
             dense::Time t) {
    const std::size_t n = nb::len(positions);
    const ArrayView view(positions, n, PyBUF_ND);
    const auto* places = view.data<dense::Time>();
    std::vector<ArrayView> columns;
    std::vector<const double*> sources;
    for (nb::handle column : terms) {
        columns.emplace_back(nb::borrow(column), n, PyBUF_ND);
        sources.push_back(columns.back().data<double>());
    }
    if (columns.size() != object.machine.terms())
        throw nb::value_error("expected a column for every term");
    const dense::Time last = object.machine.last();
    bool rises = true;
    for (std::size_t i = 0; i < n; ++i) rises &= places[i] > (i == 0 ? last : places[i - 1]);
    if (!rises || (n > 0 && places[n - 1] > t))
        throw nb::value_error("expected new positions that increase");
    if (t <= last || t % 2 != 0 || (last < 0 && (n == 0 || places[0] != 0)))
        throw nb::value_error("expected a later instant, and the terms at the first");
    object.machine.advance(places, sources.data(), n, t);
}

nb::tuple look(RegionsObject& object, std::size_t worlds) {
    if (worlds == 0 || worlds > Regions::worlds) throw nb::value_error("expected 1 to 5 worlds");
    const Regions::Values values = object.machine.look(worlds);
    nb::list list;
    for (std::size_t world = 0; world < worlds; ++world) list.append(values[world]);
    return nb::tuple(list);
}

using dense::Signs;

void construct_signs(Signs* self, const nb::sequence& terms, const nb::sequence& rows,
                     std::size_t result, const std::tuple<double, Time, Time>& clock,
                     const nb::object& reader, const nb::sequence& given, Time begin, Time last,
                     const std::string& end, bool numbers) {
    if (begin > last || !dense::counts(begin) || !dense::counts(last))
        throw nb::value_error("expected a trace");
    Signs made(dense_terms(terms), nb::len(given), formula_rows(rows), result, end_of(end),
               numbers);
    CountedEvents events;
    if (!events.count(given, clock_of(clock))) {
        nb::list before;
        for (std::size_t v = 0; v < nb::len(given); ++v) before.append(-kInfinity);
        events.take(nb::object(reader.attr("counted")(given, before, nb::none())[0]));
    }
    bool fine;
    {
        const nb::gil_scoped_release others;
        fine = made.read(events.events.data(), begin, last);
    }
    if (!fine) throw nb::value_error("a term is no number");
    new (self) Signs(std::move(made));
}

Signs::Spans spans_of(const nb::sequence& given) {
    Signs::Spans spans;
    for (nb::handle each : given) {
        const nb::object last = each[1];  // a whole number, or inf
        const bool endless = PyFloat_Check(last.ptr());
        spans.emplace_back(nb::cast<Time>(each[0]), endless ? dense::kAfter : nb::cast<Time>(last));
    }
    return spans;
}

nb::tuple fails_at(Signs& signs, const nb::sequence& instants) {
    const Signs::Count count = signs.fails_at(spans_of(instants));
    nb::object first = nb::none();
    if (count.first >= 0) first = nb::int_(count.first);
    return nb::make_tuple(count.ticks, count.occasions, first);
}

bool holds_at(Signs& signs, const nb::sequence& instants) {
    return signs.holds_at(spans_of(instants));
}

nb::tuple result_in(Signs& signs, std::size_t world) {
    static const NewArray times("int64"), numbers("float64");
    if (world >= Regions::worlds) throw nb::value_error("expected a world, 0 to 4");
    const dense::RunsView runs = signs.result(world);
    return nb::make_tuple(
        times.make<Time>(runs.size(), [&](std::size_t i) { return runs.start(i); }),
        numbers.make<double>(runs.size(), [&](std::size_t i) { return runs.at(i)->q; }));
}

}  // namespace

void bind_dense(nb::module_& m) {
    m.def("ticks", ticks_of, "clock"_a, "times"_a,
          "Return the nearest ticks of an array of doubles, None if Python should count them;\n"
          "rtamt.program.encoding.EncodedDense describes the clock.");
    event_class<DenseObject>(
        m, "DenseMachine",
        "Runs a program over dense time, as rtamt.machines.protocols.DenseMachine says.", methods)
        .def("__init__", construct, "rows"_a, "terms"_a, "variables"_a, "result"_a, "clock"_a,
             "declared"_a, "observed"_a, "reader"_a)
        .def_prop_ro("values", when_idle<DenseObject>([](auto& o) {
                         const std::vector<double> values = o.machine.values();
                         return list_of(values.data(), values.size());
                     }))
        .def("finish", finish)
        .def("run", run, "given"_a);
    using Machine = DenseEpisodeMachine;
    using Self = bounds::EpisodeObject;
    event_class<Self>(m, "DenseEpisodeMachine",
                      "Bounds the robustness of a trace in dense time, as\n"
                      "rtamt.machines.protocols.DenseEpisodeMachine says.",
                      bounds::methods)
        .def("__init__", bounds::construct, "readings"_a, "variables"_a, "clock"_a, "declared"_a,
             "reach"_a, "reader"_a)
        .def_prop_ro("robustness", bounds::get<&Machine::result>)
        .def_prop_ro("lower", bounds::get<&Machine::lower>)
        .def_prop_ro("upper", bounds::get<&Machine::upper>)
        .def_prop_ro("span", when_idle<Self>([](auto& o) {
                         return nb::make_tuple(o.machine.begin(), o.machine.settled());
                     }))
        .def_prop_ro("decided_at", bounds::decided_at)
        .def("finish", bounds::finish, "end"_a = "complete")
        .def("run", bounds::run, "given"_a, nb::kw_only(), "decided"_a = false)
        .def("complete", bounds::complete);
    machine_class<RegionsObject>(m, "DenseRegions",
                                 "The registers of a program over the regions of dense time, as\n"
                                 "rtamt.machines.dense.episode.Regions.")
        .def("__init__", construct_regions, "terms"_a, "constants"_a, "rows"_a, "initial"_a,
             "streams"_a, "unknowns"_a)
        .def_prop_ro("t", [](const RegionsObject& o) { return o.machine.last(); })
        .def("advance", advance, "positions"_a, "terms"_a, "t"_a)
        .def("look", look, "worlds"_a)
        .def("reset", reset<RegionsObject>);
    nb::class_<Signs>(m, "DenseSigns",
                      "Where a formula fails or holds for certain on a whole trace, as\n"
                      "rtamt.machines.dense.episode.PythonDenseSigns.")
        .def("__init__", construct_signs, "terms"_a, "rows"_a, "result"_a, "clock"_a, "reader"_a,
             "given"_a, "begin"_a, "last"_a, "end"_a, "numbers"_a = false)
        .def("fails_at", fails_at, "instants"_a)
        .def("holds_at", holds_at, "instants"_a)
        .def("result", result_in, "world"_a);
}

}  // namespace rtamt
