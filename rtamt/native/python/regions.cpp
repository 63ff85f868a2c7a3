// The registers over the regions of dense time, and signs there, as Python classes.
#include <nanobind/nanobind.h>

#include <tuple>
#include <utility>
#include <vector>

#include "dense/signs.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/events.hpp"

namespace rtamt {
namespace {

using dense::Regions;

struct RegionsObject : Object<Regions> {};

void construct(RegionsObject* self, std::size_t terms, const nb::sequence& constants,
               const nb::sequence& rows, const nb::sequence& initial, const nb::sequence& streams,
               const nb::sequence& unknowns) {
    new (self) RegionsObject{{Regions(terms, region_constants(constants), region_rows(rows),
                                      registers_of(initial), registers_of(streams),
                                      registers_of(unknowns)),
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
    Signs made(dense_terms(terms), nb::len(given), region_rows(rows), result, end_of(end), numbers);
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
    const dense::RunsView runs = signs.result(world).view();
    return nb::make_tuple(
        times.make<Time>(runs.size(), [&](std::size_t i) { return runs.start(i); }),
        numbers.make<double>(runs.size(), [&](std::size_t i) { return runs.at(i)->q; }));
}

}  // namespace

void bind_regions(nb::module_& m) {
    machine_class<RegionsObject>(
        m, "DenseRegions",
        "The registers of a program over the regions of dense time, as\n"
        "rtamt.machines.dense.episode.Regions.\n\n"
        "Args:\n"
        "    terms: The number of registers that are terms.\n"
        "    constants: Registers that are constants, and their values.\n"
        "    rows: The formulas, as rtamt.program.encoding encodes them.\n"
        "    initial: Registers that are read at position 0 alone; the last is the result.\n"
        "    streams: Registers that are read at all positions.\n"
        "    unknowns: Those of them that never settle.")
        .def("__init__", construct, nb::arg("terms"), nb::arg("constants"), nb::arg("rows"),
             nb::arg("initial"), nb::arg("streams"), nb::arg("unknowns"))
        .def_prop_ro("t", [](const RegionsObject& o) { return o.machine.last(); },
                     "The last position that was seen; -1 before there is one.")
        .def("advance", advance, nb::arg("positions"), nb::arg("terms"), nb::arg("t"),
             "Take in positions and columns of the terms there; all positions up to t have been "
             "seen.")
        .def("look", look, nb::arg("worlds"), "Return the robustness in the first worlds.")
        .def("reset", reset<RegionsObject>, "Return to the state before the first position.");
}

void bind_signs(nb::module_& m) {
    nb::class_<Signs>(m, "DenseSigns",
                      "Where a formula fails or holds for certain on a whole trace, as\n"
                      "rtamt.machines.dense.episode.PythonDenseSigns.\n\n"
                      "Args:\n"
                      "    terms: The terms of a program, as rtamt.program.encoding encodes them.\n"
                      "    rows: The formulas behind them over regions, encoded too.\n"
                      "    result: Its register.\n"
                      "    clock: Ticks in a unit of time, as a double and as a quotient.\n"
                      "    reader: Counts the rare forms of times.\n"
                      "    given: The times and values of every variable.\n"
                      "    begin: The first tick of the trace.\n"
                      "    last: Its last one.\n"
                      "    end: The reading of the end.\n"
                      "    numbers: Whether to compute numbers instead of signs.")
        .def("__init__", construct_signs, nb::arg("terms"), nb::arg("rows"), nb::arg("result"),
             nb::arg("clock"), nb::arg("reader"), nb::arg("given"), nb::arg("begin"),
             nb::arg("last"), nb::arg("end"), nb::arg("numbers") = false)
        .def("fails_at", fails_at, nb::arg("instants"),
             "Return the ticks, the occasions and the first position at which it fails.")
        .def("holds_at", holds_at, nb::arg("instants"),
             "Return whether it holds at all of some positions.")
        .def("result", result_in, nb::arg("world"),
             "Return the starts of the runs of the result in a world, and its values: numbers, or\n"
             "signs as infinite numbers. The last run lasts for ever.");
}

}  // namespace rtamt
