"""The cost of a step: what safe reinforcement learning sums over an episode.

A specification makes demands on instants of the episode, one for each of its conjuncts:

| conjunct | demands | at the instants |
|---|---|---|
| ``always(p)`` | p | all |
| ``always[a:b](p)`` | p | a to b |
| any other, p | p | the first |

With ``view="step"`` the whole formula is demanded at all instants; if it is ``always(p)``, p is.
Whether an instant t violates p is known at t + H, H being the horizon of p: the step that takes
this sample is charged.

| ``cost=`` | at a step |
|---|---|
| ``"violation"`` | 1 if it shows that an instant violates what is demanded of it |
| ``"depth"`` | how deep that violation is |
| ``"latched"`` | 1 from the step on at which the specification is violated, be it by the end |
| ``"first"`` | 1 at that step |

Of ``"violation"`` and ``"depth"`` the sample of a reset is no step and costs nothing, and so does
an instant that only the end of the episode settles. ``"latched"`` and ``"first"`` charge the
verdict on the specification: one that the sample of the reset decides at the first step, one that
only the end decides at the last. Under an interface-aware semantics a robustness of 0 costs
nothing: it may hang on a predicate that is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, SpecificationError
from rtamt_gym.judging.interface import EXACT
from rtamt_gym.libraries import library_of
from rtamt_gym.options.evaluation import Reading
from rtamt_gym.tables import shorten

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Floats, Lanes

__all__ = [
    "Cost",
    "CostMeter",
    "Demand",
    "VectorCostMeter",
    "demands_of",
    "keyed_costs",
    "measured_demands",
    "options_of_parts",
    "step_costs",
]

Cost = Literal["violation", "depth", "latched", "first"]
"""What ``info["cost"]`` measures."""

_V = TypeVar("_V")


@dataclass(frozen=True, slots=True)
class Demand:
    """What a specification demands of instants.

    Attributes:
        place: Place of the specification among the others.
        spec: The formula that is demanded, with the declarations of the specification.
        first: The first instant, as a number of samples.
        last: The last one; None if all further ones are meant.
    """

    place: int
    spec: rtamt.Specification
    first: int
    last: int | None


def demands_of(specs: Mapping[str, rtamt.Specification], reading: Reading) -> list[Demand]:
    """What the specifications demand of instants.

    Raises:
        SpecificationError: If a demand has a future without end.
    """
    demands = []
    for place, (name, spec) in enumerate(specs.items()):
        parts = [spec.formula] if reading.view == "step" else _conjuncts(spec.formula)
        # A named always(p), which a monitor would keep beside p, needs the whole future.
        unnamed = replace(spec, formulas={}, uses={})
        for part in parts:
            demand = _demand(place, unnamed.with_result(part), reading)
            if math.isinf(demand.spec.horizon):
                raise SpecificationError(
                    f"specification {name!r}: whether an instant violates "
                    f"{shorten(str(demand.spec.formula), 60)} is known at the end alone, for its "
                    "future has no end; give it bounds, such as eventually[0:5], or take "
                    'cost="latched"'
                )
            demands.append(demand)
    return demands


def _demand(place: int, spec: rtamt.Specification, reading: Reading) -> Demand:
    """What a conjunct demands: what is below its outer ``always``, at the instants of that."""
    first, last = 0, None if reading.view == "step" else 0
    while _is(spec.formula, "always"):
        begin, end = _instants(spec, reading)
        if last is None and end is not None:
            break  # a window of every instant is part of what is demanded of it
        first, last = first + begin, end
        (operand,) = _operands(spec.formula)
        spec = spec.with_result(operand)
        if end is not None:
            break
    return Demand(place, spec, first, last)


def _is(formula: rtamt.Formula, operator: str) -> bool:
    return formula.op is not None and formula.op.name == operator


def _operands(formula: rtamt.Formula) -> tuple[rtamt.Formula, ...]:
    return cast("tuple[rtamt.Formula, ...]", formula.args)  # of these operators they are formulas


def _conjuncts(formula: rtamt.Formula) -> Iterator[rtamt.Formula]:
    """The operands of the outermost conjunctions."""
    if not _is(formula, "and"):
        yield formula
        return
    for part in _operands(formula):
        yield from _conjuncts(part)


def _instants(spec: rtamt.Specification, reading: Reading) -> tuple[int, int | None]:
    """The instants that an outer ``always`` speaks of, as numbers of samples."""
    program = rtamt.EpisodeMonitor(spec, reading.period, align=reading.align).program
    if program.sources[program.result] is not spec.formula:  # always[0:0](p) is p
        return 0, 0
    window = program.window(program.result)
    return window.lo or 0, window.hi


class CostMeter:
    """The costs of the steps of one environment.

    Args:
        kind: What is measured.
        specs: Specifications by name.
        reading: How samples are judged.

    Raises:
        SpecificationError: As `demands_of` does.
        InputError: If the depth is asked for under a semantics that has none.
    """

    def __init__(
        self,
        kind: Cost,
        specs: Mapping[str, rtamt.Specification],
        reading: Reading,
    ) -> None:
        self._kind = kind
        self._exact = reading.semantics in EXACT
        self._demands = measured_demands(kind, specs, reading)
        options = options_of_parts(specs, [each.spec for each in self._demands], reading)
        self._monitors = [
            rtamt.Monitor(demand.spec, **option)
            for demand, option in zip(self._demands, options, strict=True)
        ]
        self._names = list(specs)
        self._worst = [0.0] * len(specs)
        self._charged: Sequence[bool] = [False] * len(specs)

    def reset(self) -> None:
        """Forgets the episode; `begin` forgets what its first sample costs."""
        for monitor in self._monitors:
            monitor.reset()
        self._charged = [False] * len(self._names)

    def begin(self) -> None:
        """Begins a step: forgets what the samples before it have cost."""
        self._worst = [0.0] * len(self._names)

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None] | None:
        """Makes the function that measures a sample; None if the verdicts tell the cost.

        Args:
            names: The names of the signals, in the order of the values that the function takes.
        """
        if not self._demands:
            return None
        parts = [
            (demand, monitor, [names.index(variable) for variable in monitor.variables])
            for demand, monitor in zip(self._demands, self._monitors, strict=True)
        ]

        def feed(values: Sequence[float]) -> None:
            for demand, monitor, places in parts:
                value = monitor.update(*[values[place] for place in places])
                instant = monitor.samples - 1 - monitor.latency
                if instant < demand.first or (demand.last is not None and instant > demand.last):
                    continue
                if value < 0.0 or (self._exact and value == 0.0 and not rtamt.holds(value)):
                    cost = 1.0 if self._kind == "violation" else -value
                    self._worst[demand.place] = max(self._worst[demand.place], cost)

        return feed

    def take(self, violated: Sequence[bool]) -> dict[str, np.float64]:
        """The costs of the step that ends, and of what comes the next begins.

        Args:
            violated: Whether each specification is violated, the reading of an end included.

        Returns:
            The keys of ``info``: ``cost``, and ``cost_NAME`` for each of several specifications.
        """
        costs = step_costs(self._kind, self._worst, violated, self._charged)
        self._charged = violated
        self.begin()
        return keyed_costs(self._names, [np.float64(cost) for cost in costs])


class VectorCostMeter:
    """The vector twin of `CostMeter`.

    It takes the number of environments too, and the names of the columns of the tables.
    """

    def __init__(
        self,
        kind: Cost,
        specs: Mapping[str, rtamt.Specification],
        num: int,
        reading: Reading,
        columns: Sequence[str],
    ) -> None:
        self._kind = kind
        self._exact = reading.semantics in EXACT
        self._names = list(specs)
        self._demands = measured_demands(kind, specs, reading)
        options = options_of_parts(specs, [each.spec for each in self._demands], reading)
        self._monitors = [
            rtamt.VectorMonitor(demand.spec, num, **option)
            for demand, option in zip(self._demands, options, strict=True)
        ]
        self._picks = [[columns.index(v) for v in m.variables] for m in self._monitors]
        self._worst = np.zeros((len(specs), num))
        self._charged = np.zeros((len(specs), num), np.bool_)

    def reset(self, lanes: Lanes | None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        for monitor in self._monitors:
            monitor.reset(lanes)
        which = slice(None) if lanes is None else lanes
        self._charged[:, which] = False

    def feed(self, table: Floats, lanes: Lanes | None) -> None:
        """Measures a sample of the environments of the mask; None: of all."""
        self._worst[:] = 0.0
        for demand, monitor, pick in zip(self._demands, self._monitors, self._picks, strict=True):
            value = monitor.update(table[:, pick], lanes)
            instant = monitor.samples - 1 - monitor.latency
            charged = np.signbit(value) if self._exact else value < 0.0
            charged &= instant >= demand.first
            if demand.last is not None:
                charged &= instant <= demand.last
            if lanes is not None:
                charged &= lanes
            row = self._worst[demand.place]
            cost = np.ones_like(value) if self._kind == "violation" else -value
            np.maximum(row, cost, out=row, where=charged)

    def take(self, violated: NDArray[np.bool_], stepped: Lanes | None) -> dict[str, Floats]:
        """The costs of a step, an array for each key, as `CostMeter.take` names them.

        Args:
            violated: Whether specifications are violated, shape (specifications, environments).
            stepped: The environments that made a step; None: all.
        """
        costs = step_costs(self._kind, self._worst.copy(), violated, self._charged)
        self._charged = violated.copy() if stepped is None else violated & stepped
        return keyed_costs(self._names, costs)


def step_costs(
    kind: Cost, worst: Iterable[Any], violated: Iterable[Any], charged: Iterable[Any]
) -> list[Any]:
    """The cost of a step by each specification, and last the whole.

    The arguments have a number or a truth value for each specification, or an array of them, of any
    library.

    Args:
        kind: What is measured.
        worst: What the demands have come to in the step.
        violated: Whether it is violated.
        charged: Whether it was before the step.
    """
    costs = list(worst)
    if kind in {"latched", "first"}:
        costs = [1.0 * now for now in violated]
    scalar = isinstance(costs[0], float)
    greatest: Callable[..., Any] = max if scalar else library_of(costs[0]).maximum
    whole = reduce(greatest, costs)
    if kind == "first":
        before = [1.0 * then for then in charged]
        whole = whole * (1.0 - reduce(greatest, before))
        costs = [cost * (1.0 - then) for cost, then in zip(costs, before, strict=True)]
    return [*costs, whole]


def measured_demands(
    kind: Cost, specs: Mapping[str, rtamt.Specification], reading: Reading
) -> list[Demand]:
    """The demands that are monitored; none where the verdicts tell the cost."""
    if kind == "depth" and reading.semantics == "boolean":
        raise InputError(
            'cost="depth" has no depth to measure under semantics="boolean", where a robustness '
            'is +inf or -inf; take cost="violation"'
        )
    return demands_of(specs, reading) if kind in {"violation", "depth"} else []


def options_of_parts(
    specs: Mapping[str, rtamt.Specification],
    parts: Sequence[rtamt.Specification],
    reading: Reading,
) -> list[dict[str, Any]]:
    """The keyword arguments of the monitors of parts of specifications."""
    # Beside the specifications, so that a part takes from their inputs and outputs what it knows.
    numbered = {str(number): part for number, part in enumerate(parts)}
    beside = {f"specification {name}": spec for name, spec in specs.items()}
    options = reading.of_monitors({**beside, **numbered})
    return [options[number] for number in numbered]


def keyed_costs(names: Sequence[str], costs: Sequence[_V]) -> dict[str, _V]:
    """The keys of ``info``, of what `step_costs` gives."""
    *each, whole = costs
    if len(names) == 1:
        return {"cost": whole}
    return {"cost": whole} | {f"cost_{n}": cost for n, cost in zip(names, each, strict=True)}
