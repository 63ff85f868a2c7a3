"""Pending obligations: the temporal operators inside a specification, and their clocks.

Robustness and bounds are about the whole formula. They do not show the age of an unanswered
request, or for how long a goal has held that must hold for five seconds. The operators below the
top show this; their values count at many instants, which the formula around them determines:

| position | instants |
|---|---|
| below no other temporal operator | the first |
| below ``always`` or another temporal operator | every instant |
| ``p implies it``, ``not p or it`` below ``always`` | instants where p holds |
| ``p and it`` below ``eventually`` | instants where p holds |
| ``p iff it``, ``p xor it`` below either | instants where p holds; and where p fails, negated or \
not |
| ``next it`` | one instant later |

p is a formula without a future; a p that looks ahead does not restrict the instants. Below
``always`` every instant counts, below ``eventually`` one is enough, and ``not`` exchanges the two.
Therefore, an operator has one clock of three kinds, a fraction of its window:

| clock | of | 0 | 1 |
|---|---|---|---|
| ``"oldest"`` | operators that must come true (``eventually``, ``until`` below ``always``) or \
must last (``always``, ``unless`` below ``eventually``) | nothing is pending | overdue; done |
| ``"newest"`` | operators that must last (``always``, ``unless`` below ``always``) or may come \
true (``eventually``, ``until`` below ``eventually``) | nothing is pending | just triggered |
| ``"last"`` | the past: ``once``, ``since``, ``historically``, ``prev``, ``rise``, ``fall`` | \
the operand holds now (``historically``: fails) | longer ago than the window, or never |

`rtamt.internal.OperatorClocks` defines how each counts. The margin of an operand is its newest
known robustness, 0 before the first.

To add a clock or the place of an operator in a formula: the instants here, the clock in
`rtamt.machines.clocks` and ``rtamt/native/batch/clocks.cpp``.
``tests/support/obligations_oracle.py`` defines obligations again, and
``tests/rtamt_gym/judging/test_obligations.py`` lists the formulas that the oracle covers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

import rtamt
from rtamt import Formula, Monitor, Specification, VectorMonitor
from rtamt.internal import ClockEvent, ClockKind, OperatorClock, OperatorClocks
from rtamt_gym.judging.formulas import looks_ahead, operands, operator_of
from rtamt_gym.judging.monitors import Owed, bare, columns_of, monitors_of_parts, update_of
from rtamt_gym.options.evaluation import EvaluationOptions

if TYPE_CHECKING:
    from rtamt_gym.signals.columns import Entries, Floats

_M = TypeVar("_M", Monitor, VectorMonitor)

_PAST = {"once", "historically", "since", "prev", "s_prev", "rise", "fall"}
_FUTURE = {"eventually", "always", "until", "unless", "next", "s_next"}
_MUST_LAST = {"always", "unless", "next"}
_NEIGHBOURS = {"next", "s_next", "prev", "s_prev", "rise", "fall"}


class Instants(Enum):
    """Instants that need no formula."""

    EVERY = "every"
    FIRST = "first"


@dataclass(frozen=True, slots=True)
class Obligation:
    """A temporal operator below the top of a specification.

    Attributes:
        formula: The operator with its operands.
        kind: The kind of its clock.
        begin: The start of its window, in samples.
        end: The end of its window; None if it is unbounded.
        instants: Where its value counts: where a formula without a future holds, or `Instants`.
    """

    formula: Formula
    kind: ClockKind
    begin: int
    end: int | None
    instants: Formula | Instants

    @property
    def name(self) -> str:
        return operator_of(self.formula)

    @property
    def operands(self) -> tuple[Formula, ...]:
        return operands(self.formula)

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The formulas that its clock reads."""
        return (
            self.operands
            if isinstance(self.instants, Instants)
            else (*self.operands, self.instants)
        )


def obligations_of(spec: Specification, reading: EvaluationOptions) -> list[Obligation]:
    """Return the temporal operators below the outermost one, in the order of the text.

    An operand with an unbounded future is never known, so its operator is left out.
    """
    top = spec.formula
    while operator_of(top) == "not":
        (top,) = operands(top)
    operators = dict.fromkeys(_operators_in(top, universal=True, instants=Instants.FIRST))
    obligations = []
    for formula, universal, instants in operators:
        if formula is top or any(math.isinf(bare(spec, p).horizon) for p in operands(formula)):
            continue
        kind: ClockKind = "newest"
        if operator_of(formula) in _PAST:
            kind = "last"
        elif instants is Instants.FIRST or universal is not (operator_of(formula) in _MUST_LAST):
            kind = "oldest"
        obligations.append(Obligation(formula, kind, *_window(spec, formula, reading), instants))
    return list(dict.fromkeys(obligations))


