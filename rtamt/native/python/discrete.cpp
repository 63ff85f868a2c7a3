// The discrete machine as a Python class.
#include <nanobind/nanobind.h>

#include <utility>
#include <vector>

#include "python/encoding.hpp"
#include "python/samples.hpp"

namespace rtamt {
namespace {

using DiscreteObject = NamedObject<DiscreteMachine>;

void construct(DiscreteObject* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result, const nb::sequence& observed,
               nb::object reader) {
    std::vector<Observed> pairs;
    for (nb::handle pair : observed)
        pairs.push_back({nb::cast<std::size_t>(pair[0]), nb::cast<std::int64_t>(pair[1])});
    if (pairs.empty() || pairs[0].slot != result)
        throw nb::value_error("expected the result first among the observed");
    new (self) DiscreteObject{
        {DiscreteMachine(discrete_rows(rows), terms, nb::len(variables), pairs), std::move(reader)},
        Arguments(variables)};
}

nb::list registers(const DiscreteObject& object) {
    const std::vector<double>& values = object.machine.registers();
    return list_of(values.data(), values.size());
}

nb::list run(DiscreteObject& object, const nb::sequence& columns, std::size_t n, bool final) {
    require_idle(object);
    DiscreteMachine& machine = object.machine;
    if (final && machine.samples() > 0)
        throw nb::value_error("expected a new machine for a whole trace");
    const auto numpy = nb::module_::import_("numpy");
    std::vector<ArrayView> in;
    std::vector<ArrayView> out;
    std::vector<const double*> sources;
    std::vector<double*> targets;
    for (nb::handle column : columns) {
        in.emplace_back(numpy.attr("ascontiguousarray")(column, "float64"), n, PyBUF_ND);
        sources.push_back(in.back().data<double>());
    }
    if (in.size() != machine.variables())
        throw nb::value_error("expected a column for every variable");
    for (std::size_t i = 0; i < machine.observed(); ++i) {
        out.emplace_back(numpy.attr("empty")(n), n, PyBUF_ND | PyBUF_WRITABLE);
        targets.push_back(out.back().data<double>());
    }
    require_idle(object);
    const std::int64_t sample = machine.samples();
    const std::size_t taken = run_long(
        object, n, [&] { return machine.run(sources.data(), n, final, targets.data()); });
    if (taken < n) {
        std::vector<double> values;
        for (const double* source : sources) values.push_back(source[taken]);
        refuse_nan(object, values.data(), sample + static_cast<std::int64_t>(taken));
    }
    nb::list arrays;
    for (const ArrayView& view : out) arrays.append(view.array());
    return arrays;
}

PyMethodDef methods[] = {sample_update<DiscreteObject>(), {nullptr, nullptr, 0, nullptr}};

}  // namespace

void bind_discrete(nb::module_& m) {
    sample_class<DiscreteObject>(
        m, "DiscreteMachine",
        "Runs a program on samples, as rtamt.machines.protocols.DiscreteMachine says.\n\n"
        "Args:\n"
        "    rows: The program, as rtamt.program.encoding encodes it.\n"
        "    terms: The number of rows that are arithmetic over the sample.\n"
        "    variables: Names of the inputs.\n"
        "    result: Register that update returns.\n"
        "    observed: Pairs of a register and its latency: the result, then what run returns.\n"
        "    reader: Reads the rare forms of arguments, and raises all errors.",
        methods)
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("observed"), nb::arg("reader"))
        .def_prop_ro("registers", registers, "The value of every register.")
        .def("run", run, nb::arg("columns"), nb::arg("n"), nb::kw_only(), nb::arg("final"),
             "Take in n samples, or none if one is refused; return the observed registers.");
}

}  // namespace rtamt
