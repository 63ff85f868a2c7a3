"""The patterns: functions that return the formulas of common requirements, and their stages.

A requirement has stages if it has the form

    eventually(p1 and eventually(p2 and ... eventually(pn)))

with at least two stages, with or without intervals. If the last operand of the ``and`` below an
``eventually`` is an ``eventually``, the operands before it are a stage, and the rest follows.

To add a pattern, add a function here, export it in ``rtamt/patterns/__init__.py`` and give it an
example in the `CATALOGUE` there. Add its row to ``docs/patterns.md``, which a test compares, and
define it again on arrays in ``tests/rtamt/patterns/test_patterns.py``.

To add a reading of success, make its formula with `success` here, add its name to `SuccessReading`
and its arguments to `reading` in `rtamt_gym.success`, and add a row to the table in
``docs/success.md``. ``by_hand`` in ``tests/rtamt_gym/success/test_success_readings.py`` defines it
again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import cast

from rtamt.errors import InputTypeError, RtamtError, SpecificationError, brief
from rtamt.language.formula import (
    Formula,
    Term,
    conjunction,
    make,
    number,
    replaced,
    variable,
)
from rtamt.language.interval import Exact, Interval
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.parser import as_specification, parse
from rtamt.language.specification import Specification

ConditionLike = Formula | str
"""A formula or its text."""

TermLike = Term | str
"""A term or its text."""

AmountLike = Term | float | str
"""A number, or a term or its text where the amount changes with time."""


def never(p: ConditionLike) -> Formula:
    """``always(not p)``: p never holds. *Absence*, in the scope *globally* (Dwyer).

    ``"complete"`` and ``"cut"`` give the same verdict.

    Args:
        p: The condition that must not occur.

    Example:
        >>> formula = never("x > 3")
        >>> print(formula)
        always not (x > 3)
        >>> formula.in_words()
        'x is never above 3'
    """
    return (~_condition(p, "p")).always()


def within_limits(x: TermLike, least: AmountLike, most: AmountLike) -> Formula:
    """``always(x >= least and x <= most)``: x stays between two limits, both included.

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
    value, low, high = _quantity(x, "x"), _amount(least, "least"), _amount(most, "most")
    if isinstance(low.leaf, float) and isinstance(high.leaf, float) and low.leaf > high.leaf:
        raise SpecificationError(f"expected least= below or equal to most=, got {low} and {high}")
    return ((value >= low) & (value <= high)).always()


def minimum_duration(p: ConditionLike, duration: Exact) -> Formula:
    """``always(rise(p) implies always[0:T] p)``: whenever p becomes true, it holds for T.

    *Minimum duration* (Konrad and Cheng). At the first sample p becomes true if it holds there. If
    the trace ends before T has passed, ``"complete"`` demands p until the end, and ``"cut"`` leaves
    the verdict open. Dense time has no ``rise``.

    Args:
        p: The condition that must last.
        duration: T, above 0.

    Raises:
        SpecificationError: If the duration is not above 0.

    Example:
        >>> formula = minimum_duration("heater > 0", 2)
        >>> print(formula)
        always(rise(heater > 0) implies always[0:2](heater > 0))
        >>> print(formula.in_words())
        whenever heater becomes above 0, heater stays above 0 for the next 2 s;
        where the first sample counts as changed
    """
    held, window = _condition(p, "p"), _lasting(duration, "duration")
    return held.rise().implies(_timed("always", window, held)).always()


def recurrence(p: ConditionLike, within: Exact) -> Formula:
    """``always[T:inf](once[0:T] p)``: p comes again and again, at most T apart.

    *Bounded recurrence* (Konrad and Cheng). p holds at some time in every window of length T inside
    the trace. ``"complete"`` and ``"cut"`` give the same verdict, except for a trace shorter than
    T: it satisfies with ``"complete"``, and is undecided with ``"cut"``.

    Args:
        p: The condition that must recur.
        within: T, above 0.

    Raises:
        SpecificationError: If T is not above 0.

    Example:
        >>> formula = recurrence("beat > 0", "500ms")
        >>> print(formula)
        always[500:inf ms] once[0:500ms](beat > 0)
        >>> formula.in_words()
        'from 500 ms on, beat was above 0 within the last 500 ms'
    """
    window = _lasting(within, "within")
    later = Interval(window.end or window.begin, None, window.unit)
    return _timed("always", later, _timed("once", window, _condition(p, "p")))


