// The episode machine as a Python class.
#include <nanobind/nanobind.h>

#include <optional>
#include <utility>
#include <vector>

#include "bound.hpp"
#include "encoded.hpp"
#include "episode.hpp"

namespace rtamt {
namespace {

using BoundEpisode = Bound<EpisodeMachine>;

void construct(BoundEpisode* self, const nb::sequence& terms,
               const nb::sequence& formulas, const nb::sequence& tops,
               const nb::sequence& streams, const nb::tuple& variables, nb::object reader) {
    new (self) BoundEpisode{
        EpisodeMachine(rows_of(terms), nb::len(variables), formulas_of(formulas),
                       registers_of(tops), registers_of(streams)),
        Arguments(variables), std::move(reader)};
}

double finish(BoundEpisode& bound) {
    if (bound.machine.samples() == 0) refuse_state("refuse_finish");
    bound.machine.finish();
    return bound.machine.result();
}

}  // namespace

void bind_episode(nb::module_& m) {
    nb::class_<BoundEpisode>(
        m, "EpisodeMachine", nb::type_slots(slots<EpisodeMachine>),
        "Bounds the robustness of an episode, as rtamt.episode.EpisodeMachine does.\n\n"
        "Args:\n"
        "    terms: The first instructions, as rtamt.schedule.encoded writes them.\n"
        "    formulas: The others, as rtamt.placement writes them.\n"
        "    tops: Registers that are read at time 0 alone, the result last.\n"
        "    streams: Registers that are read at all times.\n"
        "    variables: Names of the inputs.\n"
        "    reader: Reads the arguments that are rare, and makes all messages.")
        .def("__init__", construct, nb::arg("terms"), nb::arg("formulas"), nb::arg("tops"),
             nb::arg("streams"), nb::arg("variables"), nb::arg("reader"))
        .def_prop_ro("samples", [](const BoundEpisode& b) { return b.machine.samples(); },
                     "Samples taken in since the reset.")
        .def_prop_ro("inputs", inputs<EpisodeMachine>, "The last sample, empty before the first.")
        .def_prop_ro("robustness", [](const BoundEpisode& b) { return b.machine.result(); },
                     "Robustness if the episode ended now.")
        .def_prop_ro("lower", [](const BoundEpisode& b) { return b.machine.lower(); },
                     "The least over all continuations.")
        .def_prop_ro("upper", [](const BoundEpisode& b) { return b.machine.upper(); },
                     "The greatest over all continuations.")
        .def_prop_ro("finished", [](const BoundEpisode& b) { return b.machine.finished(); },
                     "Whether the trace has ended.")
        .def("finish", finish, "End the trace.")
        .def("reset", reset<EpisodeMachine>, "Forget every sample.")
        .def("state", state<EpisodeMachine>,
             "Values one behind the other, with a mark of the program.")
        .def("restore", restore<EpisodeMachine>, nb::arg("state").none(),
             "Continue from where the state was taken.\n\n"
             "Raises:\n"
             "    ValueError: If another program's machine gave it (then nothing changes), or it\n"
             "        is damaged (then the machine is reset).");
}

}  // namespace rtamt
