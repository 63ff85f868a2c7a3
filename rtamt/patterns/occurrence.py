"""Patterns of what may occur, must occur, and must last."""

from __future__ import annotations

from rtamt.errors import SpecificationError
from rtamt.language.formula import Formula
from rtamt.language.interval import Exact, Interval
from rtamt.patterns.operands import (
    AmountLike,
    ConditionLike,
    TermLike,
    amount,
    condition,
    lasting,
    timed,
)
from rtamt.patterns.operands import quantity as term

__all__ = ["minimum_duration", "never", "recurrence", "success", "within_limits"]


def never(p: ConditionLike) -> Formula:
    """``always(not p)``: p holds at no time. *Absence*, in the scope *globally* (Dwyer).

    The end of a trace changes nothing but how long p has been absent.

    Args:
        p: What must not occur.

    Example:
        >>> import rtamt
        >>> formula = never("x > 3")
        >>> print(formula)
        always not (x > 3)
        >>> rtamt.in_words(formula)
        'x is never above 3'
    """
    return (~condition(p, "p")).always()


def within_limits(x: TermLike, least: AmountLike, most: AmountLike) -> Formula:
    """``always(x >= least and x <= most)``: x stays between two limits, both of them allowed.

    Args:
        x: A quantity.
        least: The lower limit, in the unit of x.
        most: The upper limit, in the unit of x.

    Raises:
        SpecificationError: If the lower limit is above the upper one.

    Example:
        >>> import rtamt
        >>> formula = within_limits("x", -1, 1)
        >>> print(formula)
        always(x >= -1 and x <= 1)
        >>> rtamt.evaluate(formula, {"x": [0, 0.5, 2]}).tolist()
        [-1.0, -1.0, -1.0]
    """
    value, low, high = term(x, "x"), amount(least, "least"), amount(most, "most")
    if isinstance(low.leaf, float) and isinstance(high.leaf, float) and low.leaf > high.leaf:
        raise SpecificationError(f"expected least= to be at most most=, got {low} and {high}")
    return ((value >= low) & (value <= high)).always()


def minimum_duration(p: ConditionLike, duration: Exact) -> Formula:
    """``always(rise(p) implies always[0:T] p)``: whenever p begins to hold, it holds for T.

    *Minimum duration* (Konrad and Cheng). At the first sample p begins if it holds there. Where the
    trace ends before T has passed, ``"complete"`` asks for what is left of it, and ``"cut"`` leaves
    the verdict open. Dense time has no ``rise``.

    Args:
        p: What must last once it has begun.
        duration: T, above 0.

    Raises:
        SpecificationError: If the duration is not above 0.

    Example:
        >>> import rtamt
        >>> formula = minimum_duration("heater > 0", 2)
        >>> print(formula)
        always(rise(heater > 0) implies always[0:2](heater > 0))
        >>> print(rtamt.in_words(formula))
        whenever heater becomes above 0, heater stays above 0 for the next 2 s;
        where the first sample counts as changed
    """
    held, window = condition(p, "p"), lasting(duration, "duration")
    return held.rise().implies(timed("always", window, held)).always()


def recurrence(p: ConditionLike, within: Exact) -> Formula:
    """``always[T:inf](once[0:T] p)``: p comes again and again, at most T apart.

    *Bounded recurrence* (Konrad and Cheng). Every window of length T that lies inside the trace has
    a time at which p holds; so the end of a trace changes nothing, and a trace shorter than T is
    asked for nothing.

    Args:
        p: What must recur.
        within: T, above 0.

    Raises:
        SpecificationError: If T is not above 0.

    Example:
        >>> import rtamt
        >>> formula = recurrence("beat > 0", "500ms")
        >>> print(formula)
        always[500:inf ms] once[0:500ms](beat > 0)
        >>> rtamt.in_words(formula)
        'from 500 ms on, beat was above 0 within the last 500 ms'
    """
    window = lasting(within, "within")
    later = Interval(window.end or window.begin, None, window.unit)
    return timed("always", later, timed("once", window, condition(p, "p")))


def success(goal: ConditionLike, hold: Exact | None = None, *, kept: bool = False) -> Formula:
    """``eventually(goal since[T:T] goal)``: the goal is reached, and has held for T.

    | reading | arguments | formula |
    |---|---|---|
    | any | none | ``eventually goal`` |
    | last | ``kept=True`` | ``eventually(always goal)`` |
    | held | ``hold=T`` | ``eventually(goal since[T:T] goal)`` |
    | kept | ``hold=T, kept=True`` | ``eventually(always(goal since[T:T] goal))`` |

    "Last" looks at the last sample alone, "kept" at the last T. The windows look back: none reaches
    past the end of a trace, and a trace shorter than T violates.

    Args:
        goal: What is to be reached. Give it the side that is meant (``"angle >= 1.2"``), and what
            else has to be so (``"angle >= 1.2 and abs(speed) <= 0.01"``).
        hold: T, above 0; None: an instant is enough.
        kept: Whether the goal must still hold at the end.

    Raises:
        SpecificationError: If T is not above 0.

    Example:
        >>> import rtamt
        >>> formula = success("near > 0", hold=2)
        >>> print(formula)
        eventually(near > 0 since[2:2] near > 0)
        >>> rtamt.evaluate(formula, {"near": [-1, 1, 1, -1]}, period=1).tolist()[0]
        -1.0
        >>> rtamt.evaluate(formula, {"near": [-1, 1, 1, 1]}, period=1).tolist()[0]
        1.0
    """
    held = condition(goal, "goal")
    if hold is not None:
        window = lasting(hold, "hold")
        until_now = Interval(window.end or window.begin, window.end, window.unit)
        held = timed("since", until_now, held, held)
    return (held.always() if kept else held).eventually()
