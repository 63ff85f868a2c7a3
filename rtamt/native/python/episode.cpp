// The episode machine as a Python class.
#include "python/episode.hpp"

#include <nanobind/nanobind.h>

#include <utility>

#include "python/encoding.hpp"

namespace rtamt {
namespace {

void construct(EpisodeObject* self, const nb::sequence& terms, const nb::sequence& formulas,
               const nb::sequence& initial, const nb::sequence& streams,
               const nb::tuple& variables, nb::object reader, const nb::sequence& neutral) {
    const nb::object policy = nb::getattr(reader, "nan", nb::none());
    const bool nan_is_unknown = policy.equal(nb::str("unknown"));
    Arguments names(variables);
    new (self) EpisodeObject{
        {{EpisodeVariants({discrete_rows(terms), nb::len(variables), formula_rows(formulas),
                           registers_of(initial), registers_of(streams)},
                          registers_of(neutral)),
          std::move(reader)},
         std::move(names)},
        {},
        nan_is_unknown};
}

// Judges a whole trace from a reset on, without a sample that is refused: None if there is one.
nb::object judge(EpisodeObject& object, const nb::sequence& columns, std::size_t n,
                 const std::string& end) {
    require_idle(object);
    const End reading = end_of(end);
    EpisodeVariants& machine = object.machine;
    const Arrays arrays(machine.variables(), 0, columns, n);
    require_idle(object);
    if (n == 0) throw nb::value_error("expected a sample, got none");
    machine.reset();
    nb::object decided = nb::none();
    for (std::size_t i = 0; i < n; ++i) {
        double* pending = machine.pending();
        for (std::size_t k = 0; k < machine.variables(); ++k) pending[k] = arrays.sources()[k][i];
        if (!machine.take()) return nb::none();
        if (decided.is_none() && machine.verdict() != 0) decided = nb::int_(i);
    }
    const double complete = machine.result();
    machine.finish(reading);
    return nb::make_tuple(machine.result(), complete, machine.lower(), machine.upper(), decided);
}

double finish(EpisodeObject& object, const std::string& end) {
    require_idle(object);
    const End reading = end_of(end);
    if (object.machine.samples() == 0) refuse_state("refuse_finish");
    object.machine.finish(reading);
    refresh(object);
    return object.machine.result();
}

void show_in(EpisodeObject& object, nb::handle monitor, const nb::sequence& slots,
             const nb::sequence& verdicts) {
    object.readout.attach(object.machine, monitor, slots, verdicts);
}

// The number that a function of the machine gives.
template <auto number>
double get(const EpisodeObject& object) {
    return (object.machine.*number)();
}

PyMethodDef methods[] = {sample_update<EpisodeObject>(), {nullptr, nullptr, 0, nullptr}};

}  // namespace

void bind_episode(nb::module_& m) {
    sample_class<EpisodeObject>(
        m, "EpisodeMachine",
        "Bounds the robustness of an episode, as rtamt.machines.protocols.EpisodeMachine says.\n\n"
        "Args:\n"
        "    terms: The first rows of the program, as rtamt.program.encoding encodes them.\n"
        "    formulas: The other rows.\n"
        "    initial: Registers that are read at time 0 alone, the result last.\n"
        "    streams: Registers that are read at all times.\n"
        "    variables: Names of the inputs.\n"
        "    reader: Reads the rare forms of arguments, and raises all errors.\n"
        "    neutral: Terms that are neutral predicates.",
        methods)
        .def("__init__", construct, nb::arg("terms"), nb::arg("formulas"), nb::arg("initial"),
             nb::arg("streams"), nb::arg("variables"), nb::arg("reader"),
             nb::arg("neutral") = nb::tuple())
        .def_prop_ro("robustness", get<&EpisodeVariants::result>,
                     "The robustness if the episode ended now.")
        .def_prop_ro("lower", get<&EpisodeVariants::lower>,
                     "The least robustness over all continuations.")
        .def_prop_ro("upper", get<&EpisodeVariants::upper>,
                     "The greatest robustness over all continuations.")
        .def_prop_ro("finished", [](const EpisodeObject& o) { return o.machine.finished(); },
                     "Whether the episode has ended.")
        .def("judge", judge, nb::arg("columns"), nb::arg("n"), nb::arg("end"),
             "Reset the machine and judge a trace; return its robustness, the robustness if it is\n"
             "complete, the bounds, and the first sample that decided the verdict or None; None if\n"
             "a value or a term is nan.")
        .def("finish", finish, nb::arg("end") = "complete",
             "End the episode, make the bounds those of this reading; return its robustness.")
        .def("show_in", show_in, nb::arg("monitor"), nb::arg("slots"), nb::arg("verdicts"),
             "Keep slots of a monitor at robustness, lower, upper and verdict while it lives.");
    m.def("read_only", read_only, nb::arg("slot"),
          "Return a descriptor that reads a slot of a class, and does not write it.");
}

}  // namespace rtamt
