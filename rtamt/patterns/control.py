"""Patterns of how a quantity moves: step responses and rates."""

from __future__ import annotations

from rtamt.errors import SpecificationError
from rtamt.language.formula import Formula
from rtamt.language.interval import Exact
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

__all__ = ["overshoot", "rate_limit", "rise_time", "settling_time"]


def settling_time(
    x: TermLike,
    target: AmountLike,
    tolerance: AmountLike,
    within: Exact,
    *,
    after: ConditionLike | None = None,
) -> Formula:
    """``eventually[0:T] always(abs(x - target) <= tolerance)``: within T x is near, and stays near.

    Settling time as in control engineering. A trace must be near at its last sample: one that ends
    before T must have settled by then, if it is ``"complete"``.

    Args:
        x: The quantity that settles.
        target: Where it settles, in the unit of x.
        tolerance: How far from there counts as near, in the unit of x.
        within: T, above 0.
        after: What starts the time, wherever it holds; None: the begin of the trace.

    Raises:
        SpecificationError: If T is not above 0, or the tolerance is negative.

    Example:
        >>> import rtamt
        >>> formula = settling_time("x", 1, 0.1, within=2)
        >>> print(formula)
        eventually[0:2] always(abs(x - 1) <= 0.1)
        >>> rtamt.in_words(formula)
        'within the first 2 s, the absolute value of (x - 1) stays at most 0.1 from then on'
        >>> print(settling_time("x", "goal", 0.1, within=2, after="moved > 0"))
        always(moved > 0 implies eventually[0:2] always(abs(x - goal) <= 0.1))
    """
    away = abs(term(x, "x") - amount(target, "target"))
    near = (away <= amount(tolerance, "tolerance", least=0.0)).always()
    return _after(timed("eventually", lasting(within, "within"), near), after)


def overshoot(
    x: TermLike,
    target: AmountLike,
    most: AmountLike,
    *,
    falling: bool = False,
    after: ConditionLike | None = None,
) -> Formula:
    """``always(x - target <= most)``: x goes past its target by no more than so much.

    *Overshoot* (Boufaied et al.). The end of a trace changes nothing.

    Args:
        x: The quantity that approaches a target.
        target: The target, in the unit of x.
        most: The greatest overshoot, in the unit of x.
        falling: Whether x comes from above; it is ``target - x`` then.
        after: What x moves after, to the end of the trace; None: the begin of the trace.

    Raises:
        SpecificationError: If the greatest overshoot is negative.

    Example:
        >>> import rtamt
        >>> formula = overshoot("x", 1, 0.25)
        >>> print(formula)
        always(x - 1 <= 0.25)
        >>> rtamt.evaluate(formula, {"x": [0, 0.5, 1.5, 1]}).tolist()[0]
        -0.25
    """
    value, goal = term(x, "x"), amount(target, "target")
    beyond = goal - value if falling else value - goal
    return _after((beyond <= amount(most, "most", least=0.0)).always(), after)


def rise_time(x: TermLike, low: AmountLike, high: AmountLike, within: Exact) -> Formula:
    """``always(rise(x >= low) implies eventually[0:T](x >= high))``.

    *Rise time* (Boufaied et al.): whenever x rises to the low level, which is often 10 % of a step,
    it reaches the high one, often 90 %, within T. A trace that begins at the low level or above it
    rises there at its first sample. Where it ends before T has passed, ``"complete"`` violates and
    ``"cut"`` leaves the verdict open. Dense time has no ``rise``.

    Args:
        x: The quantity that rises.
        low: The level from which the time counts, in the unit of x.
        high: The level to reach, in the unit of x.
        within: T, above 0.

    Raises:
        SpecificationError: If T is not above 0, or the low level is not below the high one.

    Example:
        >>> import rtamt
        >>> formula = rise_time("x", 0.1, 0.9, within=2)
        >>> print(formula)
        always(rise(x >= 0.1) implies eventually[0:2](x >= 0.9))
        >>> print(rtamt.in_words(formula))
        whenever x becomes at least 0.1, x reaches at least 0.9 within 2 s;
        where the first sample counts as changed
    """
    value, least, most = term(x, "x"), amount(low, "low"), amount(high, "high")
    if isinstance(least.leaf, float) and isinstance(most.leaf, float) and least.leaf >= most.leaf:
        raise SpecificationError(f"expected low= to be below high=, got {least} and {most}")
    risen = timed("eventually", lasting(within, "within"), value >= most)
    return (value >= least).rise().implies(risen).always()


def rate_limit(rate: TermLike, most: AmountLike) -> Formula:
    """``always(abs(rate) <= most)``: a quantity changes no faster than that.

    A term is of one instant, and cannot tell how fast a quantity changes: the rate is a signal of
    its own, such as a speed, or a column that was computed before.

    Args:
        rate: The rate of change.
        most: The greatest rate, in the unit of the rate.

    Raises:
        SpecificationError: If the greatest rate is negative.

    Example:
        >>> import rtamt
        >>> formula = rate_limit("speed", 2)
        >>> print(formula)
        always(abs(speed) <= 2)
        >>> rtamt.in_words(formula)
        'the absolute value of speed stays at most 2 at all times'
    """
    return (abs(term(rate, "rate")) <= amount(most, "most", least=0.0)).always()


def _after(requirement: Formula, trigger: ConditionLike | None) -> Formula:
    """The requirement at the begin of the trace, or wherever a trigger holds."""
    if trigger is None:
        return requirement
    return condition(trigger, "after").implies(requirement).always()
