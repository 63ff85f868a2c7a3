"""The cost of a step, which safe reinforcement learning sums over an episode.

Each conjunct of a specification demands something at instants of the episode:

| conjunct | demands | at the instants |
|---|---|---|
| ``always(p)`` | p | all |
| ``always[a:b](p)`` | p | a to b |
| any other, p | p | the first |

With ``view="step"``, the formula is demanded at all instants; for ``always(p)``, p. Whether an
instant t violates p is known at t + H, where H is the horizon of p; the step of this sample costs.

| ``cost=`` | at a step |
|---|---|
| ``"violation"`` | 1 if the step shows that an instant violates a demand |
| ``"depth"`` | the depth of that violation |
| ``"latched"`` | 1 from the step of the violation on, even for a violation by the end |
| ``"first"`` | 1 at that step |

For ``"violation"`` and ``"depth"``, the sample of a reset costs nothing, and neither does an
instant that only the end of the episode decides. ``"latched"`` and ``"first"`` depend on the
verdict: they cost at the first step if the sample of the reset decides it, and at the last step if
the end does. Under an interface-aware semantics, a robustness of 0 costs nothing, because it may
come from an omitted predicate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, Monitor, Specification, SpecificationError, VectorMonitor
from rtamt_gym.judging.formulas import operands, operator_of
from rtamt_gym.judging.monitors import EXACT, bare, columns_of, monitors_of_parts, update_of
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.shaping import library_of
from rtamt_gym.tables import shorten

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Entries, Floats

Cost = Literal["violation", "depth", "latched", "first"]
"""What ``info["cost"]`` measures."""

_V = TypeVar("_V")
_M = TypeVar("_M", Monitor, VectorMonitor)


@dataclass(frozen=True, slots=True)
class Demand:
    """A demand of a specification on instants.

    Attributes:
        place: The index of the specification.
        spec: The formula, with the declarations of the specification.
        first: The first instant, in samples.
        last: The last instant; None without one.
    """

    place: int
    spec: Specification
    first: int
    last: int | None


def demands_of(specs: Mapping[str, Specification], reading: EvaluationOptions) -> list[Demand]:
    """Return the demands of specifications; raise SpecificationError for an unbounded future."""
    demands = []
    for index, (name, spec) in enumerate(specs.items()):
        parts = [spec.formula] if reading.view == "step" else _conjuncts(spec.formula)
        for part in parts:
            demand = _demand(index, bare(spec, part), reading)
            if math.isinf(demand.spec.horizon):
                raise SpecificationError(
                    f"specification {name!r}: whether an instant violates "
                    f"{shorten(str(demand.spec.formula), 60)} is known only at the end, because "
                    "its future has no end; give it bounds, such as eventually[0:5], or use "
                    'cost="latched"'
                )
            demands.append(demand)
    return demands


def _demand(place: int, spec: Specification, reading: EvaluationOptions) -> Demand:
    """Return the demand of a conjunct: the operand of its outer ``always``, and the instants."""
    first, last = 0, None if reading.view == "step" else 0
    while operator_of(spec.formula) == "always":
        begin, end = _instants(spec, reading)
        if last is None and end is not None:
            break  # a window of every instant is part of the demand
        first, last = first + begin, end
        (operand,) = operands(spec.formula)
        spec = spec.with_result(operand)
        if end is not None:
            break
    return Demand(place, spec, first, last)


def _conjuncts(formula: rtamt.Formula) -> Iterator[rtamt.Formula]:
    """Yield the operands of the outermost conjunctions."""
    if operator_of(formula) != "and":
        yield formula
        return
    for part in operands(formula):
        yield from _conjuncts(part)


def _instants(spec: Specification, reading: EvaluationOptions) -> tuple[int, int | None]:
    """Return the window of an outer ``always``, in samples."""
    program = rtamt.EpisodeMonitor(spec, reading.period, align=reading.align).program
    if program.sources[program.result] is not spec.formula:  # always[0:0](p) is p
        return 0, 0
    window = program.window(program.result)
    return window.lo or 0, window.hi


class _Costs(Generic[_M]):
    """The demands of specifications, each with its monitor."""

    def __init__(
        self,
        kind: Cost,
        specs: Mapping[str, Specification],
        reading: EvaluationOptions,
        make: Callable[..., _M],
    ) -> None:
        self._kind, self._names = kind, list(specs)
        self._exact = reading.semantics in EXACT
        self._demands = measured_demands(kind, specs, reading)
        parts = [demand.spec for demand in self._demands]
        self._monitors: list[_M] = monitors_of_parts(specs, parts, reading, make)


class CostMeter(_Costs[Monitor]):
    """The costs of steps of one environment, in floats, because arrays would take 20 us a step."""

    def __init__(
        self, kind: Cost, specs: Mapping[str, Specification], reading: EvaluationOptions
    ) -> None:
        super().__init__(kind, specs, reading, Monitor)
        self._worst = [0.0] * len(specs)
        self._charged: Sequence[bool] = [False] * len(specs)

    def reset(self) -> None:
        """Forget the episode; `begin` forgets the cost of its first sample."""
        for monitor in self._monitors:
            monitor.reset()
        self._charged = [False] * len(self._names)

    def begin(self) -> None:
        """Start a step: forget the cost of the samples before it."""
        self._worst = [0.0] * len(self._names)

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None] | None:
        """Return the function that measures a sample; None if verdicts determine the cost."""
        if not self._demands:
            return None
        parts = [
            (demand, monitor, update_of(monitor, names))
            for demand, monitor in zip(self._demands, self._monitors, strict=True)
        ]

        def feed(values: Sequence[float]) -> None:
            for demand, monitor, update in parts:
                value = update(values)
                instant = monitor.samples - 1 - monitor.latency
                if instant < demand.first or (demand.last is not None and instant > demand.last):
                    continue
                if value < 0.0 or (self._exact and value == 0.0 and not rtamt.holds(value)):
                    cost = 1.0 if self._kind == "violation" else -value
                    self._worst[demand.place] = max(self._worst[demand.place], cost)

        return feed

    def take(self, violated: Sequence[bool]) -> dict[str, np.float64]:
        """Return the costs of the step, as keys of ``info``, and start the next step."""
        costs = step_costs(self._kind, self._worst, violated, self._charged)
        self._charged = violated
        self.begin()
        return keyed_costs(self._names, [np.float64(cost) for cost in costs])


class VectorCostMeter(_Costs[VectorMonitor]):
    """The costs of steps of a batch of environments; `columns` names the columns of the tables."""

    def __init__(
        self,
        kind: Cost,
        specs: Mapping[str, Specification],
        num: int,
        reading: EvaluationOptions,
        columns: Sequence[str],
    ) -> None:
        super().__init__(kind, specs, reading, partial(VectorMonitor, num=num))
        self._picks = [columns_of(monitor, columns) for monitor in self._monitors]
        self._worst = np.zeros((len(specs), num))
        self._charged = np.zeros((len(specs), num), np.bool_)

    def reset(self, entries: Entries | None) -> None:
        for monitor in self._monitors:
            monitor.reset(entries)
        which = slice(None) if entries is None else entries
        self._charged[:, which] = False

    def feed(self, table: Floats, entries: Entries | None) -> None:
        """Measure a sample of the environments in the mask; None: of all."""
        self._worst[:] = 0.0
        for demand, monitor, pick in zip(self._demands, self._monitors, self._picks, strict=True):
            value = monitor.update(table[:, pick], entries)
            instant = monitor.samples - 1 - monitor.latency
            charged = np.signbit(value) if self._exact else value < 0.0
            charged &= instant >= demand.first
            if demand.last is not None:
                charged &= instant <= demand.last
            if entries is not None:
                charged &= entries
            row = self._worst[demand.place]
            cost = np.ones_like(value) if self._kind == "violation" else -value
            np.maximum(row, cost, out=row, where=charged)

    def take(self, violated: NDArray[np.bool_], stepped: Entries | None) -> dict[str, Floats]:
        """Return the costs of a step of the environments ``stepped``, an array for each key."""
        costs = step_costs(self._kind, self._worst.copy(), violated, self._charged)
        self._charged = violated.copy() if stepped is None else violated & stepped
        return keyed_costs(self._names, costs)


def step_costs(
    kind: Cost, worst: Iterable[Any], violated: Iterable[Any], charged: Iterable[Any]
) -> list[Any]:
    """Return the cost of a step for each specification, and the total last.

    The arguments have a number, a truth value or an array of any library for each specification:
    the maximum cost of its demands, whether it is violated, and whether it was before the step.
    """
    costs = list(worst)
    if kind in {"latched", "first"}:
        costs = [1.0 * now for now in violated]
    scalar = isinstance(costs[0], float)
    greatest: Callable[..., Any] = max if scalar else library_of(costs[0]).maximum
    total = reduce(greatest, costs)
    if kind == "first":
        before = [1.0 * then for then in charged]
        total = total * (1.0 - reduce(greatest, before))
        costs = [cost * (1.0 - then) for cost, then in zip(costs, before, strict=True)]
    return [*costs, total]


def measured_demands(
    kind: Cost, specs: Mapping[str, Specification], reading: EvaluationOptions
) -> list[Demand]:
    """Return the demands that need monitors; an empty list if verdicts determine the cost."""
    if kind == "depth" and reading.semantics == "boolean":
        raise InputError(
            'cost="depth" has no depth to measure under semantics="boolean", where a robustness '
            'is +inf or -inf; use cost="violation"'
        )
    return demands_of(specs, reading) if kind in {"violation", "depth"} else []


def keyed_costs(names: Sequence[str], costs: Sequence[_V]) -> dict[str, _V]:
    """Return the keys of ``info`` for the result of `step_costs`."""
    *parts, total = costs
    if len(names) == 1:
        return {"cost": total}
    return {"cost": total} | {f"cost_{n}": cost for n, cost in zip(names, parts, strict=True)}
