"""What the temporal operators of a specification owe: found in its formula.

A robustness and its bounds are about the whole formula. They do not tell how old a request is that
waits for its grant, or how long a goal has been held that must be held for five seconds. That is in
the operators below the top, each of which is asked for its value at many instants. The instants at
which an operator is asked follow from the formula around it:

| where it stands | it is asked at |
|---|---|
| below no other temporal operator | the first instant |
| below ``always`` or another temporal operator | every instant |
| ``p implies it``, ``not p or it`` below ``always`` | the instants at which p holds |
| ``p and it`` below ``eventually`` | the instants at which p holds |
| ``p iff it``, ``p xor it`` below either | the instants at which p holds; and, negated or not, \
those at which it does not |
| ``next it`` | one instant later |

p is a formula without a future; one that looks ahead narrows nothing. Below ``always`` every
instant counts that is asked, below ``eventually`` one is enough, and ``not`` exchanges the two.
So an operator has one of three clocks, each a fraction of its window:

| clock | of | 0 | 1 |
|---|---|---|---|
| ``"oldest"`` | what must come to pass (``eventually``, ``until`` below ``always``), and what \
must last (``always``, ``unless`` below ``eventually``) | nothing is pending | overdue; done |
| ``"newest"`` | what must last (``always``, ``unless`` below ``always``), and what may come to \
pass (``eventually``, ``until`` below ``eventually``) | nothing is pending | just asked |
| ``"last"`` | the past: ``once``, ``since``, ``historically``, ``prev``, ``rise``, ``fall`` | \
the operand holds now (``historically``: fails) | longer ago than the window, or never |

`rtamt.OperatorClocks` says how each is counted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, cast

import rtamt
from rtamt import ClockKind, Formula
from rtamt_gym.options.evaluation import Reading

__all__ = ["Instants", "Obligation", "bare", "obligations_of"]

_PAST = {"once", "historically", "since", "prev", "s_prev", "rise", "fall"}
_FUTURE = {"eventually", "always", "until", "unless", "next", "s_next"}
_MUST_LAST = {"always", "unless", "next"}
_NEIGHBOURS = {"next", "s_next", "prev", "s_prev", "rise", "fall"}


class Instants(Enum):
    """The instants at which an operator is asked, where no formula says it."""

    EVERY = "every"
    FIRST = "first"


@dataclass(frozen=True, slots=True)
class Obligation:
    """A temporal operator below the top of a specification.

    Attributes:
        formula: The operator with its operands.
        kind: What its clock counts from.
        begin: The begin of its window, in samples.
        end: The end of its window; None if it has none.
        asked: The instants at which its value counts; a formula without a future, or one of
            `Instants`.
    """

    formula: Formula
    kind: ClockKind
    begin: int
    end: int | None
    asked: Formula | Instants

    @property
    def name(self) -> str:
        """The name of the operator."""
        return _name(self.formula)

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The formulas that it is about."""
        return _parts(self.formula)

    @property
    def parts(self) -> tuple[Formula, ...]:
        """All formulas whose values its clock needs."""
        return self.operands if isinstance(self.asked, Instants) else (*self.operands, self.asked)


def obligations_of(spec: rtamt.Specification, reading: Reading) -> list[Obligation]:
    """The temporal operators below the outermost one, in the order of the text.

    An operator whose operand has a future without end is left out: the operand is never known.
    """
    top = spec.formula
    while _name(top) == "not":
        (top,) = _parts(top)
    found = dict.fromkeys(_asked_in(top, universal=True, asked=Instants.FIRST))
    made = []
    for formula, universal, asked in found:
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
"""An operator, whether every instant that is asked counts, and the instants."""


