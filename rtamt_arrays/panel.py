"""The monitors of several specifications in many environments, as pure functions of arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rtamt import Specification
from rtamt.program.instructions import Window
from rtamt.program.program import Program
from rtamt.typing import Align, Period
from rtamt_arrays.costs import ArrayCosts, CostState
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.instants import ArrayInstants, InstantState
from rtamt_arrays.monitors import ArrayMonitors
from rtamt_arrays.operations import Operations, Tensor
from rtamt_arrays.worlds import BoundsReading, EpisodeState
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.monitors import MonitorValues, make_monitors
from rtamt_gym.options.evaluation import EvaluationOptions

__all__ = ["ArrayPanel", "PanelState", "Taken"]


class PanelState(NamedTuple):
    """What the monitors know of the episodes.

    Attributes:
        judges: The state of the judge of each specification.
        instants: With ``view="step"``, what is known of the instants of each.
        costs: What is known of the costs.
        held: The last value of each variable that is held.
    """

    judges: tuple[EpisodeState, ...]
    instants: tuple[InstantState, ...]
    costs: CostState
    held: tuple[Tensor, ...]


class Taken(NamedTuple):
    """A sample that was taken in.

    Attributes:
        panel: What is known after it.
        readings: What the judge of each specification says.
        cut: The same if the trace is cut there.
        of_instants: With ``view="step"``, the robustness of the newest instant of each.
        worst: What the demands come to on which costs are, for each specification.
    """

    panel: PanelState
    readings: Sequence[BoundsReading]
    cut: Sequence[BoundsReading]
    of_instants: Sequence[Tensor]
    worst: Sequence[Tensor]


class ArrayPanel:
    """The twin of `rtamt_gym.judging.vector_panel.VectorPanel`.

    Args:
        specs: Specifications by name.
        reading: How samples are judged.
        cost: What is measured; None: nothing.
        held: The variables that keep their last value where they are nan.
        monitors: Makes the monitors.
        operations: The operations of the array library.

    Attributes:
        latencies: Of each judge, the samples after the first on which it depends; None: all.
        cost_keys: The keys of the infos that have costs.

    Raises:
        SpecificationError: As the monitors of `rtamt_gym` do.
    """

    def __init__(
        self,
        specs: Mapping[str, Specification],
        reading: EvaluationOptions,
        cost: Cost | None,
        held: Sequence[str],
        monitors: ArrayMonitors,
        operations: Operations,
    ) -> None:
        def of_episode(
            spec: Specification, *, period: Period | None, align: Align | None, **_: object
        ) -> EpisodeArrays:
            return monitors.episode(spec, period, align=align)

        def of_instants(
            spec: Specification, *, period: Period | None, align: Align | None, **_: object
        ) -> ArrayInstants:
            return ArrayInstants(monitors, operations, spec, period, align)

        self._o = operations
        pairs = make_monitors(specs, reading, of_episode, of_instants).values()
        self._judges: list[EpisodeArrays] = [judge for _, judge in pairs]
        self._instants: list[ArrayInstants] = []
        if reading.view == "step":
            self._instants = [source for source, _ in pairs]
        self._ends = reading.at_termination or "complete", reading.at_truncation
        self._cuts = [
            "cut" in self._ends and _cut_by_an_end(judge.program) for judge in self._judges
        ]
        self.latencies = tuple(judge.program.latency for judge in self._judges)
        self._costs = ArrayCosts(cost, specs, reading, monitors, operations)
        self.cost_keys = self._costs.keys
        self._held = held

    def init(self, lanes: int) -> PanelState:
        """The state before the first sample."""
        judges = tuple(each.init(lanes) for each in self._judges)
        instants = tuple(each.init(lanes) for each in self._instants)
        dtype = judges[0].rows.dtype
        held = tuple(self._o.full((lanes,), math.nan, dtype) for _ in self._held)
        return PanelState(judges, instants, self._costs.init(lanes, dtype), held)

    def reset(self, state: PanelState, mask: Tensor) -> PanelState:
        """Return the state in which the lanes of the mask have not taken a sample."""
        judges = zip(self._judges, state.judges, strict=True)
        instants = zip(self._instants, state.instants, strict=True)
        return PanelState(
            tuple(judge.reset(each, mask) for judge, each in judges),
            tuple(source.reset(each, mask) for source, each in instants),
            self._costs.reset(state.costs, mask),
            tuple(self._o.where(mask, math.nan, last) for last in state.held),
        )

    def begin(self, state: PanelState, sample: Mapping[str, Tensor], mask: Tensor) -> Taken:
        """Lanes of the mask begin with a sample, while the others take none."""
        judges, readings, of_instants, instants = [], [], [], []
        for judge, before in zip(self._judges, state.judges, strict=True):
            begun, reading = judge.begin(before, sample, mask)
            judges.append(begun)
            readings.append(reading)
        for each, known in zip(self._instants, state.instants, strict=True):
            following, robustness = each.begin(known, sample, mask)
            instants.append(following)
            of_instants.append(robustness)
        costs = self._costs.begin(state.costs, sample, mask)
        held = []
        for name, last in zip(self._held, state.held, strict=True):
            held.append(self._o.where(mask, self._o.as_kind_of(sample[name], last), last))
        panel = PanelState(tuple(judges), tuple(instants), costs, tuple(held))
        return Taken(panel, readings, readings, of_instants, [])

    def feed(self, state: PanelState, sample: Mapping[str, Tensor], at: Tensor) -> Taken:
        """Every lane takes a sample, which has this number."""
        held = []
        for name, last in zip(self._held, state.held, strict=True):
            value = self._o.as_kind_of(sample[name], last)
            held.append(self._o.where(self._o.isnan(value), last, value))
        sample = {**sample, **dict(zip(self._held, held, strict=True))}
        judged = []
        for judge, before, cuts in zip(self._judges, state.judges, self._cuts, strict=True):
            if cuts:
                judged.append(judge.update_and_cut(before, sample))
            else:
                following, reading = judge.update(before, sample)
                judged.append((following, reading, self._complete(reading)))
        judges, readings, cut = zip(*judged, strict=True)
        pairs = zip(self._instants, state.instants, strict=True)
        found = [each.update(known, sample) for each, known in pairs]
        zero = self._zero(readings[0].upper)
        costs, worst = self._costs.take(state.costs, sample, at, zero)
        panel = PanelState(judges, tuple(known for known, _ in found), costs, tuple(held))
        return Taken(panel, readings, cut, [robustness for _, robustness in found], worst)

    def values(
        self, taken: Taken, samples: Tensor, terminated: Tensor, truncated: Tensor
    ) -> MonitorValues[Any]:
        """The values of the monitors.

        Args:
            taken: What `begin` or `feed` gave.
            samples: Samples of each lane since its reset.
            terminated: Where the environment has terminated the episode.
            truncated: Where a limit of time has.
        """
        ends = (terminated, self._ends[0]), (truncated & ~terminated, self._ends[1])
        pairs = zip(taken.readings, taken.cut, strict=True)
        found = [self._at_end(reading, cut, ends) for reading, cut in pairs]
        judged = [each.robustness for each in found]
        return MonitorValues(
            list(taken.of_instants) or judged,
            judged,
            [each.lower for each in found],
            [each.upper for each in found],
            [each.verdict for each in found],
            samples,
        )

    def charged(
        self, taken: Taken, values: MonitorValues[Any]
    ) -> tuple[PanelState, dict[str, Tensor]]:
        """What is known after a step, and the keys of its info that have costs."""
        zero = self._zero(values.upper[0])
        violated = [self._o.where(verdict < 0, zero + 1.0, zero) for verdict in values.verdicts]
        costs, keys = self._costs.charge(taken.panel.costs, taken.worst, violated)
        return taken.panel._replace(costs=costs), keys

    def unpaid(self, values: MonitorValues[Any]) -> dict[str, Tensor]:
        """The keys of the info of a reset that have costs."""
        return dict.fromkeys(self.cost_keys, self._zero(values.upper[0]))

    def _zero(self, like: Tensor) -> Tensor:
        return self._o.full(tuple(like.shape), 0.0, like.dtype)

    def _at_end(
        self, reading: BoundsReading, cut: BoundsReading, ends: Sequence[tuple[Tensor, str]]
    ) -> BoundsReading:
        """The reading where the environment has ended an episode, read as the options say."""
        found = reading
        for lanes, end in ends:
            if end in {"complete", "cut"}:
                closed = self._complete(reading) if end == "complete" else cut
                chosen = (self._o.where(lanes, *pair) for pair in zip(closed, found, strict=True))
                found = BoundsReading(*chosen)
            elif end == "failure":
                failed = lanes & (reading.verdict == 0)
                upper = self._o.where(failed, -0.0, found.upper)
                verdict = self._o.where(failed, found.verdict * 0 - 1, found.verdict)
                found = found._replace(upper=upper, verdict=verdict)
        return found

    def _complete(self, reading: BoundsReading) -> BoundsReading:
        """The reading if the trace is all there is; of a nan it stays open."""
        o, known = self._o, ~reading.nan
        sign = 1 - 2 * o.as_integers(o.signbit(reading.robustness))
        return reading._replace(
            lower=o.where(known, reading.robustness, reading.lower),
            upper=o.where(known, reading.robustness, reading.upper),
            verdict=o.where(known, sign, reading.verdict),
        )


def _cut_by_an_end(program: Program) -> bool:
    """Whether a window can reach past an end, so that a cut trace is not read as a complete one."""
    windows = [each for each in program.instructions if isinstance(each, Window)]
    return any(each.lo != 0 if each.hi is None else each.hi > 0 for each in windows)
