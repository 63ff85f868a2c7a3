"""The monitors of several specifications in many environments, as pure functions of arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rtamt import Specification
from rtamt.program.instructions import Window
from rtamt.program.program import Program
from rtamt.typing import Align, Period
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.layout import BoundsReading, EpisodeState
from rtamt_arrays.online import OnlineMonitor, OnlineReading, OnlineState
from rtamt_arrays.operations import Operations, Tensor
from rtamt_gym.judging.costs import Cost, Demand, keyed_costs, measured_demands, step_costs
from rtamt_gym.judging.monitors import MonitorValues, make_monitors, monitors_of_parts
from rtamt_gym.options.evaluation import EvaluationOptions

NamedSample = Mapping[str, Tensor]
"""An array of shape (environments,) for each variable."""


class ArrayLibrary(NamedTuple):
    """The functions of an array library, for one dtype.

    Attributes:
        episode: The function ``episode`` of the library.
        online: The function ``online`` of the library.
        operations: The operations on its arrays.
    """

    episode: Callable[..., EpisodeArrays]
    online: Callable[..., OnlineMonitor]
    operations: Operations


class InstantState(NamedTuple):
    """The states of the two monitors of an `ArrayInstants`: of instants and of the episode."""

    newest: OnlineState
    sofar: EpisodeState


class ArrayInstants:
    """`rtamt_gym.judging.monitors.VectorInstantMonitor` as pure functions of arrays.

    Attributes:
        judge: The monitor of bounds and verdict of ``always(formula)`` on the same samples.
    """

    def __init__(
        self,
        library: ArrayLibrary,
        spec: Specification,
        period: Period | None,
        align: Align | None,
    ) -> None:
        self._o = library.operations
        self._newest = library.online(spec, period, align=align)
        self._sofar = library.episode(spec, period, align=align)
        self.judge = library.episode(spec.always(), period, align=align)

    def init(self, count: int) -> InstantState:
        """Return the state before the first sample."""
        return InstantState(self._newest.init(count), self._sofar.init(count))

    def reset(self, state: InstantState, mask: Tensor) -> InstantState:
        """Return the state in which the masked environments have no samples."""
        newest, sofar = state
        return InstantState(self._newest.reset(newest, mask), self._sofar.reset(sofar, mask))

    def begin(
        self, state: InstantState, sample: NamedSample, mask: Tensor
    ) -> tuple[InstantState, Tensor]:
        """Start the masked environments with a sample; return the robustness of its instant."""
        newest, reading = self._newest.begin(state.newest, sample, mask)
        sofar, episode = self._sofar.begin(state.sofar, sample, mask)
        return InstantState(newest, sofar), self._robustness(reading, episode)

    def update(self, state: InstantState, sample: NamedSample) -> tuple[InstantState, Tensor]:
        """Take a sample; return the robustness of the newest known instant."""
        newest, reading = self._newest.update(state.newest, sample)
        sofar, episode = self._sofar.update(state.sofar, sample)
        return InstantState(newest, sofar), self._robustness(reading, episode)

    def _robustness(self, reading: OnlineReading, episode: BoundsReading) -> Tensor:
        early = self._o.isnan(reading.robustness)
        return self._o.where(early, episode.robustness, reading.robustness)


class CostState(NamedTuple):
    """The state of `ArrayCosts`.

    Attributes:
        monitors: The state of the monitor of each demand.
        charged: With ``"first"``, a row for each specification: 1 where it was violated before the
            step.
    """

    monitors: tuple[OnlineState, ...]
    charged: Tensor


class ArrayCosts:
    """`rtamt_gym.judging.costs.VectorCostMeter` as pure functions of arrays.

    Attributes:
        keys: The keys of ``info``.
    """

    def __init__(
        self,
        kind: Cost | None,
        specs: Mapping[str, Specification],
        evaluation: EvaluationOptions,
        library: ArrayLibrary,
    ) -> None:
        self._kind = kind
        self._names = list(specs)
        self._o = library.operations
        self._demands = [] if kind is None else measured_demands(kind, specs, evaluation)
        parts = [demand.spec for demand in self._demands]

        def online(
            spec: Specification, *, period: Period | None, align: Align | None, **_: object
        ) -> OnlineMonitor:
            return library.online(spec, period, align=align)

        self._monitors = monitors_of_parts(specs, parts, evaluation, online)
        self.keys = frozenset[str]()
        if kind is not None:
            self.keys = frozenset(keyed_costs(self._names, [0.0] * (len(self._names) + 1)))

    def init(self, count: int, dtype: object) -> CostState:
        """Return the state before the first sample."""
        rows = len(self._names) if self._kind == "first" else 0
        monitors = tuple(monitor.init(count) for monitor in self._monitors)
        return CostState(monitors, self._o.full((rows, count), 0.0, dtype))

    def reset(self, state: CostState, mask: Tensor) -> CostState:
        """Return the state in which the masked environments have no samples."""
        monitors = _reset(self._monitors, state.monitors, mask)
        return CostState(monitors, self._o.where(mask, 0.0, state.charged))

    def begin(self, state: CostState, sample: NamedSample, mask: Tensor) -> CostState:
        """Start the masked environments with a sample, which costs nothing."""
        monitors, _ = _begin(self._monitors, state.monitors, sample, mask)
        return CostState(monitors, self._o.where(mask, 0.0, state.charged))

    def update(
        self, state: CostState, sample: NamedSample, number: Tensor, zero: Tensor
    ) -> tuple[CostState, list[Tensor]]:
        """Take sample ``number``; return the largest cost of each specification."""
        monitors, worst = [], [zero] * len(self._names)
        triples = zip(self._demands, self._monitors, state.monitors, strict=True)
        for demand, monitor, before in triples:
            following, reading = monitor.update(before, sample)
            monitors.append(following)
            cost = self._cost(demand, reading.robustness, number - monitor.latency, zero)
            worst[demand.place] = self._o.greater(worst[demand.place], cost)
        return state._replace(monitors=tuple(monitors)), worst

    def charge(
        self, state: CostState, worst: Sequence[Tensor], violated: Sequence[Tensor]
    ) -> tuple[CostState, dict[str, Tensor]]:
        """Return the state after a step, and its keys of ``info``.

        Args:
            state: The state that `update` returned.
            worst: The costs that `update` returned.
            violated: For each specification, 1 where it is violated, also at the end of an episode.
        """
        if self._kind is None:
            return state, {}
        before = [state.charged[index] for index in range(state.charged.shape[0])]
        costs = keyed_costs(self._names, step_costs(self._kind, worst, violated, before))
        return state._replace(charged=self._o.stack(violated)) if before else state, costs

    def _cost(self, demand: Demand, robustness: Tensor, instant: Tensor, zero: Tensor) -> Tensor:
        """Return the cost of an instant: 0 where the demand is satisfied."""
        o = self._o
        charged = o.signbit(robustness) & ~o.isnan(robustness) & (instant >= demand.first)
        if demand.last is not None:
            charged = charged & (instant <= demand.last)
        return o.where(charged, zero + 1.0 if self._kind == "violation" else -robustness, zero)


class MonitorSetState(NamedTuple):
    """The state of an `ArrayMonitorSet`.

    Attributes:
        judges: The state of the judge of each specification.
        instants: With ``view="step"``, the state of each monitor of instants.
        costs: The state of the costs.
        held: The last value of each variable of ``nan="hold"``.
    """

    judges: tuple[EpisodeState, ...]
    instants: tuple[InstantState, ...]
    costs: CostState
    held: tuple[Tensor, ...]


class MonitorSetUpdate(NamedTuple):
    """The result of a sample.

    Attributes:
        state: The next state.
        readings: The reading of each judge.
        cut: The reading of each judge if the trace is cut after the sample.
        instants: With ``view="step"``, the robustness of the newest known instant of each
            specification.
        worst: The largest cost of each specification.
    """

    state: MonitorSetState
    readings: Sequence[BoundsReading]
    cut: Sequence[BoundsReading]
    instants: Sequence[Tensor]
    worst: Sequence[Tensor]


class ArrayMonitorSet:
    """`rtamt_gym.judging.vector_monitor_set` as pure functions of arrays.

    Attributes:
        latencies: The number of samples after the first that each judge reads; None for all.
        cost_keys: The keys of ``info`` with costs.
    """

    def __init__(
        self,
        specs: Mapping[str, Specification],
        evaluation: EvaluationOptions,
        cost: Cost | None,
        held: Sequence[str],
        library: ArrayLibrary,
    ) -> None:
        def episode(
            spec: Specification, *, period: Period | None, align: Align | None, **_: object
        ) -> EpisodeArrays:
            return library.episode(spec, period, align=align)

        def instants(
            spec: Specification, *, period: Period | None, align: Align | None, **_: object
        ) -> ArrayInstants:
            return ArrayInstants(library, spec, period, align)

        self._o = library.operations
        pairs = make_monitors(specs, evaluation, episode, instants).values()
        self._judges: list[EpisodeArrays] = [judge for _, judge in pairs]
        self._instants: list[ArrayInstants] = []
        if evaluation.view == "step":
            self._instants = [source for source, _ in pairs]
        self._ends = evaluation.at_termination or "complete", evaluation.at_truncation
        self._cuts = [
            "cut" in self._ends and _reads_past_the_end(judge.program) for judge in self._judges
        ]
        self.latencies = tuple(judge.program.latency for judge in self._judges)
        self._costs = ArrayCosts(cost, specs, evaluation, library)
        self.cost_keys = self._costs.keys
        self._held = held

    def init(self, count: int) -> MonitorSetState:
        """Return the state before the first sample."""
        judges = tuple(judge.init(count) for judge in self._judges)
        instants = tuple(source.init(count) for source in self._instants)
        dtype = judges[0].rows.dtype
        held = tuple(self._o.full((count,), math.nan, dtype) for _ in self._held)
        return MonitorSetState(judges, instants, self._costs.init(count, dtype), held)

    def reset(self, state: MonitorSetState, mask: Tensor) -> MonitorSetState:
        """Return the state in which the masked environments have no samples."""
        return MonitorSetState(
            _reset(self._judges, state.judges, mask),
            _reset(self._instants, state.instants, mask),
            self._costs.reset(state.costs, mask),
            tuple(self._o.where(mask, math.nan, last) for last in state.held),
        )

    def begin(self, state: MonitorSetState, sample: NamedSample, mask: Tensor) -> MonitorSetUpdate:
        """Start the masked environments with a sample; the other environments take no sample."""
        judges, readings = _begin(self._judges, state.judges, sample, mask)
        instants, robustness = _begin(self._instants, state.instants, sample, mask)
        costs = self._costs.begin(state.costs, sample, mask)
        held = tuple(
            self._o.where(mask, self._o.as_kind_of(sample[name], last), last)
            for name, last in zip(self._held, state.held, strict=True)
        )
        following = MonitorSetState(judges, instants, costs, held)
        return MonitorSetUpdate(following, readings, readings, robustness, [])

    def update(
        self, state: MonitorSetState, sample: NamedSample, number: Tensor
    ) -> MonitorSetUpdate:
        """Take sample ``number`` in every environment."""
        held = []
        for name, last in zip(self._held, state.held, strict=True):
            value = self._o.as_kind_of(sample[name], last)
            held.append(self._o.where(self._o.isnan(value), last, value))
        sample = {**sample, **dict(zip(self._held, held, strict=True))}
        results = []
        for judge, before, cuts in zip(self._judges, state.judges, self._cuts, strict=True):
            if cuts:
                results.append(judge.update_and_cut(before, sample))
            else:
                following, reading = judge.update(before, sample)
                results.append((following, reading, self._complete(reading)))
        judges, readings, cut = zip(*results, strict=True)
        pairs = [
            source.update(before, sample)
            for source, before in zip(self._instants, state.instants, strict=True)
        ]
        zero = self._zero(readings[0].upper)
        costs, worst = self._costs.update(state.costs, sample, number, zero)
        instants = tuple(before for before, _ in pairs)
        state = MonitorSetState(judges, instants, costs, tuple(held))
        return MonitorSetUpdate(
            state, readings, cut, [robustness for _, robustness in pairs], worst
        )

    def values(
        self, update: MonitorSetUpdate, samples: Tensor, terminated: Tensor, truncated: Tensor
    ) -> MonitorValues[Any]:
        """Return the values of the monitors.

        Args:
            update: The result of `begin` or `update`.
            samples: The number of samples of each environment since its reset.
            terminated: Where the environment has terminated the episode.
            truncated: Where a time limit has ended the episode.
        """
        ends = (terminated, self._ends[0]), (truncated & ~terminated, self._ends[1])
        pairs = zip(update.readings, update.cut, strict=True)
        readings = [self._at_end(reading, cut, ends) for reading, cut in pairs]
        judged = [reading.robustness for reading in readings]
        return MonitorValues(
            list(update.instants) or judged,
            judged,
            [reading.lower for reading in readings],
            [reading.upper for reading in readings],
            [reading.verdict for reading in readings],
            samples,
        )

    def charge(
        self, update: MonitorSetUpdate, values: MonitorValues[Any]
    ) -> tuple[MonitorSetState, dict[str, Tensor]]:
        """Return the state after a step, and the keys of its ``info`` with costs."""
        zero = self._zero(values.upper[0])
        violated = [self._o.where(verdict < 0, zero + 1.0, zero) for verdict in values.verdicts]
        costs, keys = self._costs.charge(update.state.costs, update.worst, violated)
        return update.state._replace(costs=costs), keys

    def no_costs(self, values: MonitorValues[Any]) -> dict[str, Tensor]:
        """Return the keys of the ``info`` of a reset with costs, which are 0."""
        return dict.fromkeys(self.cost_keys, self._zero(values.upper[0]))

    def _zero(self, like: Tensor) -> Tensor:
        return self._o.full(tuple(like.shape), 0.0, like.dtype)

    def _at_end(
        self, reading: BoundsReading, cut: BoundsReading, ends: Sequence[tuple[Tensor, str]]
    ) -> BoundsReading:
        """Return the reading, with the end mode applied where an episode has ended."""
        result = reading
        for mask, end in ends:
            if end in {"complete", "cut"}:
                at_end = self._complete(reading) if end == "complete" else cut
                pairs = zip(at_end, result, strict=True)
                result = BoundsReading(*(self._o.where(mask, *pair) for pair in pairs))
            elif end == "failure":
                failed = mask & (reading.verdict == 0)
                upper = self._o.where(failed, -0.0, result.upper)
                verdict = self._o.where(failed, result.verdict * 0 - 1, result.verdict)
                result = result._replace(upper=upper, verdict=verdict)
        return result

    def _complete(self, reading: BoundsReading) -> BoundsReading:
        """Return the reading of a complete trace; after a nan it stays undecided."""
        o, known = self._o, ~reading.nan
        sign = 1 - 2 * o.as_integers(o.signbit(reading.robustness))
        return reading._replace(
            lower=o.where(known, reading.robustness, reading.lower),
            upper=o.where(known, reading.robustness, reading.upper),
            verdict=o.where(known, sign, reading.verdict),
        )


def _reset(monitors: Sequence[Any], states: Sequence[Any], mask: Tensor) -> tuple[Any, ...]:
    """Reset the masked environments of several monitors."""
    pairs = zip(monitors, states, strict=True)
    return tuple(monitor.reset(state, mask) for monitor, state in pairs)


def _begin(
    monitors: Sequence[Any], states: Sequence[Any], sample: NamedSample, mask: Tensor
) -> tuple[tuple[Any, ...], list[Any]]:
    """Start the masked environments of several monitors; return their states and readings."""
    pairs = zip(monitors, states, strict=True)
    results = [monitor.begin(state, sample, mask) for monitor, state in pairs]
    return tuple(state for state, _ in results), [reading for _, reading in results]


def _reads_past_the_end(program: Program) -> bool:
    """Return whether a window can extend past an end, so that cut and complete traces differ."""
    windows = [step for step in program.instructions if isinstance(step, Window)]
    return any(step.lo != 0 if step.hi is None else step.hi > 0 for step in windows)
