// Where a formula fails or holds for certain in dense time, as a Python class.
#include <nanobind/nanobind.h>

#include <tuple>
#include <vector>

#include "dense/signs.hpp"
#include "python/encoding.hpp"
#include "python/events.hpp"

namespace rtamt {
namespace {

using dense::Signs;

void construct(Signs* self, const nb::sequence& terms, const nb::sequence& rows,
               std::size_t result, const std::tuple<double, Time, Time>& clock,
               const nb::object& reader, const nb::sequence& given, Time begin, Time last,
               const std::string& end) {
    if (begin > last || !dense::counts(begin) || !dense::counts(last))
        throw nb::value_error("expected a trace");
    Signs made(dense_terms(terms), nb::len(given), region_rows(rows), result, end_of(end));
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

}  // namespace

void bind_signs(nb::module_& m) {
    nb::class_<Signs>(m, "DenseSigns",
                      "Where a formula fails or holds for certain on a whole trace, as\n"
                      "rtamt.machines.dense.outlook.PythonDenseSigns.\n\n"
                      "Args:\n"
                      "    terms: The terms of a program, as rtamt.program.encoding encodes them.\n"
                      "    rows: The formulas behind them over regions, encoded too.\n"
                      "    result: Its register.\n"
                      "    clock: Ticks in a unit of time, as a double and as a quotient.\n"
                      "    reader: Counts the rare forms of times.\n"
                      "    given: The times and values of every variable.\n"
                      "    begin: The first tick of the trace.\n"
                      "    last: Its last one.\n"
                      "    end: The reading of the end.")
        .def("__init__", construct, nb::arg("terms"), nb::arg("rows"), nb::arg("result"),
             nb::arg("clock"), nb::arg("reader"), nb::arg("given"), nb::arg("begin"),
             nb::arg("last"), nb::arg("end"))
        .def("fails_at", fails_at, nb::arg("instants"),
             "Return the ticks, the occasions and the first position at which it fails.")
        .def("holds_at", holds_at, nb::arg("instants"),
             "Return whether it holds at all of some positions.");
}

}  // namespace rtamt