def _asked_in(node: Formula, *, universal: bool, asked: Formula | Instants) -> Iterator[_Found]:
    """The temporal operators of a formula."""
    if not any(_name(each) in _PAST | _FUTURE for each in node.nodes()):
        return
    name, parts = _name(node), _parts(node)
    match name:
        case "not":
            yield from _asked_in(parts[0], universal=not universal, asked=asked)
        case "and" | "or":
            for part in parts:
                beside = [each for each in parts if each is not part and not _looks_ahead(each)]
                if universal is not (name == "or"):
                    beside = []  # the part counts whatever they are
                elif name == "or":
                    beside = [_negated(each) for each in beside]
                narrowed = _narrowed(asked, beside)
                yield from _asked_in(part, universal=universal, asked=narrowed)
        case "implies":
            whole = rtamt.disjunction((~parts[0], parts[1]))
            yield from _asked_in(whole, universal=universal, asked=asked)
        case "iff" | "xor":
            left, right = parts
            right = right if name == "iff" else ~right
            # Of what is equal to these, the one in whose parts the other side says when.
            whole = (left & right) | (~left & ~right)
            if universal:
                whole = left.implies(right) & (~left).implies(~right)
            yield from _asked_in(whole, universal=universal, asked=asked)
        case _:
            yield node, universal, asked
            yield from _asked_below(node, universal=universal, asked=asked)


def _asked_below(node: Formula, *, universal: bool, asked: Formula | Instants) -> Iterator[_Found]:
    """The temporal operators in the operands of one."""
    name, parts = _name(node), _parts(node)
    # In both operands of until the first must last, the second must come to pass.
    below = [name in {"always", "historically"}] if len(parts) == 1 else [True, False]
    if name in _NEIGHBOURS:
        below = [universal]
    later = _later(asked) if name in {"next", "s_next"} else Instants.EVERY
    for part, all_count in zip(parts, below, strict=True):
        yield from _asked_in(part, universal=all_count, asked=later)


def _narrowed(asked: Formula | Instants, conditions: Iterable[Formula]) -> Formula | Instants:
    """The instants at which these hold too."""
    conditions = list(conditions)
    if asked is Instants.FIRST or not conditions:
        return asked
    return rtamt.conjunction(conditions if isinstance(asked, Instants) else [asked, *conditions])


def _negated(formula: Formula) -> Formula:
    return _parts(formula)[0] if _name(formula) == "not" else ~formula


def _later(asked: Formula | Instants) -> Formula:
    """The instants after those."""
    if isinstance(asked, Instants):
        every = rtamt.parse("true").formula
        asked = every if asked is Instants.EVERY else ~every.prev(strong=True)
    return asked.prev(strong=True)


def _window(
    spec: rtamt.Specification, formula: Formula, reading: Reading
) -> tuple[int, int | None]:
    """The window of an operator as numbers of samples."""
    if _name(formula) in _NEIGHBOURS:
        return 1, 1
    if formula.interval is None:
        return 0, None
    # As an operator that is its window, over a predicate that nothing simplifies.
    text = f"eventually{formula.interval}({spec.variables[0]} > 0)"
    alike = rtamt.parse(text, unit=spec.unit).formula
    program = rtamt.EpisodeMonitor(bare(spec, alike), reading.period, align=reading.align).program
    if program.sources[program.result] is not alike:  # eventually[0:0](p) is p
        return 0, 0
    window = program.window(program.result)
    return window.lo or 0, window.hi


def bare(spec: rtamt.Specification, formula: Formula) -> rtamt.Specification:
    """A part of a specification, without the names that its monitor would keep beside it."""
    return replace(spec, formulas={}, uses={}).with_result(formula)


def _name(node: Any) -> str:  # noqa: ANN401 - a formula, or a term in one
    name: str = "" if node.op is None else node.op.name
    return name


def _parts(node: Formula) -> tuple[Formula, ...]:
    return cast("tuple[Formula, ...]", node.args)  # of these operators they are formulas


def _looks_ahead(node: Formula) -> bool:
    return any(_name(each) in _FUTURE for each in node.nodes())
