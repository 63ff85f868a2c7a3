"""Occurrences by brute force: `judge` at one place after the other.

A place is a sample; in dense time, place 2k is the instant at k steps and 2k + 1 the time after it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from rtamt import Formula, Judgement, Verdict
from rtamt.language.node import Node

INF = math.inf


class Judged(NamedTuple):
    """A trace whose formulas can be judged at one place.

    Attributes:
        at: Returns the judgement of a formula at a place.
        plain: The same by standard semantics.
        last: The last place.
        unit: Places of a unit of bounds.
        step: Places of a sample or instant.
    """

    at: Callable[[Formula, int], Judgement]
    plain: Callable[[Formula, int], Judgement]
    last: int
    unit: int
    step: int


class Expected(NamedTuple):
    """The runs of a body: first place, last place and more."""

    violations: list[tuple[int, int, tuple[float, float], int]]
    unknown: list[tuple[int, int]]
    responses: list[tuple[int, int, Verdict, float | None, tuple[float, float]]]
    unknown_triggers: list[tuple[int, int]]
    reads: list[int]


def body_places(formula: Formula, trace: Judged) -> dict[Formula, set[int]]:
    """Return the recorded places at which a formula reads each of its bodies, place by place."""
    places: dict[Formula, set[int]] = {}

    def walk(node: Any, at: set[int]) -> None:  # noqa: ANN401 - a formula with an operator
        if node.op.name == "and":
            for operand in node.args:
                walk(operand, at)
        elif node.op.name == "always":
            begin, end = bounds(node)
            walk(node.args[0], {*window(at, begin, end, trace)})
        else:
            places.setdefault(node, set()).update(at)

    walk(formula, {0})
    return places


def window(at: set[int], begin: float, end: float, trace: Judged) -> Iterator[int]:
    low, high = trace.unit * begin, trace.unit * end
    for place in range(trace.last + 1):
        if any(low <= place - i <= high for i in at):
            yield place


def bounds(node: Node) -> tuple[float, float]:
    if node.interval is None:
        return 0, INF
    end = node.interval.end
    return float(node.interval.begin), INF if end is None else float(end)


def expected(formula: Formula, trace: Judged) -> dict[Formula, Expected]:
    """Return the runs of every body, by the definition."""
    return {
        body: of_body(body, sorted(at), trace) for body, at in body_places(formula, trace).items()
    }


def of_body(body: Formula, at: list[int], trace: Judged) -> Expected:
    judged = {i: trace.at(body, i) for i in at}
    verdicts = {i: judgement.verdict for i, judgement in judged.items()}
    robustness = {i: order(judgement.robustness) for i, judgement in judged.items()}
    violations = []
    for first, last in runs(verdicts, Verdict.VIOLATED):
        worst = min(robustness[i] for i in range(first, last + 1))
        where = next(i for i in range(first, last + 1) if robustness[i] == worst)
        violations.append((first, last, worst, where))
    responses, unknown = [], []
    if body.op.name == "implies" and body.args[1].op.name != "false":  # type: ignore[union-attr]
        left: Any = body.args[0]
        triggered = {i: trace.plain(left, i).verdict for i in at}
        unknown = runs(triggered, Verdict.UNDECIDED)
        for first, last in runs(triggered, Verdict.SATISFIED):
            outcomes = {verdicts[i] for i in range(first, last + 1)}
            verdict = min(outcomes) if Verdict.VIOLATED in outcomes else Verdict.UNDECIDED
            if outcomes == {Verdict.SATISFIED}:
                verdict = Verdict.SATISFIED
            margin = min(robustness[i] for i in range(first, last + 1))
            responses.append((first, last, verdict, answer(body.args[1], first, trace), margin))
    return Expected(violations, runs(verdicts, Verdict.UNDECIDED), responses, unknown, at)


def answer(right: Any, first: int, trace: Judged) -> float | None:  # noqa: ANN401 - as above
    """Return the places from a first one to its answer, in samples or steps of time."""
    if right.op.name not in ("eventually", "until"):
        return None
    begin, end = bounds(right)
    for place in range(first, trace.last + 1):
        reached = trace.unit * begin <= place - first <= trace.unit * end
        if reached and satisfied(trace, right.args[-1], place):
            inside = place % trace.step and place > first  # an open interval, and not the first
            way = range(first, place + bool(inside))
            if right.op.name == "until" and not all(
                satisfied(trace, right.args[0], i) for i in way
            ):
                return None
            return place // trace.step - first // trace.step
    return None


def satisfied(trace: Judged, formula: Formula, place: int) -> bool:
    return trace.at(formula, place).verdict is Verdict.SATISFIED


def runs(verdicts: dict[int, Verdict], verdict: Verdict) -> list[tuple[int, int]]:
    """Return the first and last place of the runs of neighbouring places with a verdict."""
    found: list[tuple[int, int]] = []
    for place in sorted(i for i, its in verdicts.items() if its is verdict):
        if found and found[-1][1] == place - 1:
            found[-1] = found[-1][0], place
        else:
            found.append((place, place))
    return found


def order(value: float) -> tuple[float, float]:
    return value, math.copysign(1.0, value)
