"""What makes the monitors of an array library.

The robustness of a formula at every instant, on arrays.

The costs of steps on arrays: `rtamt_gym.judging.costs` says what they are.

The monitors of several specifications in many environments, as pure functions of arrays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from rtamt import Specification
from rtamt.program.instructions import Window
from rtamt.program.program import Program
from rtamt.typing import Align, Period
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.layout import BoundsReading, EpisodeState
from rtamt_arrays.online import OnlineMonitor, OnlineReading, OnlineState
from rtamt_arrays.operations import Operations, Tensor
from rtamt_gym.judging.costs import Cost, Demand, keyed_costs, measured_demands, step_costs
from rtamt_gym.judging.monitors import MonitorValues, make_monitors, options_of_parts
from rtamt_gym.options.evaluation import EvaluationOptions


class MakesEpisodes(Protocol):
    """The function ``episode`` of an array library."""

    def __call__(
        self, spec: Specification, period: Period | None, *, align: Align | None
    ) -> EpisodeArrays:
        """The monitor of a specification."""


class MakesOnline(Protocol):
    """The function ``online`` of an array library."""

    def __call__(
        self, spec: Specification, period: Period | None, *, align: Align | None
    ) -> OnlineMonitor:
        """The monitor of a specification."""


class ArrayMonitors(NamedTuple):
    """Both functions, for one kind of floats.

    Attributes:
        episode: Makes monitors of episodes.
        online: Makes monitors of every instant.
    """

    episode: MakesEpisodes
    online: MakesOnline


class InstantState(NamedTuple):
    """What is known of the instants of each lane.

    Attributes:
        newest: The state of the monitor of single instants.
        sofar: That of the monitor of the samples so far, whose robustness stands for that of the
            first instant until it is known.
    """

    newest: OnlineState
    sofar: EpisodeState


class ArrayInstants:
    """`rtamt_gym.judging.monitors.VectorInstantMonitor` as pure functions of arrays.

    Args:
        monitors: Makes the monitors.
        operations: The operations of the array library.
        spec: The specification.
        period: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`.

    Attributes:
        judge: Gives bounds and verdict of ``always(formula)`` over the same samples.

    Raises:
        SpecificationError: As `rtamt.Monitor` does.
    """

    def __init__(
        self,
        monitors: ArrayMonitors,
        operations: Operations,
        spec: Specification,
        period: Period | None,
        align: Align | None,
    ) -> None:
        self._o = operations
        self._newest = monitors.online(spec, period, align=align)
        self._sofar = monitors.episode(spec, period, align=align)
        self.judge = monitors.episode(spec.always(), period, align=align)

    def init(self, lanes: int) -> InstantState:
        """The state before the first sample."""
        return InstantState(self._newest.init(lanes), self._sofar.init(lanes))

    def reset(self, state: InstantState, mask: Tensor) -> InstantState:
        """Return the state in which the lanes of the mask have not taken a sample."""
        return InstantState(
            self._newest.reset(state.newest, mask), self._sofar.reset(state.sofar, mask)
        )

    def begin(
        self, state: InstantState, sample: Mapping[str, Tensor], mask: Tensor
    ) -> tuple[InstantState, Tensor]:
        """Lanes of the mask begin with a sample; gives its robustness."""
        newest, reading = self._newest.begin(state.newest, sample, mask)
        sofar, of_first = self._sofar.begin(state.sofar, sample, mask)
        return InstantState(newest, sofar), self._known(reading, of_first.robustness)

    def update(
        self, state: InstantState, sample: Mapping[str, Tensor]
    ) -> tuple[InstantState, Tensor]:
        """Every lane takes a sample; gives the robustness of the newest instant that is known."""
        newest, reading = self._newest.update(state.newest, sample)
        sofar, of_first = self._sofar.update(state.sofar, sample)
        return InstantState(newest, sofar), self._known(reading, of_first.robustness)

    def _known(self, reading: OnlineReading, sofar: Tensor) -> Tensor:
        return self._o.where(self._o.isnan(reading.robustness), sofar, reading.robustness)


class CostState(NamedTuple):
    """What is known of costs.

    Attributes:
        monitors: The state of the monitor of each demand.
        charged: With ``"first"``, 1 where a specification was violated before the step, a row for
            each.
    """

    monitors: tuple[OnlineState, ...]
    charged: Tensor


class ArrayCosts:
    """`rtamt_gym.judging.costs.VectorCostMeter` as pure functions of arrays.

    Args:
        kind: What is measured; None: nothing.
        specs: Specifications by name.
        reading: How samples are judged.
        monitors: Makes the monitors.
        operations: The operations of the array library.

    Attributes:
        keys: The keys of the infos.

    Raises:
        SpecificationError: As `rtamt_gym.judging.costs.demands_of` does.
    """

    def __init__(
        self,
        kind: Cost | None,
        specs: Mapping[str, Specification],
        reading: EvaluationOptions,
        monitors: ArrayMonitors,
        operations: Operations,
    ) -> None:
        self._kind = kind
        self._names = list(specs)
        self._o = operations
        self._demands = [] if kind is None else measured_demands(kind, specs, reading)
        options = options_of_parts(specs, [each.spec for each in self._demands], reading)
        self._monitors = [
            monitors.online(demand.spec, option["period"], align=option["align"])
            for demand, option in zip(self._demands, options, strict=True)
        ]
        self.keys = frozenset[str]()
        if kind is not None:
            self.keys = frozenset(keyed_costs(self._names, [0.0] * (len(self._names) + 1)))

    def init(self, lanes: int, dtype: object) -> CostState:
        """The state before the first sample."""
        monitors = tuple(monitor.init(lanes) for monitor in self._monitors)
        rows = len(self._names) if self._kind == "first" else 0
        return CostState(monitors, self._o.full((rows, lanes), 0.0, dtype))

    def reset(self, state: CostState, mask: Tensor) -> CostState:
        """Return the state in which the lanes of the mask have not taken a sample."""
        pairs = zip(self._monitors, state.monitors, strict=True)
        monitors = tuple(monitor.reset(each, mask) for monitor, each in pairs)
        return CostState(monitors, self._o.where(mask, 0.0, state.charged))

    def begin(self, state: CostState, sample: Mapping[str, Tensor], mask: Tensor) -> CostState:
        """Lanes of the mask begin with a sample, which costs nothing."""
        pairs = zip(self._monitors, state.monitors, strict=True)
        begun = [monitor.begin(each, sample, mask) for monitor, each in pairs]
        charged = self._o.where(mask, 0.0, state.charged)
        return CostState(tuple(each for each, _ in begun), charged)

    def take(
        self, state: CostState, sample: Mapping[str, Tensor], at: Tensor, zero: Tensor
    ) -> tuple[CostState, list[Tensor]]:
        """Every lane takes a sample; gives what the demands of each specification come to.

        Args:
            state: What `init`, `begin` or `charge` gave.
            sample: An array of shape (lanes,) for each variable.
            at: The number of the sample.
            zero: A zero of each lane.
        """
        monitors, worst = [], [zero] * len(self._names)
        for demand, monitor, each in zip(
            self._demands, self._monitors, state.monitors, strict=True
        ):
            following, reading = monitor.update(each, sample)
            monitors.append(following)
            cost = self._cost(demand, reading, at - monitor.latency, zero)
            worst[demand.place] = self._o.greater(worst[demand.place], cost)
        return state._replace(monitors=tuple(monitors)), worst

    def charge(
        self, state: CostState, worst: Sequence[Tensor], violated: Sequence[Tensor]
    ) -> tuple[CostState, dict[str, Tensor]]:
        """The keys of the infos of a step.

        Args:
            state: What `take` gave.
            worst: What `take` gave.
            violated: 1 where each specification is violated, the reading of an end included.
        """
        if self._kind is None:
            return state, {}
        before = [state.charged[place] for place in range(state.charged.shape[0])]
        costs = keyed_costs(self._names, step_costs(self._kind, worst, violated, before))
        return state._replace(charged=self._o.stack(violated)) if before else state, costs

    def _cost(
        self, demand: Demand, reading: OnlineReading, instant: Tensor, zero: Tensor
    ) -> Tensor:
        """What it costs that an instant violates a demand; 0 where it does not."""
        value = reading.robustness
        charged = self._o.signbit(value) & ~self._o.isnan(value) & (instant >= demand.first)
        if demand.last is not None:
            charged = charged & (instant <= demand.last)
        return self._o.where(charged, zero + 1.0 if self._kind == "violation" else -value, zero)


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
