// The machine as a Python class; what its instructions mean is not known here.
#include <nanobind/nanobind.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "python/bound.hpp"
#include "python/encoded.hpp"
#include "python/view.hpp"

namespace rtamt {
namespace {

using BoundDiscrete = Bound<DiscreteMachine>;

constexpr std::size_t kWorthAThread = 10'000;  // samples for which others may run meanwhile

void construct(BoundDiscrete* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result, const nb::sequence& observed,
               nb::object reader) {
    std::vector<Observed> looked_at;
    for (nb::handle pair : observed)
        looked_at.push_back({nb::cast<std::size_t>(pair[0]), nb::cast<std::int64_t>(pair[1])});
    if (looked_at.empty() || looked_at[0].slot != result)
        throw nb::value_error("expected the result first among the observed");
    new (self) BoundDiscrete{DiscreteMachine(rows_of(rows), terms, nb::len(variables), looked_at),
                       Arguments(variables), std::move(reader)};
}

nb::list registers(const BoundDiscrete& bound) {
    const std::vector<double>& values = bound.machine.registers();
    return list_of(values.data(), values.size());
}

nb::list run(BoundDiscrete& bound, const nb::sequence& columns, std::size_t n, bool final) {
    require_idle(bound);
    DiscreteMachine& machine = bound.machine;
    if (final && machine.samples() > 0)
        throw nb::value_error("expected a new machine for a whole trace");
    const auto numpy = nb::module_::import_("numpy");
    std::vector<View> in;
    std::vector<View> out;
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
    require_idle(bound);
    std::size_t taken;
    const std::int64_t sample = machine.samples();
    if (n < kWorthAThread) {
        taken = machine.run(sources.data(), n, final, targets.data());
    } else {
        bound.running = true;
        try {
            const nb::gil_scoped_release others;
            taken = machine.run(sources.data(), n, final, targets.data());
        } catch (...) {
            bound.running = false;
            throw;
        }
        bound.running = false;
    }
    if (taken < n) {
        std::vector<double> values;
        for (const double* source : sources) values.push_back(source[taken]);
        refuse(bound, values.data(), sample + static_cast<std::int64_t>(taken));
    }
    nb::list arrays;
    for (const View& view : out) arrays.append(view.array());
    return arrays;
}

}  // namespace
}  // namespace rtamt

NB_MODULE(_native, m) {
    using namespace rtamt;
    m.doc() = "The machines of rtamt in C++.";

    nb::class_<BoundDiscrete>(m, "DiscreteMachine", nb::type_slots(slots<DiscreteMachine>),
                      "Runs a program on samples, as rtamt.machines.protocols.DiscreteMachine says.\n\n"
                      "Args:\n"
                      "    rows: The program, as rtamt.program.schedule.encoded writes it.\n"
                      "    terms: How many of its instructions are arithmetic over the sample.\n"
                      "    variables: Names of the inputs.\n"
                      "    result: Register of what update gives.\n"
                      "    observed: Registers with their latencies: the result, what run gives.\n"
                      "    reader: Reads the arguments that are rare, and makes all messages.")
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("observed"), nb::arg("reader"))
        .def_prop_ro("samples", [](const BoundDiscrete& b) { return b.machine.samples(); },
                     "Samples taken in since the reset.")
        .def_prop_ro("registers", registers, "The value of every register.")
        .def_prop_ro("inputs", inputs<DiscreteMachine>, "The last sample, empty before the first.")
        .def("run", run, nb::arg("columns"), nb::arg("n"), nb::kw_only(), nb::arg("final"),
             "Take in n samples at once, all or none; the observed registers at each.")
        .def("reset", reset<DiscreteMachine>, "Forget every sample.")
        .def("state", state<DiscreteMachine>, "Values one behind the other, with a mark of the program.")
        .def("restore", restore<DiscreteMachine>, nb::arg("state").none(),
             "Continue from where the state was taken.\n\n"
             "Raises:\n"
             "    ValueError: If another program's machine gave it (then nothing changes), or it\n"
             "        is damaged (then the machine is reset).");

    bind_episode(m);
    bind_banks(m);
    bind_dense(m);

    nb::dict functions;
    nb::dict folds;
    nb::list kinds;
#define RTAMT_NAME(name, arity, value) functions[#name] = arity;
    RTAMT_FUNCTIONS(RTAMT_NAME)
#undef RTAMT_NAME
#define RTAMT_NAME(name, Type) folds[#name] = Type::width;
    RTAMT_FOLDS(RTAMT_NAME)
#undef RTAMT_NAME
#define RTAMT_NAME(name) kinds.append(#name);
    RTAMT_KINDS(RTAMT_NAME)
#undef RTAMT_NAME
    m.attr("FUNCTIONS") = functions;
    m.attr("FOLDS") = folds;
    m.attr("KINDS") = nb::tuple(kinds);
}
