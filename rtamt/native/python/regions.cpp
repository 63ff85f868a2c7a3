// The registers over the regions of dense time as a Python class.
#include <nanobind/nanobind.h>

#include <vector>

#include "dense/terms.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

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

}  // namespace rtamt