_PlacedOperator = tuple[Formula, bool, Formula | Instants]
"""An operator, whether every one of its instants counts, and these instants."""


def _operators_in(
    node: Formula, *, universal: bool, instants: Formula | Instants
) -> Iterator[_PlacedOperator]:
    """Yield the temporal operators of a formula."""
    if not any(operator_of(part) in _PAST | _FUTURE for part in node.nodes()):
        return
    name, parts = operator_of(node), operands(node)
    match name:
        case "not":
            yield from _operators_in(parts[0], universal=not universal, instants=instants)
        case "and" | "or":
            for part in parts:
                others = [other for other in parts if other is not part and not looks_ahead(other)]
                if universal is not (name == "or"):
                    others = []  # the part counts whatever they are
                elif name == "or":
                    others = [_negated(other) for other in others]
                narrowed = _narrowed(instants, others)
                yield from _operators_in(part, universal=universal, instants=narrowed)
        case "implies":
            equal = rtamt.disjunction((~parts[0], parts[1]))
            yield from _operators_in(equal, universal=universal, instants=instants)
        case "iff" | "xor":
            left, right = parts
            right = right if name == "iff" else ~right
            # among equal formulas, choose one with parts that name the instants of the other side
            equal = (left & right) | (~left & ~right)
            if universal:
                equal = left.implies(right) & (~left).implies(~right)
            yield from _operators_in(equal, universal=universal, instants=instants)
        case _:
            yield node, universal, instants
            yield from _operators_below(node, universal=universal, instants=instants)


def _operators_below(
    node: Formula, *, universal: bool, instants: Formula | Instants
) -> Iterator[_PlacedOperator]:
    """Yield the temporal operators in the operands of one."""
    name, parts = operator_of(node), operands(node)
    # The first operand of until must last, the second must come to pass.
    below = [name in {"always", "historically"}] if len(parts) == 1 else [True, False]
    if name in _NEIGHBOURS:
        below = [universal]
    later = _later(instants) if name in {"next", "s_next"} else Instants.EVERY
    for part, all_count in zip(parts, below, strict=True):
        yield from _operators_in(part, universal=all_count, instants=later)


def _narrowed(instants: Formula | Instants, conditions: Iterable[Formula]) -> Formula | Instants:
    """Return the instants where these conditions hold too."""
    conditions = list(conditions)
    if instants is Instants.FIRST or not conditions:
        return instants
    return rtamt.conjunction(
        conditions if isinstance(instants, Instants) else [instants, *conditions]
    )


def _negated(formula: Formula) -> Formula:
    return operands(formula)[0] if operator_of(formula) == "not" else ~formula


def _later(instants: Formula | Instants) -> Formula:
    """Return the instants one sample later."""
    if isinstance(instants, Instants):
        every = rtamt.parse("true").formula
        instants = every if instants is Instants.EVERY else ~every.prev(strong=True)
    return instants.prev(strong=True)


def _window(
    spec: Specification, formula: Formula, reading: EvaluationOptions
) -> tuple[int, int | None]:
    """Return the window of an operator, in samples."""
    if operator_of(formula) in _NEIGHBOURS:
        return 1, 1
    if formula.interval is None:
        return 0, None
    # the same window over a predicate that no rule simplifies
    text = f"eventually{formula.interval}({spec.variables[0]} > 0)"
    equal_formula = rtamt.parse(text, unit=spec.unit).formula
    program = rtamt.EpisodeMonitor(
        bare(spec, equal_formula), reading.period, align=reading.align
    ).program
    if program.sources[program.result] is not equal_formula:  # eventually[0:0](p) is p
        return 0, 0
    window = program.window(program.result)
    return window.lo or 0, window.hi


