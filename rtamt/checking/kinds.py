"""The kinds of examples that a formula has: near misses, read off its structure.

A kind is a version of the formula that is changed in one place, and an example of it is a trace on
which the formula and its version differ. So what it shows is decided by nothing but that place: a
trace that satisfies a requirement, and would not if a window were one sample shorter, is answered
at the last moment. Near misses are what a concept is learnt from (Winston, "Learning structural
descriptions from examples", 1970).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Final, Literal, cast

from rtamt.errors import SpecificationError
from rtamt.language.formula import Formula, Term, make, number, replaced
from rtamt.language.interval import UNITS, Interval
from rtamt.language.node import Node
from rtamt.program.implications import implications, signs, unanswered

__all__ = ["ExampleKind", "Sought", "kinds_of", "last_digit", "replaced"]

ExampleKind = Literal[
    "satisfied",
    "violated",
    "answered",
    "unanswered",
    "never asked",
    "last moment",
    "too late",
    "first moment",
    "too early",
    "threshold",
    "saved",
    "broken",
]
"""What an example shows.

``"satisfied"`` shows nothing special, ``"violated"`` is the shortest violation; ``"answered"``,
``"unanswered"`` and ``"never asked"`` are about an implication; ``"last moment"``, ``"too late"``,
``"first moment"`` and ``"too early"`` about a window; ``"threshold"`` about a comparison at its
border; ``"saved"`` and ``"broken"`` about the one part of ``or`` and ``and`` that decides.
"""


@dataclass(frozen=True, slots=True)
class Sought:
    """What an example is to be like.

    Attributes:
        kind: What it shows.
        why: The same in words.
        holds: Whether it satisfies the formula; else it violates it.
        also: Other formulas, and whether each is to hold.
        wished: Further ones, which are left out if no trace has them.
    """

    kind: ExampleKind
    why: str
    holds: bool
    also: tuple[tuple[Formula, bool], ...] = ()
    wished: tuple[tuple[Formula, bool], ...] = ()


def kinds_of(formula: Formula, step: Fraction | None, unit: str) -> list[Sought]:
    """The kinds of examples of a formula, the most telling first.

    Args:
        formula: The formula.
        step: Seconds between samples; None: bounds are numbers of samples.
        unit: The unit of bounds without one.
    """
    asked = [*_of_implications(formula, step, unit)]
    plain = [] if asked else [Sought("satisfied", "a trace that satisfies it", holds=True)]
    shortest = Sought("violated", "the shortest violation", holds=False)
    found = [*asked[:1], *plain, shortest, *asked[1:]]
    both = signs(formula)
    changes = [
        (_ORDER[change.kind], place, change)
        for place, node in enumerate(reversed([*formula.nodes()]))
        if isinstance(node, Formula) and node in both
        for change in _changes(node, step, unit)
    ]
    for _, _, change in sorted(changes, key=lambda each: each[:2]):
        other = replaced(formula, {change.node: change.instead})
        if other is formula:
            continue
        for positive in sorted(both[change.node], reverse=True):
            holds = change.lowers == positive
            why = change.why if positive or not change.otherwise else change.otherwise
            found.append(Sought(change.kind, why, holds, ((other, not holds),)))
    return found


_ORDER: Final[dict[ExampleKind, int]] = {
    "last moment": 0,
    "too late": 0,
    "saved": 1,
    "broken": 1,
    "threshold": 2,
    "first moment": 3,
    "too early": 3,
}


@dataclass(frozen=True, slots=True)
class _Change:
    """A change of one place.

    Attributes:
        kind: What examples of it show.
        why: The same in words.
        node: The part that is changed.
        instead: What takes its place.
        lowers: Whether that never holds where the part does not; else it always holds where the
            part does.
        otherwise: The words where the formula falls with the part, if they are others.
    """

    kind: ExampleKind
    why: str
    node: Formula
    instead: Formula
    lowers: bool
    otherwise: str = ""


def _of_implications(formula: Formula, step: Fraction | None, unit: str) -> Iterator[Sought]:
    """An answer, a request without one, and no request, for each implication."""
    every = implications(formula)
    for each in every:
        of = f": {each}" if len(every) > 1 else ""
        other = unanswered(formula, [each])
        late = _inside(each, step, unit)
        wished = () if late is each else ((replaced(formula, {each: late}), True),)
        true = cast("Formula", make("true", ()))
        yield Sought(
            "answered", f"asked and answered{of}", holds=True, also=((other, False),), wished=wished
        )
        without = replaced(formula, {each: true})
        yield Sought(
            "unanswered", f"asked and not answered{of}", holds=False, also=((without, True),)
        )
        yield Sought("never asked", f"never asked{of}", holds=True, also=((other, True),))


def _inside(implication: Formula, step: Fraction | None, unit: str) -> Formula:
    """An implication whose answer comes neither at the first nor at the last moment."""
    request, answer = implication.args
    for node in [*answer.nodes()]:
        interval = node.interval
        if isinstance(node, Formula) and _row(node) == "eventually" and interval is not None:
            one, begin, end = _one(interval, step, unit), interval.begin, interval.end
            if end is None or end - begin < 2 * one:
                continue
            room = one * max(1, math.floor((end - begin) / one / 4))
            narrow = Interval(begin + room, end - room, interval.unit)
            inner = cast("Formula", make("eventually", node.args, narrow))
            answer = replaced(cast("Formula", answer), {node: inner})
    return cast("Formula", make("implies", (request, answer)))


def _changes(node: Formula, step: Fraction | None, unit: str) -> Iterator[_Change]:
    row = _row(node)
    if row in {"and", "or"}:
        yield from _of_parts(node)
    elif row in _STRICTER or row in _LOOSER:
        yield from _of_threshold(node)
    elif row in {"==", "!="}:
        yield from _of_equality(node)
    elif row in _EXISTS or row in _EVERY:
        yield from _of_window(node, step, unit)
        if row in {"until", "since"}:
            p, q = node.args
            late = cast("Formula", make(_ONCE[row], (q,), node.interval))
            when = f"before {q} comes" if row == "until" else f"after {q}"
            yield _Change("broken", f"{p} fails {when}", node, late, lowers=False)
    elif row in _FIRSTS:
        first = f"{node} at the first sample, with none before it"
        yield _Change("first moment", first, node, _FIRSTS[row](node), lowers=True)


def _rising(node: Formula, *, down: bool) -> Formula:
    p = cast("Formula", node.args[0])
    return p.prev(strong=True) & ~p if down else p & (~p).prev(strong=True)


_FIRSTS: Final[Mapping[str, Callable[[Formula], Formula]]] = {
    "rise": lambda node: _rising(node, down=False),
    "fall": lambda node: _rising(node, down=True),
    "prev": lambda node: cast("Formula", make("s_prev", node.args)),
}
"""What an operator is where a first sample does not count."""


def _of_parts(node: Formula) -> Iterator[_Change]:
    """The one part of ``and`` that fails, of ``or`` that holds."""
    every = _row(node) == "and"
    for i, part in enumerate(node.args):
        rest = (*node.args[:i], *node.args[i + 1 :])
        instead = rest[0] if len(rest) == 1 else make(_row(node), rest)
        kind: ExampleKind = "broken" if every else "saved"
        why = f"{'broken' if every else 'saved'} by {part} alone"
        otherwise = f"of {node}, {part} alone {'fails' if every else 'holds'}"
        yield _Change(kind, why, node, cast("Formula", instead), not every, otherwise)


_EXISTS: Final = {"eventually", "once", "until", "since"}
_EVERY: Final = {"always", "historically"}
_PAST: Final = {"once", "since", "historically"}
_ONCE: Final = {"until": "eventually", "since": "once"}


def _of_window(node: Formula, step: Fraction | None, unit: str) -> Iterator[_Change]:
    """A window that is one sample longer or shorter at one end."""
    row, interval, part = _row(node), node.interval, node.args[-1]
    if interval is None:
        return
    one = _one(interval, step, unit)
    exists, past = row in _EXISTS, row in _PAST
    verb = "comes" if exists else "fails"
    name = f"{row}{interval}"
    late, early = ("longer ago than", "more recently than") if past else ("after", "before")
    if exists:
        beyond, before = f"one sample {_too(late)} for", f"one sample {_too(early)} for"
    else:
        beyond, before = f"one sample {late}", f"one sample {early}"
    last, first = ("earliest", "latest") if past else ("last", "first")
    begin, end = interval.begin, interval.end
    ways: list[tuple[ExampleKind, str, Fraction, Fraction | None, bool]] = []
    if end is not None:
        ways += [
            ("last moment", f"at the {last} moment of", begin, end - one, True),
            ("too late", beyond, begin, end + one, False),
        ]
    ways += [
        ("first moment", f"at the {first} moment of", begin + one, end, True),
        ("too early", before, begin - one, end, False),
    ]
    for kind, where, low, high, narrower in ways:
        try:
            if low < 0 or (high is not None and high < low):
                continue
            changed = make(row, node.args, Interval(low, high, interval.unit))
        except SpecificationError:  # no decimal number
            continue
        why = f"{part} {verb} {where} {name}"
        yield _Change(kind, why, node, cast("Formula", changed), narrower == exists)


def _one(interval: Interval, step: Fraction | None, unit: str) -> Fraction:
    """One sample, in the unit of an interval."""
    return Fraction(1) if step is None else step / UNITS[interval.unit or unit]


def _too(word: str) -> str:
    return {
        "after": "too late",
        "before": "too early",
        "longer ago than": "too long ago",
        "more recently than": "too recently",
    }[word]


_STRICTER: Final = {">=": ">", "<=": "<"}
_LOOSER: Final = {">": ">=", "<": "<="}


def _of_threshold(node: Formula) -> Iterator[_Change]:
    """A comparison at its border, and one unit of its last digit away from it."""
    row, unit = _row(node), _unit(node)
    exact = f"exactly at its threshold, {node}"
    more = unit if row in {">", "<="} else -unit  # of the right side, where a > b + 1 is stricter
    if row in _STRICTER:
        strict = cast("Formula", make(_STRICTER[row], node.args))
        yield _Change("threshold", f"{exact} holds", node, strict, lowers=True)
        yield _Change("threshold", f"{node} just fails", node, _moved(node, more), lowers=False)
    else:
        yield _Change("threshold", f"{node} just holds", node, _moved(node, more), lowers=True)
        loose = cast("Formula", make(_LOOSER[row], node.args))
        yield _Change("threshold", f"{exact} fails", node, loose, lowers=False)


def _of_equality(node: Formula) -> Iterator[_Change]:
    """An equality on either side of its threshold, at most one unit of the last digit away."""
    for more, inner, outer, side in ((1.0, ">=", "<=", "above"), (-1.0, "<=", ">=", "below")):
        beyond = _moved(node, more * _unit(node))
        near = cast("Formula", make(inner, node.args)) & cast("Formula", make(outer, beyond.args))
        if _row(node) == "==":
            yield _Change("threshold", f"{node} just fails, from {side}", node, near, lowers=False)
        else:
            yield _Change("threshold", f"{node} just holds, from {side}", node, ~near, lowers=True)


def _unit(node: Formula) -> float:
    """One unit of the last digit of the number that a comparison is with; 1 if there is none."""
    given = [side.leaf for side in node.args if side.op is None and isinstance(side.leaf, float)]
    return last_digit(given[0]) if given else 1.0


def _moved(node: Formula, by: float) -> Formula:
    """A comparison whose right side is greater."""
    left, right = cast("tuple[Term, Term]", node.args)
    if right.op is None and isinstance(right.leaf, float):
        args: tuple[Term, Term] = left, number(_sum(right.leaf, by))
    elif left.op is None and isinstance(left.leaf, float):
        args = number(_sum(left.leaf, -by)), right
    else:
        args = left, right + by
    return cast("Formula", make(_row(node), args))


def _sum(x: float, y: float) -> float:
    """The sum as decimal numbers have it: 0.1 and 0.2 give 0.3."""
    return float(Decimal(repr(x)) + Decimal(repr(y)))


def last_digit(value: float) -> float:
    """One unit of the last digit of a number as it is written, at most 1.

    Example:
        >>> last_digit(3.0), last_digit(0.25), last_digit(120.0)
        (1.0, 0.01, 1.0)
    """
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return 10.0 ** min(0, cast("int", exponent))


def _row(node: Node) -> str:
    return node.op.name if node.op else ""
