"""What the patterns take: formulas and terms, also as text, amounts, and times."""

from __future__ import annotations

import math
from typing import cast

from rtamt.errors import InputTypeError, SpecificationError, brief
from rtamt.language.formula import Formula, Term, make, number
from rtamt.language.interval import Exact, Interval
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.parser import as_specification

__all__ = [
    "AmountLike",
    "ConditionLike",
    "TermLike",
    "amount",
    "condition",
    "lasting",
    "quantity",
    "timed",
]

ConditionLike = Formula | str
"""A formula or its text."""

TermLike = Term | str
"""A term or its text."""

AmountLike = Term | float | str
"""A number, or a term or its text where the amount changes with time."""


def condition(given: ConditionLike, what: str) -> Formula:
    """The formula that was given for an argument.

    Raises:
        InputTypeError: If it is neither a formula nor text.
        ParseError: If the text is wrong.
    """
    if not isinstance(given, Formula | str):
        msg = f"expected a formula or its text for {what}, got {type(given).__name__}"
        raise InputTypeError(f"{msg} {brief(given)}")
    return as_specification(given).formula


def quantity(given: TermLike | Formula, what: str) -> Term:
    """The term that was given for an argument.

    Raises:
        InputTypeError: If it is neither a term nor text.
        SpecificationError: If it is a formula.
        ParseError: If the text is wrong.
    """
    if isinstance(given, Term):
        return given
    if not isinstance(given, Formula | str):
        msg = f"expected a term or its text for {what}, got {type(given).__name__} {brief(given)}"
        raise InputTypeError(msg)
    formula = condition(given, what)
    if formula.op is not OPERATORS["value"]:
        raise SpecificationError(f"expected a term for {what}, got the formula {formula}")
    return cast("Term", formula.args[0])


def amount(given: AmountLike, what: str, *, least: float = -math.inf) -> Term:
    """The number or term that was given for an argument.

    Raises:
        SpecificationError: If it is a number below the least one, or not finite.
        InputTypeError: If it is none of them.
    """
    if not isinstance(given, Node | str) and not hasattr(given, "__float__"):
        msg = f"expected a number, a term or its text for {what}, got {type(given).__name__}"
        raise InputTypeError(f"{msg} {brief(given)}")
    term = quantity(given, what) if isinstance(given, Node | str) else number(given)
    if isinstance(term.leaf, float) and term.leaf < least:
        msg = f"expected a number of at least {brief(least)} for {what}, got {brief(term.leaf)}"
        raise SpecificationError(msg)
    return term


def lasting(time: Exact, what: str) -> Interval:
    """The interval from 0 up to a time.

    Raises:
        SpecificationError: If the time is not above 0, or has no end.
        InputTypeError: If it is no time.
    """
    given: object = time
    if given is None:
        raise InputTypeError(f"expected a time for {what}, got None")
    interval = Interval.of(0, time)
    if interval is None or not interval.end:
        raise SpecificationError(f"expected a time above 0 for {what}, got {brief(time)}")
    return interval


def timed(name: str, interval: Interval | None, *operands: Formula) -> Formula:
    """The formula of a temporal operator with an interval."""
    return cast("Formula", make(name, operands, interval))
