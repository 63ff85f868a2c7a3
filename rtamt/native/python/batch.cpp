// The batches as Python classes. The definitions are rtamt/machines/batch.py and
// rtamt/machines/clocks.py.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "batch/clocks.hpp"
#include "batch/variants.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"
#include "python/samples.hpp"

namespace rtamt {
namespace {

using EpisodeObject = Object<BatchVariants>;

// The elements of an array, and what keeps them where they are.
template <class Elements>
struct Held {
    nb::object array;
    Elements elements;
    std::vector<ArrayView> view;
};

// Holds a contiguous array of n elements that the reader has made.
template <class T>
Held<const T*> held(nb::object array, std::size_t n) {
    Held<const T*> made{std::move(array), nullptr, {}};
    made.view.emplace_back(made.array.attr("reshape")(-1), n, PyBUF_ND);
    made.elements = made.view.front().template data<T>();
    return made;
}

template <class B>
Held<const std::uint8_t*> mask_of(const Object<B>& object, nb::handle mask) {
    if (mask.is_none()) return {nb::none(), nullptr, {}};
    const std::size_t num = object.machine.num();
    const std::uint8_t* fast = Numpy::instance().mask(mask.ptr(), num);
    if (fast != nullptr) return {nb::borrow(mask), fast, {}};
    return held<std::uint8_t>(object.reader.attr("mask")(mask), num);
}

template <class B>
Held<Table> table_of(const Object<B>& object, nb::handle values) {
    const std::size_t num = object.machine.num();
    const std::size_t width = object.machine.variables();
    const Table fast = Numpy::instance().table(values.ptr(), static_cast<Py_ssize_t>(num),
                                               static_cast<Py_ssize_t>(width));
    if (fast.data != nullptr) return {nb::borrow(values), fast, {}};
    auto made = held<double>(object.reader.attr("values")(values), num * width);
    return {std::move(made.array),
            {made.elements, static_cast<std::ptrdiff_t>(width), 1},
            std::move(made.view)};
}

nb::object finished(const EpisodeObject& object) {
    static const NewArray array("bool");
    return array.make<bool>(object.machine.num(), [&](std::size_t entry) {
        return object.machine.finished()[entry] != 0;
    });
}

nb::object unknown(const EpisodeObject& object) {
    static const NewArray array("bool");
    const BatchVariants& batch = object.machine;
    const std::size_t num = batch.num();
    const std::size_t width = batch.variables();
    const nb::object found = array.make<bool>(num * width, [&](std::size_t i) {
        return !same(batch.inputs()[i], batch.upper_inputs()[i]);
    });
    return found.attr("reshape")(width, num).attr("T");
}

nb::object verdicts(const EpisodeObject& object) {
    static const NewArray array("int8");
    const double* lower = object.machine.lower();
    const double* upper = object.machine.upper();
    return array.make<std::int8_t>(object.machine.num(), [=](std::size_t entry) {
        return static_cast<std::int8_t>(verdict_of(lower[entry], upper[entry]));
    });
}

template <class B>
nb::object samples(const Object<B>& object) {
    static const NewArray array("int64");
    return array.template make<std::int64_t>(
        object.machine.num(), [&](std::size_t entry) { return object.machine.samples()[entry]; });
}

template <class B>
nb::object inputs_of(const B& batch, const double* inputs) {
    const std::size_t width = batch.variables();
    return doubles(inputs, batch.num() * width).attr("reshape")(width, batch.num()).attr("T");
}

template <class B>
nb::object inputs(const Object<B>& object) {
    return inputs_of(object.machine, object.machine.inputs());
}

// Has the reader refuse the first chosen entry that is not allowed.
template <class B, class Allowed>
void require(const Object<B>& object, const std::uint8_t* mask, Allowed allowed, const char* call) {
    for (std::size_t entry = 0; entry < object.machine.num(); ++entry)
        if ((mask == nullptr || mask[entry]) && !allowed(entry)) refuse(object.reader, call, entry);
}

// A row of a table.
template <class B>
std::vector<double> row_of(const B& batch, const Table& table, std::size_t entry) {
    std::vector<double> row;
    for (std::size_t i = 0; i < batch.variables(); ++i)
        row.push_back(table.at(i)[static_cast<std::ptrdiff_t>(entry) * table.row]);
    return row;
}

nb::object update_discrete(Object<DiscreteBatch>& object, nb::handle values, nb::handle mask) {
    DiscreteBatch& batch = object.machine;
    const nb::object plain = table_of(object, values).array;
    const auto chosen = mask_of(object, mask);
    const auto table = table_of(object, plain);  // no code of the caller runs after this
    if (batch.take(table.elements, chosen.elements) < batch.num()) {
        const nb::object policy = object.reader.attr("without_nan");
        const nb::object filled = policy(plain, chosen.array, samples(object), inputs(object));
        const auto numbers = table_of(object, filled);
        const std::size_t entry = batch.take(numbers.elements, chosen.elements);
        if (entry < batch.num()) {
            const std::vector<double> sample = row_of(batch, numbers.elements, entry);
            refuse(object.reader, "refuse", list_of(sample.data(), sample.size()),
                   batch.samples()[entry], entry);
        }
    }
    return doubles(batch.results(), batch.num());
}

// The rare forms of an update, which the reader resolves or refuses: values by name.
template <class O>
nb::object update_by_name(O& object, const nb::args& args, const nb::kwargs& named) {
    return object.reader.attr("update")(nb::find(object), *args, **named);
}

void require_open(const EpisodeObject& object, const std::uint8_t* mask) {
    require(
        object, mask, [&](std::size_t entry) { return !object.machine.finished()[entry]; },
        "refuse_update");
}

nb::object update_episodes(EpisodeObject& object, nb::handle values, nb::handle mask,
                           nb::handle upper) {
    BatchVariants& batch = object.machine;
    const nb::object plain = table_of(object, values).array;
    nb::object above = nb::none();
    if (!upper.is_none()) above = table_of(object, upper).array;
    const auto chosen = mask_of(object, mask);
    const auto table = table_of(object, plain);  // no code of the caller runs after this
    require_open(object, chosen.elements);
    if (above.is_none() && batch.take(table.elements, chosen.elements) == batch.num())
        return doubles(batch.results(), batch.num());
    const nb::object ends = object.reader.attr("ends")(
        plain, above, chosen.array, samples(object),
        nb::make_tuple(inputs(object), inputs_of(batch, batch.upper_inputs())));
    const auto least = table_of(object, ends[0]);
    const auto greatest = table_of(object, ends[1]);
    require_open(object, chosen.elements);  // other threads run while the reader reads
    const std::size_t entry = batch.take(least.elements, greatest.elements, chosen.elements);
    if (entry < batch.num()) {
        const std::vector<double> low = row_of(batch, least.elements, entry);
        const std::vector<double> high = row_of(batch, greatest.elements, entry);
        refuse(object.reader, "refuse", sample_between(low.data(), high.data(), low.size()),
               batch.samples()[entry], entry);
    }
    return doubles(batch.results(), batch.num());
}

template <class B>
void reset_entries(Object<B>& object, nb::handle mask) {
    object.machine.reset(mask_of(object, mask).elements);
}

nb::object finish(EpisodeObject& object, nb::handle mask, const std::string& end) {
    BatchVariants& batch = object.machine;
    const End reading = end_of(end);
    const auto chosen = mask_of(object, mask);
    require(
        object, chosen.elements, [&](std::size_t entry) { return batch.samples()[entry] > 0; },
        "refuse_finish");
    batch.finish(chosen.elements, reading);
    return doubles(batch.results(), batch.num());
}

template <auto values>
nb::object of_entries(const EpisodeObject& object) {
    return doubles((object.machine.*values)(), object.machine.num());
}

// Adds a class with what both batches have to a module.
template <class B>
nb::class_<Object<B>> batch_class(nb::module_& m, const char* name, const char* doc) {
    auto made = machine_class<Object<B>>(m, name, doc);
    made.def_prop_ro("samples", samples<B>)
        .def_prop_ro("inputs", inputs<B>)
        .def("reset", reset_entries<B>, "mask"_a.none() = nb::none());
    return made;
}

void construct_discrete(Object<DiscreteBatch>* self, const nb::sequence& rows, std::size_t terms,
                        const nb::tuple& variables, std::size_t result, std::int64_t latency,
                        std::size_t num, nb::object reader) {
    new (self) Object<DiscreteBatch>{
        DiscreteBatch(discrete_rows(rows), terms, nb::len(variables), {result, latency}, num),
        std::move(reader)};
}

void construct_episode(EpisodeObject* self, const nb::sequence& terms, const nb::sequence& formulas,
                       const nb::sequence& initial, const nb::sequence& streams,
                       const nb::tuple& variables, std::size_t num, nb::object reader,
                       const nb::sequence& neutral) {
    new (self) EpisodeObject{
        BatchVariants({discrete_rows(terms), nb::len(variables), formula_rows(formulas),
                       registers_of(initial), registers_of(streams)},
                      registers_of(neutral), num),
        std::move(reader)};
}

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
    made.event =
        one_of<ClockRow::Event>(row.attr("event"), {"holds", "fails", "until", "unless", "since"});
    made.begin = count(row.attr("begin"));
    made.end = row.attr("end").is_none() ? -1 : count(row.attr("end"));
    made.late = count(row.attr("late"));
    made.asked = row.attr("asked").is_none() ? -1 : count(row.attr("asked"));
    made.first = nb::cast<bool>(row.attr("first"));
    for (nb::handle operand : row.attr("operands"))
        made.operands.push_back(
            {nb::cast<std::size_t>(operand[0]), nb::cast<std::size_t>(operand[1])});
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

void reset_clocks(ClocksObject& object, nb::handle mask) {
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

}  // namespace

void bind_batches(nb::module_& m) {
    batch_class<DiscreteBatch>(
        m, "DiscreteBatch",
        "Runs a program in many entries, as rtamt.machines.protocols.DiscreteBatch says.")
        .def("__init__", construct_discrete, "rows"_a, "terms"_a, "variables"_a, "result"_a,
             "latency"_a, "num"_a, "reader"_a)
        .def("update", update_discrete, "values"_a.none(), "mask"_a.none() = nb::none())
        .def("update", update_by_name<Object<DiscreteBatch>>, "args"_a, "named"_a);

    batch_class<BatchVariants>(
        m, "EpisodeBatch",
        "Bounds the robustness of many episodes, as rtamt.machines.protocols.EpisodeBatch says.")
        .def("__init__", construct_episode, "terms"_a, "formulas"_a, "initial"_a, "streams"_a,
             "variables"_a, "num"_a, "reader"_a, "neutral"_a = nb::tuple())
        .def("update", update_episodes, "values"_a.none(), "mask"_a.none() = nb::none(),
             "upper"_a.none() = nb::none())
        .def("update", update_by_name<EpisodeObject>, "args"_a, "named"_a)
        .def_prop_ro("robustness", of_entries<&BatchVariants::results>)
        .def_prop_ro("lower", of_entries<&BatchVariants::lower>)
        .def_prop_ro("upper", of_entries<&BatchVariants::upper>)
        .def_prop_ro("verdict", verdicts)
        .def_prop_ro("finished", finished)
        .def_prop_ro("unknown", unknown)
        .def("finish", finish, "mask"_a.none() = nb::none(), "end"_a = "complete");
    machine_class<ClocksObject>(
        m, "ClockBatch",
        "Counts clocks of temporal operators, as rtamt.machines.protocols.ClockBatch says.")
        .def("__init__", construct, "rows"_a, "parts"_a, "num"_a)
        .def("feed", feed, "values"_a, "mask"_a.none() = nb::none())
        .def("reset", reset_clocks, "mask"_a.none() = nb::none())
        .def_prop_ro("samples", samples<ClockBatch>)
        .def_prop_ro("fractions", table<&ClockBatch::write_fractions, &ClockBatch::size>)
        .def_prop_ro("margins", table<&ClockBatch::write_margins, &ClockBatch::operands>);
}

}  // namespace rtamt
