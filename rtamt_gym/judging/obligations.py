"""Pending obligations: the temporal operators inside a specification, and their clocks.

A robustness and its bounds are about the formula. They do not show how old an unanswered request
is, or how long a goal has been held that must be held for five seconds. The operators below the top
show this; their values count at many instants. The formula around an operator determines these
instants:

| position | instants |
|---|---|
| below no other temporal operator | the first |
| below ``always`` or another temporal operator | every instant |
| ``p implies it``, ``not p or it`` below ``always`` | the instants at which p holds |
| ``p and it`` below ``eventually`` | the instants at which p holds |
| ``p iff it``, ``p xor it`` below either | the instants at which p holds; and, negated or not, \
those at which it does not |
| ``next it`` | one instant later |

p is a formula without a future; a p that looks ahead narrows nothing. Below ``always`` every such
instant counts, below ``eventually`` one is enough, and ``not`` exchanges the two. So an operator
has one of three clocks, each a fraction of its window:

| clock | of | 0 | 1 |
|---|---|---|---|
| ``"oldest"`` | what must come to pass (``eventually``, ``until`` below ``always``), and what \
must last (``always``, ``unless`` below ``eventually``) | nothing is pending | overdue; done |
| ``"newest"`` | what must last (``always``, ``unless`` below ``always``), and what may come to \
pass (``eventually``, ``until`` below ``eventually``) | nothing is pending | just triggered |
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
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np

import rtamt
from rtamt import Formula, Monitor, Specification, VectorMonitor
from rtamt.internal import ClockEvent, ClockKind, OperatorClock, OperatorClocks
from rtamt_gym.judging.monitors import Owed, bare, options_of_parts, pick, picked
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
        asked: The instants where its value counts: where a formula without a future holds, or a
            member of `Instants`.
    """

    formula: Formula
    kind: ClockKind
    begin: int
    end: int | None
    asked: Formula | Instants

    @property
    def name(self) -> str:
        return _name(self.formula)

    @property
    def operands(self) -> tuple[Formula, ...]:
        return _parts(self.formula)

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The formulas that its clock reads."""
        return self.operands if isinstance(self.asked, Instants) else (*self.operands, self.asked)


def obligations_of(spec: Specification, reading: EvaluationOptions) -> list[Obligation]:
    """Return the temporal operators below the outermost one, in the order of the text.

    An operator is left out if its operand has an unbounded future, because the operand is never
    known.
    """
    top = spec.formula
    while _name(top) == "not":
        (top,) = _parts(top)
    result = dict.fromkeys(_asked_in(top, universal=True, asked=Instants.FIRST))
    made = []
    for formula, universal, asked in result:
        if formula is top or any(math.isinf(bare(spec, p).horizon) for p in _parts(formula)):
            continue
        kind: ClockKind = "newest"
        if _name(formula) in _PAST:
            kind = "last"
        elif asked is Instants.FIRST or universal is not (_name(formula) in _MUST_LAST):
            kind = "oldest"
        made.append(Obligation(formula, kind, *_window(spec, formula, reading), asked))
    return list(dict.fromkeys(made))


_Found = tuple[Formula, bool, Formula | Instants]
"""An operator, whether every one of its instants counts, and these instants."""


def _asked_in(node: Formula, *, universal: bool, asked: Formula | Instants) -> Iterator[_Found]:
    """Yield the temporal operators of a formula."""
    if not any(_name(part) in _PAST | _FUTURE for part in node.nodes()):
        return
    name, parts = _name(node), _parts(node)
    match name:
        case "not":
            yield from _asked_in(parts[0], universal=not universal, asked=asked)
        case "and" | "or":
            for part in parts:
                others = [other for other in parts if other is not part and not _looks_ahead(other)]
                if universal is not (name == "or"):
                    others = []  # the part counts whatever they are
                elif name == "or":
                    others = [_negated(other) for other in others]
                narrowed = _narrowed(asked, others)
                yield from _asked_in(part, universal=universal, asked=narrowed)
        case "implies":
            equal = rtamt.disjunction((~parts[0], parts[1]))
            yield from _asked_in(equal, universal=universal, asked=asked)
        case "iff" | "xor":
            left, right = parts
            right = right if name == "iff" else ~right
            # among equal formulas, choose one with parts that name the instants of the other side
            equal = (left & right) | (~left & ~right)
            if universal:
                equal = left.implies(right) & (~left).implies(~right)
            yield from _asked_in(equal, universal=universal, asked=asked)
        case _:
            yield node, universal, asked
            yield from _asked_below(node, universal=universal, asked=asked)


def _asked_below(node: Formula, *, universal: bool, asked: Formula | Instants) -> Iterator[_Found]:
    """Yield the temporal operators in the operands of one."""
    name, parts = _name(node), _parts(node)
    # The first operand of until must last, the second must come to pass.
    below = [name in {"always", "historically"}] if len(parts) == 1 else [True, False]
    if name in _NEIGHBOURS:
        below = [universal]
    later = _later(asked) if name in {"next", "s_next"} else Instants.EVERY
    for part, all_count in zip(parts, below, strict=True):
        yield from _asked_in(part, universal=all_count, asked=later)


def _narrowed(asked: Formula | Instants, conditions: Iterable[Formula]) -> Formula | Instants:
    """Return the instants where these conditions hold too."""
    conditions = list(conditions)
    if asked is Instants.FIRST or not conditions:
        return asked
    return rtamt.conjunction(conditions if isinstance(asked, Instants) else [asked, *conditions])


def _negated(formula: Formula) -> Formula:
    return _parts(formula)[0] if _name(formula) == "not" else ~formula


def _later(asked: Formula | Instants) -> Formula:
    """Return the instants one sample later."""
    if isinstance(asked, Instants):
        every = rtamt.parse("true").formula
        asked = every if asked is Instants.EVERY else ~every.prev(strong=True)
    return asked.prev(strong=True)


def _window(
    spec: Specification, formula: Formula, reading: EvaluationOptions
) -> tuple[int, int | None]:
    """Return the window of an operator, in samples."""
    if _name(formula) in _NEIGHBOURS:
        return 1, 1
    if formula.interval is None:
        return 0, None
    # The same window over a predicate that nothing simplifies.
    text = f"eventually{formula.interval}({spec.variables[0]} > 0)"
    equal_formula = rtamt.parse(text, unit=spec.unit).formula
    program = rtamt.EpisodeMonitor(
        bare(spec, equal_formula), reading.period, align=reading.align
    ).program
    if program.sources[program.result] is not equal_formula:  # eventually[0:0](p) is p
        return 0, 0
    window = program.window(program.result)
    return window.lo or 0, window.hi


def _name(node: Any) -> str:  # noqa: ANN401 - a formula, or a term in one
    name: str = "" if node.op is None else node.op.name
    return name


def _parts(node: Formula) -> tuple[Formula, ...]:
    return cast("tuple[Formula, ...]", node.args)  # of these operators they are formulas


def _looks_ahead(node: Formula) -> bool:
    return any(_name(part) in _FUTURE for part in node.nodes())


class _Obligations(Generic[_M]):
    """The clocks of several specifications.

    Attributes:
        found: The operators of each specification.

    Args:
        judged: The specification of each judge, by name.
        reading: The evaluation options.
        make: Makes the monitor of a formula that clocks read.
        num: The number of environments.
    """

    def __init__(
        self,
        judged: Mapping[str, Specification],
        reading: EvaluationOptions,
        make: Callable[..., _M],
        num: int,
    ) -> None:
        self.found = [obligations_of(spec, reading) for spec in judged.values()]
        parts = {
            (index, part): bare(spec, part)
            for index, (spec, obligations) in enumerate(
                zip(judged.values(), self.found, strict=True)
            )
            for obligation in obligations
            for part in obligation.parts
        }
        options = options_of_parts(judged, list(parts.values()), reading)
        self._monitors: list[_M] = [
            make(spec, **option) for spec, option in zip(parts.values(), options, strict=True)
        ]
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
        def make(spec: Specification, **option: Any) -> VectorMonitor:  # noqa: ANN401
            return VectorMonitor(spec, num, **option)

        super().__init__(judged, reading, make, num)
        self._picks = [
            pick([columns.index(name) for name in monitor.variables]) for monitor in self._monitors
        ]
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
        super().__init__(judged, reading, Monitor, 1)

    def reset(self) -> None:
        for monitor in self._monitors:
            monitor.reset()
        self._clocks.reset()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        """Return the update function for samples with values in the order of these names."""
        parts = [
            (monitor.update, *picked([names.index(v) for v in monitor.variables]))
            for monitor in self._monitors
        ]
        take = self._clocks.feed
        if not parts:
            return lambda _: None

        def feed(values: Sequence[float]) -> None:
            take(
                [
                    [update(values[only]) if pick is None else update(*pick(values))]
                    for update, only, pick in parts
                ]
            )

        return feed

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
    asked = obligation.asked
    return OperatorClock(
        obligation.kind,
        _event_of(obligation),
        obligation.begin + late,
        None if obligation.end is None else obligation.end + late,
        late,
        tuple((part, late - latencies[part]) for part in operands),
        None if isinstance(asked, Instants) else parts[-1],
        asked is Instants.FIRST,
    )