class _Obligations(Generic[_M]):
    """The clocks of the judged specifications; ``found`` are the operators of each."""

    def __init__(
        self,
        judged: Mapping[str, Specification],
        reading: EvaluationOptions,
        make: Callable[..., _M],
        num: int = 1,
    ) -> None:
        self.found: list[list[Obligation]] = [
            obligations_of(spec, reading) for spec in judged.values()
        ]
        parts: dict[tuple[int, Formula], Specification] = {
            (index, part): bare(spec, part)
            for index, (spec, obligations) in enumerate(
                zip(judged.values(), self.found, strict=True)
            )
            for obligation in obligations
            for part in obligation.parts
        }
        self._monitors: list[_M] = monitors_of_parts(judged, [*parts.values()], reading, make)
        places = {key: index for index, key in enumerate(parts)}
        late = [monitor.latency for monitor in self._monitors]
        clocks = [
            _clock_of(obligation, [places[index, part] for part in obligation.parts], late)
            for index, obligations in enumerate(self.found)
            for obligation in obligations
        ]
        self._clocks = OperatorClocks(clocks, len(parts), num)

    def _owed(self, clocks: Iterable[Any], margins: Iterable[Any]) -> list[list[Owed]]:
        """Return the state of each operator, from rows of all clocks and all operands."""
        rows, values = iter(clocks), iter(margins)
        return [
            [
                Owed(next(rows), tuple([next(values) for _ in obligation.operands]))
                for obligation in obligations
            ]
            for obligations in self.found
        ]


class Obligations(_Obligations[VectorMonitor]):
    """The clocks of a batch of environments; `columns` names the columns of the tables."""

    def __init__(
        self,
        judged: Mapping[str, Specification],
        num: int,
        reading: EvaluationOptions,
        columns: Sequence[str],
    ) -> None:
        super().__init__(judged, reading, partial(VectorMonitor, num=num), num)
        self._picks = [columns_of(monitor, columns) for monitor in self._monitors]
        self._values: Floats = np.empty((len(self._monitors), num))

    def reset(self, entries: Entries | None = None) -> None:
        for monitor in self._monitors:
            monitor.reset(entries)
        self._clocks.reset(entries)

    def feed(self, table: Floats, entries: Entries | None = None) -> None:
        """Take a row of the table for each environment in the mask; None: for all."""
        for index, monitor in enumerate(self._monitors):
            self._values[index] = monitor.update(table[:, self._picks[index]], entries)
        self._clocks.feed(self._values, entries)

    def owed(self) -> list[list[Owed]]:
        """Return the state of every operator of each specification, in new arrays."""
        return self._owed(self._clocks.fractions, self._clocks.margins)


class SingleObligations(_Obligations[Monitor]):
    """The clocks of one environment."""

    def __init__(self, judged: Mapping[str, Specification], reading: EvaluationOptions) -> None:
        super().__init__(judged, reading, Monitor)

    def reset(self) -> None:
        for monitor in self._monitors:
            monitor.reset()
        self._clocks.reset()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        """Return the update function for samples with values in the order of these names."""
        updates = [update_of(monitor, names) for monitor in self._monitors]
        take = self._clocks.feed
        if not updates:
            return lambda _: None
        return lambda values: take([[update(values)] for update in updates])

    def owed(self) -> list[list[Owed]]:
        """Return the state of every operator of each specification."""
        clocks = self._clocks
        return self._owed(clocks.fractions[:, 0].tolist(), clocks.margins[:, 0].tolist())


_FAIL = {"always", "next", "historically", "fall"}
"""The operators whose clocks count from where their operand fails."""


def _event_of(obligation: Obligation) -> ClockEvent:
    match obligation.name:
        case "until" | "unless" | "since" as two:
            return two
        case name:
            return "fails" if name in _FAIL else "holds"


def _clock_of(
    obligation: Obligation, parts: Sequence[int], latencies: Sequence[int]
) -> OperatorClock:
    """Return the clock of an operator; ``parts`` are its formulas, the operands first."""
    operands = parts[: len(obligation.operands)]
    late = max(latencies[part] for part in operands)
    instants = obligation.instants
    return OperatorClock(
        obligation.kind,
        _event_of(obligation),
        obligation.begin + late,
        None if obligation.end is None else obligation.end + late,
        late,
        tuple((part, late - latencies[part]) for part in operands),
        None if isinstance(instants, Instants) else parts[-1],
        instants is Instants.FIRST,
    )
