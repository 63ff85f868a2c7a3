// Clocks of temporal operators as a Python class. The definition is rtamt/machines/clocks.py.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <string>
#include <utility>
#include <vector>

#include "batch/clocks.hpp"
#include "python/arrays.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

using ClocksObject = Object<ClockBatch>;

template <class Named>
Named one_of(nb::handle name, std::initializer_list<const char*> names) {
    int place = 0;
    for (const char* each : names) {
        if (nb::cast<std::string>(name) == each) return static_cast<Named>(place);
        ++place;
    }
    throw nb::value_error("expected a row of rtamt.machines.clocks.OperatorClock");
}

ClockRow row_of(nb::handle row, std::size_t parts) {
    const auto count = [](nb::handle number) { return nb::cast<std::int64_t>(number); };
    ClockRow made{};
    made.kind = one_of<ClockRow::Kind>(row.attr("kind"), {"oldest", "newest", "last"});
    made.event = one_of<ClockRow::Event>(row.attr("event"),
                                         {"holds", "fails", "until", "unless", "since"});
    made.begin = count(row.attr("begin"));
    made.end = row.attr("end").is_none() ? -1 : count(row.attr("end"));
    made.late = count(row.attr("late"));
    made.asked = row.attr("asked").is_none() ? -1 : count(row.attr("asked"));
    made.first = nb::cast<bool>(row.attr("first"));
    for (nb::handle operand : row.attr("operands"))
        made.operands.push_back({nb::cast<std::size_t>(operand[0]),
                                 nb::cast<std::size_t>(operand[1])});
    bool known = made.asked < static_cast<std::int64_t>(parts);
    for (const auto& operand : made.operands) known = known && operand.part < parts;
    if (!known) throw nb::value_error("expected clocks of the parts that are fed");
    return made;
}

void construct(ClocksObject* self, const nb::sequence& rows, std::size_t parts, std::size_t num) {
    std::vector<ClockRow> made;
    for (nb::handle row : rows) made.push_back(row_of(row, parts));
    new (self) ClocksObject{ClockBatch(std::move(made), parts, num), nb::none()};
}

// A mask for as long as its array is held.
const std::uint8_t* mask_of(const ClocksObject& object, nb::handle mask) {
    if (mask.is_none()) return nullptr;
    const auto num = static_cast<Py_ssize_t>(object.machine.num());
    const std::uint8_t* found = Numpy::instance().mask(mask.ptr(), num);
    if (found == nullptr) throw nb::value_error("expected a mask of one boolean for each entry");
    return found;
}

void feed(ClocksObject& object, nb::handle values, nb::handle mask) {
    require_idle(object);
    ClockBatch& batch = object.machine;
    const std::size_t n = batch.parts() * batch.num();
    const void* parts = Numpy::instance().elements<double>(values.ptr(), n);
    if (parts == nullptr && n > 0) throw nb::value_error("expected a contiguous row of each part");
    batch.feed(static_cast<const double*>(parts), mask_of(object, mask));
}

void reset_entries(ClocksObject& object, nb::handle mask) {
    require_idle(object);
    object.machine.reset(mask_of(object, mask));
}

template <auto write, auto rows>
nb::object table(const ClocksObject& object) {
    static const NewArray array("float64");
    const ClockBatch& batch = object.machine;
    double* out = nullptr;
    const nb::object made = array.unfilled<double>((batch.*rows)() * batch.num(), out);
    (batch.*write)(out);
    return made.attr("reshape")((batch.*rows)(), batch.num());
}

nb::object samples(const ClocksObject& object) {
    static const NewArray array("int64");
    return array.make<std::int64_t>(object.machine.num(), [&](std::size_t entry) {
        return object.machine.samples()[entry];
    });
}

}  // namespace

void bind_clocks(nb::module_& m) {
    machine_class<ClocksObject>(
        m, "ClockBatch",
        "Counts clocks of temporal operators, as rtamt.machines.protocols.ClockBatch says.\n\n"
        "Args:\n"
        "    rows: The clocks, each a rtamt.machines.clocks.OperatorClock.\n"
        "    parts: The number of parts whose values are fed.\n"
        "    num: The number of entries.")
        .def("__init__", construct, nb::arg("rows"), nb::arg("parts"), nb::arg("num"))
        .def("feed", feed, nb::arg("values"), nb::arg("mask").none() = nb::none(),
             "Take in a sample in each entry that the mask chooses: a row of each part.")
        .def("reset", reset_entries, nb::arg("mask").none() = nb::none(),
             "Return the entries that the mask chooses to the state before their first sample.")
        .def_prop_ro("samples", samples, "The number of samples of every entry since its reset.")
        .def_prop_ro("fractions", table<&ClockBatch::write_fractions, &ClockBatch::size>,
                     "A row for each clock: from 0 to 1 in each entry.")
        .def_prop_ro("margins", table<&ClockBatch::write_margins, &ClockBatch::operands>,
                     "A row for each operand of each clock: its newest known value, 0 before it.");
}

}  // namespace rtamt