def success(goal: ConditionLike, hold: Exact | None = None, *, kept: bool = False) -> Formula:
    """``eventually(goal since[T:T] goal)``: the goal is reached, and has held for T.

    | success | arguments | formula |
    |---|---|---|
    | any | none | ``eventually goal`` |
    | last | ``kept=True`` | ``eventually(always goal)`` |
    | held | ``hold=T`` | ``eventually(goal since[T:T] goal)`` |
    | kept | ``hold=T, kept=True`` | ``eventually(always(goal since[T:T] goal))`` |

    "Last" depends only on the last sample, "kept" on the last T. The windows look back, so none
    reaches beyond the end of a trace, and a trace shorter than T violates.

    Args:
        goal: The condition to reach, with all its parts
            (``"angle >= 1.2 and abs(speed) <= 0.01"``).
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
    held = _condition(goal, "goal")
    if hold is not None:
        window = _lasting(hold, "hold")
        until_now = Interval(window.end or window.begin, window.end, window.unit)
        held = _timed("since", until_now, held, held)
    return (held.always() if kept else held).eventually()


def response(request: ConditionLike, answer: ConditionLike, within: Exact) -> Formula:
    """``always(request implies eventually[0:T] answer)``: every request is answered within T.

    *Bounded response* (Dwyer; Konrad and Cheng). An answer at the time of the request counts. A
    request in the last T without an answer violates with ``end="complete"``, and leaves the verdict
    open with ``end="cut"``.

    Args:
        request: The request.
        answer: The answer that must follow.
        within: T, above 0.

    Raises:
        SpecificationError: If T is not above 0.

    Example:
        >>> formula = response("req >= 3", "gnt >= 3", within=5)
        >>> print(formula)
        always(req >= 3 implies eventually[0:5](gnt >= 3))
        >>> formula.in_words()
        'whenever req is at least 3, gnt reaches at least 3 within 5 s'
    """
    answered = _timed("eventually", _lasting(within, "within"), _condition(answer, "answer"))
    return _condition(request, "request").implies(answered).always()


def precedence(first: ConditionLike, later: ConditionLike) -> Formula:
    """``not later unless first``: ``later`` does not come before ``first``.

    *Precedence* (Dwyer). Both may come at the same time. A trace without ``later`` satisfies the
    formula, also if ``first`` never comes.

    Args:
        first: The condition that must come first.
        later: The condition that must wait for it.

    Example:
        >>> import rtamt
        >>> formula = precedence("unlocked > 0", "open > 0")
        >>> print(formula)
        not (open > 0) unless unlocked > 0
        >>> rtamt.evaluate(formula, {"unlocked": [-1, 1, 1], "open": [-1, 1, 1]}).tolist()[0]
        1.0
    """
    return (~_condition(later, "later")).unless(_condition(first, "first"))


def in_order(*several: ConditionLike, within: Exact | None = None) -> Formula:
    """``eventually(a and eventually(b and eventually c))``: a, then b, then c.

    *Response chain* (Dwyer). Each stage has a time, not before the time of the stage before it. A
    stage may also hold earlier; `precedence` forbids that. The formula is satisfied at the sample
    that reaches the last stage, and violated at the end of a trace that does not reach all stages.

    The formula has `stages`, and monitors of environments report the progress of an episode in
    them. `rtamt.EpisodeMonitor` takes up to nine stages without ``within``.

    Args:
        several: The stages, at least two.
        within: The maximum time from a stage to the next, above 0; None: no limit.

    Raises:
        SpecificationError: If there are fewer than two stages, or the time is not above 0.

    Example:
        >>> print(in_order("near > 0", "grasped > 0", "lifted > 0"))
        eventually(near > 0 and eventually(grasped > 0 and eventually(lifted > 0)))
        >>> formula = in_order("near > 0", "lifted > 0", within=2)
        >>> print(formula)
        eventually(near > 0 and eventually[0:2](lifted > 0))
        >>> formula.in_words()
        'at some time, near is above 0 and lifted gets above 0 within 2 s'
    """
    if len(several) < 2:
        msg = f"expected at least two stages, each an argument, got {len(several)}"
        raise SpecificationError(msg)
    window = None if within is None else _lasting(within, "within")
    chain, *before = reversed([_condition(p, f"stage {i}") for i, p in enumerate(several, 1)])
    for stage in before:
        chain = stage & _timed("eventually", window, chain)
    return chain.eventually()


def absence_between(p: ConditionLike, begin: ConditionLike, end: ConditionLike) -> Formula:
    """``always(begin and eventually(end) implies not p until end)``: no p from begin to end.

    *Absence* in the scope *between* (Dwyer): p never holds from a begin until before the next end.
    A begin without an end, or at the time of an end, demands nothing.

    Args:
        p: The condition that must not occur.
        begin: The condition that opens the scope.
        end: The condition that closes it.

    Example:
        >>> import rtamt
        >>> formula = absence_between("door > 0", "start > 0", "stop > 0")
        >>> print(formula)
        always(start > 0 and eventually(stop > 0) implies not (door > 0) until stop > 0)
        >>> trace = {"start": [-1, 1, -1, -1], "stop": [-1, -1, -1, 1], "door": [-1, -1, 1, -1]}
        >>> rtamt.evaluate(formula, trace).tolist()[0]
        -1.0
    """
    opened, closed = _condition(begin, "begin"), _condition(end, "end")
    absent = (~_condition(p, "p")).until(closed)
    return (opened & closed.eventually()).implies(absent).always()


def settling_time(
    x: TermLike,
    target: AmountLike,
    tolerance: AmountLike,
    within: Exact,
    *,
    after: ConditionLike | None = None,
) -> Formula:
    """``eventually[0:T] always(abs(x - target) <= tolerance)``: within T, x is near and stays near.

    Settling time as in control engineering. x must be near at the last sample: with
    ``end="complete"``, a trace that ends before T must have settled by then.

    Args:
        x: The quantity that settles.
        target: The value that x settles at, in the unit of x.
        tolerance: The maximum distance from the target, in the unit of x.
        within: T, above 0.
        after: The condition that starts the time, whenever it holds; None: the start of the
            trace.

    Raises:
        SpecificationError: If T is not above 0, or the tolerance is negative.

    Example:
        >>> formula = settling_time("x", 1, 0.1, within=2)
        >>> print(formula)
        eventually[0:2] always(abs(x - 1) <= 0.1)
        >>> formula.in_words()
        'within the first 2 s, the absolute value of (x - 1) stays at most 0.1 from then on'
        >>> print(settling_time("x", "goal", 0.1, within=2, after="moved > 0"))
        always(moved > 0 implies eventually[0:2] always(abs(x - goal) <= 0.1))
    """
    away = abs(_quantity(x, "x") - _amount(target, "target"))
    near = (away <= _amount(tolerance, "tolerance", minimum=0.0)).always()
    return _after(_timed("eventually", _lasting(within, "within"), near), after)


def overshoot(
    x: TermLike,
    target: AmountLike,
    most: AmountLike,
    *,
    falling: bool = False,
    after: ConditionLike | None = None,
) -> Formula:
    """``always(x - target <= most)``: x passes its target by at most ``most``.

    *Overshoot* (Boufaied et al.). ``"complete"`` and ``"cut"`` give the same verdict.

    Args:
        x: The quantity that approaches a target.
        target: The target, in the unit of x.
        most: The maximum overshoot, in the unit of x.
        falling: Whether x comes from above; the overshoot is ``target - x`` then.
        after: The condition that starts the movement of x; None: the start of the trace.

    Raises:
        SpecificationError: If the maximum overshoot is negative.

    Example:
        >>> import rtamt
        >>> formula = overshoot("x", 1, 0.25)
        >>> print(formula)
        always(x - 1 <= 0.25)
        >>> rtamt.evaluate(formula, {"x": [0, 0.5, 1.5, 1]}).tolist()[0]
        -0.25
    """
    value, goal = _quantity(x, "x"), _amount(target, "target")
    beyond = goal - value if falling else value - goal
    return _after((beyond <= _amount(most, "most", minimum=0.0)).always(), after)


def rise_time(x: TermLike, low: AmountLike, high: AmountLike, within: Exact) -> Formula:
    """``always(rise(x >= low) implies eventually[0:T](x >= high))``.

    *Rise time* (Boufaied et al.): whenever x rises to the low level, often 10 % of a step, it
    reaches the high level, often 90 %, within T. A trace that starts at or above the low level
    rises at its first sample. If the trace ends before T has passed, ``"complete"`` violates, and
    ``"cut"`` leaves the verdict open. Dense time has no ``rise``.

    Args:
        x: The quantity that rises.
        low: The level that starts the time, in the unit of x.
        high: The level to reach, in the unit of x.
        within: T, above 0.

    Raises:
        SpecificationError: If T is not above 0, or the low level is not below the high one.

    Example:
        >>> formula = rise_time("x", 0.1, 0.9, within=2)
        >>> print(formula)
        always(rise(x >= 0.1) implies eventually[0:2](x >= 0.9))
        >>> print(formula.in_words())
        whenever x becomes at least 0.1, x reaches at least 0.9 within 2 s;
        where the first sample counts as changed
    """
    value, least, most = _quantity(x, "x"), _amount(low, "low"), _amount(high, "high")
    if isinstance(least.leaf, float) and isinstance(most.leaf, float) and least.leaf >= most.leaf:
        raise SpecificationError(f"expected low= to be below high=, got {least} and {most}")
    risen = _timed("eventually", _lasting(within, "within"), value >= most)
    return (value >= least).rise().implies(risen).always()


def rate_limit(rate: TermLike, most: AmountLike) -> Formula:
    """``always(abs(rate) <= most)``: a quantity changes at most that fast.

    The rate is a signal, such as a speed, or a term, such as ``rate(x)``.

    Args:
        rate: The rate of change.
        most: The maximum rate, in the unit of the rate.

    Raises:
        SpecificationError: If the maximum rate is negative.

    Example:
        >>> formula = rate_limit("speed", 2)
        >>> print(formula)
        always(abs(speed) <= 2)
        >>> formula.in_words()
        'the absolute value of speed stays at most 2 at all times'
    """
    return (abs(_quantity(rate, "rate")) <= _amount(most, "most", minimum=0.0)).always()


def _after(requirement: Formula, trigger: ConditionLike | None) -> Formula:
    """Return the requirement at the start of the trace, or whenever a trigger holds."""
    if trigger is None:
        return requirement
    return _condition(trigger, "after").implies(requirement).always()


def _condition(value: ConditionLike, name: str) -> Formula:
    """Return the formula of an argument."""
    if not isinstance(value, Formula | str):
        msg = f"expected a formula or its text for {name}, got {type(value).__name__}"
        raise InputTypeError(f"{msg} {brief(value)}")
    return as_specification(value).formula


def _quantity(value: TermLike | Formula, name: str) -> Term:
    """Return the term of an argument."""
    if isinstance(value, Term):
        return value
    if not isinstance(value, Formula | str):
        msg = f"expected a term or its text for {name}, got {type(value).__name__} {brief(value)}"
        raise InputTypeError(msg)
    formula = _condition(value, name)
    if formula.op is not OPERATORS["value"]:
        raise SpecificationError(f"expected a term for {name}, got the formula {formula}")
    return cast("Term", formula.args[0])


def _amount(value: AmountLike, name: str, *, minimum: float = -math.inf) -> Term:
    """Return the number or term of an argument."""
    if not isinstance(value, Node | str) and not hasattr(value, "__float__"):
        msg = f"expected a number, a term or its text for {name}, got {type(value).__name__}"
        raise InputTypeError(f"{msg} {brief(value)}")
    term = _quantity(value, name) if isinstance(value, Node | str) else number(value)
    if isinstance(term.leaf, float) and term.leaf < minimum:
        msg = f"expected a number of at least {brief(minimum)} for {name}, got {brief(term.leaf)}"
        raise SpecificationError(msg)
    return term


def _lasting(time: Exact, name: str) -> Interval:
    """Return the interval from 0 to a time."""
    if cast("object", time) is None:
        raise InputTypeError(f"expected a time for {name}, got None")
    interval = Interval.of(0, time)
    if interval is None or not interval.end:
        raise SpecificationError(f"expected a time above 0 for {name}, got {brief(time)}")
    return interval


def _timed(operator: str, interval: Interval | None, *operands: Formula) -> Formula:
    """Return the formula of a temporal operator with an interval."""
    return cast("Formula", make(operator, operands, interval))


_EVENTUALLY = OPERATORS["eventually"]
_AND = OPERATORS["and"]
_VALUE = OPERATORS["value"]


def stages(spec: str | Formula | Specification) -> tuple[Formula, ...]:
    """Return the stages of a requirement, in order; empty if it has no stages.

    Args:
        spec: Text, a formula or a specification; the last formula of a text counts, with named
            formulas inserted.

    Raises:
        SpecificationError: If a text is wrong.

    Example:
        >>> stages("eventually(near > 0 and eventually[0:5](grasped > 0 and eventually(up > 0)))")
        (<Formula near > 0>, <Formula grasped > 0>, <Formula up > 0>)
        >>> stages("eventually(up > 0)"), stages("always(x > 0)")
        ((), ())
    """
    return tuple(stage for _, stage in _steps(spec))


def prefixes(spec: str | Formula | Specification) -> tuple[Formula, ...]:
    """Return the requirement up to each of its stages; the last one is the complete requirement.

    Args:
        spec: As for `stages`.

    Raises:
        SpecificationError: If a text is wrong.

    Example:
        >>> prefixes("eventually(near > 0 and eventually[0:5](up > 0))")
        (<Formula eventually(near > 0)>, <Formula eventually(near > 0 and eventually[0:5](up > 0))>)
    """
    steps = _steps(spec)
    return tuple(_chain(steps[:count]) for count in range(1, len(steps) + 1))


def named_stages(
    spec: str | Formula | Specification, several: Iterable[str | Formula]
) -> tuple[Formula, ...]:
    """Return the stages that the caller names, for a requirement of any form.

    Args:
        spec: As for `stages`.
        several: Formulas or their texts, in order, which may use the named formulas and constants
            of the specification.

    Raises:
        SpecificationError: If a text is wrong, or a stage reads a variable that the requirement
            does not use.

    Example:
        >>> spec = "limit = 2; near = d < limit; eventually always[0:5](near and up > 0)"
        >>> named_stages(spec, ["near", "up > limit"])
        (<Formula d < 2>, <Formula up > 2>)
    """
    spec = as_specification(spec)
    definitions = _definitions(spec)
    formulas = []
    for index, stage in enumerate(several, 1):
        formula = stage
        if isinstance(formula, str):
            try:
                formula = parse(formula, unit=spec.unit).formula
            except RtamtError as error:
                error.add_note(f"in stage {index}")
                raise
        formula = replaced(formula, definitions)
        for name in formula.variables:
            if name not in spec.variables:
                known = ", ".join(spec.variables) or "no variable"
                msg = f"stage {index}, {stage}, reads {name}, which the requirement does not"
                raise SpecificationError(f"{msg}; it reads {known}")
        formulas.append(formula)
    return tuple(formulas)


def _definitions(spec: Specification) -> dict[Node, Node]:
    """Return the formulas and constants that the names of a specification stand for."""
    nodes: dict[Node, Node] = {variable(n): number(value) for n, value in spec.constants.items()}
    for name, formula in spec.formulas.items():
        term = variable(name)
        if formula.op is _VALUE:
            nodes[term] = formula.args[0]
        else:
            nodes[term.formula()] = formula
    return nodes


def _steps(spec: str | Formula | Specification) -> list[tuple[Interval | None, Formula]]:
    """Return the interval and the condition of each stage."""
    formula = as_specification(spec).formula
    steps: list[tuple[Interval | None, Formula]] = []
    while formula.op is _EVENTUALLY:
        below = cast("Formula", formula.args[0])
        *parts, last = cast("tuple[Formula, ...]", below.args) if below.op is _AND else (below,)
        if not parts or last.op is not _EVENTUALLY:
            return [*steps, (formula.interval, below)] if steps else []
        steps.append((formula.interval, conjunction(parts)))
        formula = last
    return []


def _chain(steps: list[tuple[Interval | None, Formula]]) -> Formula:
    chain: Formula | None = None
    for interval, stage in reversed(steps):
        inner = stage if chain is None else stage & chain
        chain = cast("Formula", make("eventually", (inner,), interval))
    return cast("Formula", chain)
