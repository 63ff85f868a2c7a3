"""The table of mutations: the changes of each kind in a requirement.

Mutation testing was proposed by DeMillo, Lipton and Sayward, "Hints on test data selection",
Computer 1978; for specifications by Black, Okun and Yesha, "Mutation operators for specifications",
ASE 2000; for temporal requirements by Trakhtenbrot, "Mutation patterns for temporal requirements of
reactive systems", ICSTW 2017.

To add a kind of mutant, add a row to `MUTATIONS` with a generator of changes over
`RequirementText`, its mutants to ``tests/rtamt/mutation/test_mutants.py``, and a line to
``docs/checking.md``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Final, cast

from rtamt.errors import SpecificationError
from rtamt.language.interval import UNITS, decimal_text
from rtamt.language.operators import OPERATORS

if TYPE_CHECKING:  # it loads the parser
    from rtamt.mutation.requirement_text import Bound, Change, RequirementText

Changes = Callable[["RequirementText"], Iterator["Change"]]


@dataclass(frozen=True, slots=True)
class Mutation:
    """A kind of change.

    Attributes:
        name: The name of the kind.
        doc: The change in a few words.
        example: A change, as ``before -> after``.
        changes: Yields the changes of this kind in a requirement, in the order of its text.
    """

    name: str
    doc: str
    example: str
    changes: Changes


def _bounds(move: Callable[[Fraction, Fraction], list[Fraction]]) -> Changes:
    """Return changes of bounds; ``move`` returns new values for a bound and a step."""

    def changes(text: RequirementText) -> Iterator[Change]:
        for bound in text.bounds:
            token = text.tokens[bound.index]
            if token.text[0] in "0123456789.":
                for value in _moved(text, bound, token.text, move):
                    yield text.change((bound.index,) * 2, value, (bound.first, bound.last))
        for name, first in text.constants().items():
            if first is not None:
                for value in _moved(text, first, text.constant_text(name), move):
                    yield text.declared(name, value)

    return changes


def _moved(
    text: RequirementText,
    bound: Bound,
    digits: str,
    move: Callable[[Fraction, Fraction], list[Fraction]],
) -> Iterator[str]:
    """Yield the new texts of a bound; a step is a sample, or one unit of the last digit."""
    step = Fraction(_last_digit(digits))
    if text.period is not None:
        step = text.period / UNITS[bound.unit or text.spec.unit]
    for value in move(Fraction(digits), step):
        if value >= 0:
            with suppress(SpecificationError):  # a period such as 1/3 s
                yield decimal_text(value)


def _by_a_step(value: Fraction, step: Fraction) -> list[Fraction]:
    return [value - step, value + step]


def _by_a_factor(value: Fraction, step: Fraction) -> list[Fraction]:
    return [math.floor(value / 2 / step) * step, value * 2, value * 10]


def _numbers(move: Callable[[str], list[Decimal]]) -> Changes:
    """Return changes of numbers in terms; ``move`` returns new values for the text of a number."""

    def changes(text: RequirementText) -> Iterator[Change]:
        for index in text.numbers():
            for value in move(text.tokens[index].text):
                yield text.swapped(index, _text(value))
        for name, bound in text.constants().items():
            if bound is None:
                for value in move(text.constant_text(name)):
                    yield text.declared(name, _text(value))

    return changes


def _by_a_digit(digits: str) -> list[Decimal]:
    value, unit = Decimal(digits), Decimal(_last_digit(digits))
    return [value - unit, value + unit]


def _by_a_tenth(digits: str) -> list[Decimal]:
    value = Decimal(digits)
    return [value * Decimal("0.9"), value * Decimal("1.1")] if value else []


def _last_digit(digits: str) -> Decimal:
    """Return one unit of the last digit of a number: 1 for 35, 0.01 for 0.20."""
    return Decimal(1).scaleb(cast("int", Decimal(digits).as_tuple().exponent))


def _text(value: Decimal) -> str:
    text = f"{value.normalize():f}" if abs(value.adjusted()) < 16 else f"{value.normalize():e}"
    return "0" if value == 0 else text


def _exchanged(instead: Mapping[str, str]) -> Changes:
    """Return exchanges of operators, in the corresponding spelling."""

    def changes(text: RequirementText) -> Iterator[Change]:
        for index in text.operators(*instead):
            row = text.row(index)
            if row is not None:
                spellings = OPERATORS[instead[row.name]].spellings
                which = row.spellings.index(text.tokens[index].text)
                yield text.swapped(index, spellings[min(which, len(spellings) - 1)])

    return changes


_STRICT: Final = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
_DIRECTED: Final = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "!=", "!=": "=="}
_PAIRS: Final = {
    "always": "eventually",
    "historically": "once",
    "until": "unless",
    "next": "s_next",
    "prev": "s_prev",
    "rise": "fall",
}


def _implications(text: RequirementText) -> Iterator[Change]:
    for index in text.operators("implies"):
        for first, last in ((text.left(index), index - 1), (index + 1, text.right(index))):
            operand = text.between(first, last)
            negated = f"not {operand}" if text.bracketed(first, last) else f"not ({operand})"
            yield text.change((first, last), negated, (first, last))
    yield from _exchanged({"implies": "iff", "iff": "implies"})(text)


def _parts(text: RequirementText) -> Iterator[Change]:
    for index in text.operators("and", "or", "implies", "not"):
        row = text.row(index)
        if row is None or row.notation == "prefix":
            yield text.change((index, index), "", (index, index))
            continue
        left = text.left(index)
        if text.starts_run(left, row):  # otherwise, the previous operator drops it
            yield text.change((left, index), "", (left, index))
        if row.name != "implies":
            last = text.right(index)
            yield text.change((index, last), "", (index, last))


def _constants(text: RequirementText) -> Iterator[Change]:
    bounding = text.spec.bounding
    for bound in text.bounds:
        name = text.tokens[bound.index].text
        if name in text.spec.constants:
            for other in text.spec.constants:
                if other != name and other in bounding:
                    yield text.change((bound.index,) * 2, other, (bound.first, bound.last))
    for index in text.names():
        for other in text.spec.constants:
            if other != text.tokens[index].text and other not in bounding:
                yield text.swapped(index, other)


_ROWS: Final = (
    Mutation(
        "bound",
        "a bound is one sample less or more; without a period, one unit of its last digit",
        "[0:5] -> [0:6]",
        _bounds(_by_a_step),
    ),
    Mutation(
        "window",
        "a bound is half, twice or ten times as far",
        "[0:5] -> [0:50]",
        _bounds(_by_a_factor),
    ),
    Mutation(
        "threshold",
        "a number is one unit of its last digit less or more",
        "v < 35 -> v < 36",
        _numbers(_by_a_digit),
    ),
    Mutation(
        "tenth",
        "a number is 10 % less or more",
        "v < 35 -> v < 38.5",
        _numbers(_by_a_tenth),
    ),
    Mutation(
        "strictness",
        "the limit itself becomes allowed or forbidden",
        "v < 35 -> v <= 35",
        _exchanged(_STRICT),
    ),
    Mutation(
        "direction",
        "a comparison is reversed, or == and != are exchanged",
        "v < 35 -> v > 35",
        _exchanged(_DIRECTED),
    ),
    Mutation(
        "junction",
        "and becomes or, or becomes and",
        "and -> or",
        _exchanged({"and": "or", "or": "and"}),
    ),
    Mutation(
        "operator",
        "always and eventually are exchanged; also historically and once, until and unless, rise "
        "and fall, next and s_next, prev and s_prev",
        "always -> eventually",
        _exchanged({**_PAIRS, **{b: a for a, b in _PAIRS.items()}}),
    ),
    Mutation(
        "implication",
        "a side of an implication is negated, or implies and iff are exchanged",
        "implies -> iff",
        _implications,
    ),
    Mutation(
        "part",
        "a part of an and or an or, the left side of an implication, or a not is left out",
        "and q -> nothing",
        _parts,
    ),
    Mutation(
        "constant",
        "another constant of the text replaces a constant",
        "v < LIMIT -> v < FLOOR",
        _constants,
    ),
)

MUTATIONS: Final[Mapping[str, Mutation]] = {row.name: row for row in _ROWS}
"""The kinds of mutants, by name."""
