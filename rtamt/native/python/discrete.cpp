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
    Arguments names(variables);
    new (self) DiscreteObject{
        {DiscreteMachine(discrete_rows(rows), terms, nb::len(variables), pairs), std::move(reader)},
        std::move(names)};
}

nb::list registers(const DiscreteObject& object) {
    const std::vector<double>& values = object.machine.registers();
    return list_of(values.data(), values.size());
}

nb::list run(DiscreteObject& object, const nb::sequence& columns, std::size_t n) {
    require_idle(object);
    DiscreteMachine& machine = object.machine;
    const Arrays arrays(machine.variables(), machine.observed(), columns, n);
    require_idle(object);
    const std::int64_t sample = machine.samples();
    const std::size_t taken =
        run_long(object, n, [&] { return machine.run(arrays.sources(), n, arrays.targets()); });
    if (taken < n)
        refuse_nan(object, arrays.sample(taken).data(), sample + static_cast<std::int64_t>(taken));
    return arrays.made();
}

nb::list evaluate(DiscreteObject& object, const nb::sequence& columns, std::size_t n,
                  bool backwards) {
    require_idle(object);
    const DiscreteMachine& machine = object.machine;
    const Arrays arrays(machine.variables(), machine.observed(), columns, n);
    require_idle(object);
    const std::size_t taken = run_long(object, n, [&] {
        return machine.evaluate(arrays.sources(), n, backwards, arrays.targets());
    });
    if (taken < n)
        refuse_nan(object, arrays.sample(taken).data(), static_cast<std::int64_t>(taken));
    return arrays.made();
}

PyMethodDef methods[] = {sample_update<DiscreteObject>(), {nullptr, nullptr, 0, nullptr}};

}  // namespace

void bind_discrete(nb::module_& m) {
    sample_class<DiscreteObject>(
        m, "DiscreteMachine",
        "Runs a program on samples, as rtamt.machines.protocols.DiscreteMachine says.", methods)
        .def("__init__", construct, "rows"_a, "terms"_a, "variables"_a, "result"_a, "observed"_a,
             "reader"_a)
        .def_prop_ro("registers", when_idle<DiscreteObject>(registers))
        .def("run", run, "columns"_a, "n"_a)
        .def("evaluate", evaluate, "columns"_a, "n"_a, nb::kw_only(), "backwards"_a = false);
}

}  // namespace rtamt
