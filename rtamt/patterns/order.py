"""Patterns of what comes after what."""

from __future__ import annotations

from rtamt.errors import SpecificationError
from rtamt.language.formula import Formula
from rtamt.language.interval import Exact
from rtamt.patterns.operands import ConditionLike, condition, lasting, timed

__all__ = ["absence_between", "in_order", "precedence", "response"]


def response(request: ConditionLike, answer: ConditionLike, within: Exact) -> Formula:
    """``always(request implies eventually[0:T] answer)``: every request is answered within T.

    *Bounded response* (Dwyer; Konrad and Cheng). An answer at the time of the request counts. A
    request of the last T that has no answer yet violates where the trace is ``"complete"``, and
    leaves the verdict open where it was ``"cut"``.

    Args:
        request: What asks.
        answer: What has to follow.
        within: T, above 0.

    Raises:
        SpecificationError: If T is not above 0.

    Example:
        >>> import rtamt
        >>> formula = response("req >= 3", "gnt >= 3", within=5)
        >>> print(formula)
        always(req >= 3 implies eventually[0:5](gnt >= 3))
        >>> rtamt.in_words(formula)
        'whenever req is at least 3, gnt reaches at least 3 within 5 s'
    """
    answered = timed("eventually", lasting(within, "within"), condition(answer, "answer"))
    return condition(request, "request").implies(answered).always()


def precedence(first: ConditionLike, later: ConditionLike) -> Formula:
    """``not later unless first``: the later one does not come before the first one has.

    *Precedence* (Dwyer). Both may come at the same time. It is satisfied if none of them ever
    comes; a trace that ends before the first one is satisfied if the later one has not come either.

    Args:
        first: What has to come first.
        later: What has to wait for it.

    Example:
        >>> import rtamt
        >>> formula = precedence("unlocked > 0", "open > 0")
        >>> print(formula)
        not (open > 0) unless unlocked > 0
        >>> rtamt.evaluate(formula, {"unlocked": [-1, 1, 1], "open": [-1, 1, 1]}).tolist()[0]
        1.0
    """
    return (~condition(later, "later")).unless(condition(first, "first"))


def in_order(*several: ConditionLike, within: Exact | None = None) -> Formula:
    """``eventually(a and eventually(b and eventually c))``: a, then b, then c.

    *Response chain* (Dwyer). There are times of the stages, each not before the one of the stage
    before it. That a stage holds earlier too does no harm: `precedence` forbids that. The verdict
    is satisfied at the sample at which the last stage is reached; at the end of a trace the stages
    that were not reached violate.

    Such a formula has `stages`, and monitors of environments say how far an episode has come in
    them. An `rtamt.EpisodeMonitor` takes up to seven stages without ``within``.

    Args:
        several: The stages, at least two.
        within: The time that a stage has after the one before it, above 0; None: any.

    Raises:
        SpecificationError: If there are fewer than two stages, or the time is not above 0.

    Example:
        >>> import rtamt
        >>> print(in_order("near > 0", "grasped > 0", "lifted > 0"))
        eventually(near > 0 and eventually(grasped > 0 and eventually(lifted > 0)))
        >>> formula = in_order("near > 0", "lifted > 0", within=2)
        >>> print(formula)
        eventually(near > 0 and eventually[0:2](lifted > 0))
        >>> rtamt.in_words(formula)
        'at some time, near is above 0 and lifted gets above 0 within 2 s'
    """
    if len(several) < 2:
        msg = f"expected at least two stages, each an argument, got {len(several)}"
        raise SpecificationError(msg)
    window = None if within is None else lasting(within, "within")
    found, *before = reversed([condition(each, f"stage {i + 1}") for i, each in enumerate(several)])
    for each in before:
        found = each & timed("eventually", window, found)
    return found.eventually()


def absence_between(p: ConditionLike, begin: ConditionLike, end: ConditionLike) -> Formula:
    """``always(begin and eventually(end) implies not p until end)``: none from a begin to its end.

    *Absence* in the scope *between* (Dwyer): p holds at no time from a begin up to, and not at, the
    next end. A begin without an end demands nothing, at the end of a trace too, nor does one at the
    time of an end.

    Args:
        p: What must not occur.
        begin: What opens the scope.
        end: What closes it.

    Example:
        >>> import rtamt
        >>> formula = absence_between("door > 0", "start > 0", "stop > 0")
        >>> print(formula)
        always(start > 0 and eventually(stop > 0) implies not (door > 0) until stop > 0)
        >>> trace = {"start": [-1, 1, -1, -1], "stop": [-1, -1, -1, 1], "door": [-1, -1, 1, -1]}
        >>> rtamt.evaluate(formula, trace).tolist()[0]
        -1.0
    """
    opened, closed = condition(begin, "begin"), condition(end, "end")
    absent = (~condition(p, "p")).until(closed)
    return (opened & closed.eventually()).implies(absent).always()
