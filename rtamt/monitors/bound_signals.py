"""The bounds of formulas over a trace and after it, for explanations of verdicts."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.machines.dense.runs import Runs
from rtamt.machines.protocols import End
from rtamt.machines.walk import Keys, numbers_of
from rtamt.monitors.origins import RobustnessSignal
from rtamt.monitors.sample_trace import SampleTrace

UNSEEN = (-math.inf, math.inf)
"""The lower and the upper bound of a predicate after the trace."""

_MAX_AHEAD = 1 << 20
"""Samples after a trace for which bounds are computed."""

BoundSignal = Callable[[Node, bool], RobustnessSignal]
"""Returns the lower or, with True, the upper bound of a formula."""


class NoSingleCause(Exception):  # noqa: N818 - no error for users
    """A bound that is not the value of one predicate on the trace."""


class DecidingBound(NamedTuple):
    """The bound that an explanation follows: the upper one if ``best`` is true."""

    end: End
    best: bool


def places_ahead(formula: Formula, bounds: Callable[[Formula], Bounds]) -> int:
    """Return how many places after the trace its bounds can depend on."""
    ahead = 1
    for node in formula.nodes():
        if node.op is None or not isinstance(node, Formula):
            continue
        if node.op.timed:
            begin, end = bounds(node)
            ahead += begin if end is None else end
        elif node.op.sampled:
            ahead += 1
    return ahead


def unseen_from(place: int, runs: Runs, value: float) -> RobustnessSignal:
    """Return runs that end before a place, with a value from there on."""
    count = int(runs.starts.searchsorted(place))
    starts = np.append(runs.starts[:count], place)
    return RobustnessSignal(np.append(runs.last[:count], value), starts)


def sample_signals(
    trace: SampleTrace, ahead: int, known: Mapping[Node, RobustnessSignal]
) -> BoundSignal:
    """Return the bounds of formulas over samples, and so many after them, each at its first use.

    ``known`` has the robustness on the complete trace; nan for a formula that is not needed.
    """
    if ahead > _MAX_AHEAD:
        raise NoSingleCause

    @functools.cache
    def both(formula: Node) -> tuple[RobustnessSignal, RobustnessSignal]:
        if not isinstance(formula, Formula) or np.isnan(known[formula].values).all():
            return known[formula], known[formula]
        low, high = (extended(*keys) for keys in trace.around_end(formula))
        return low, high

    def extended(recorded: Keys, beyond: Keys) -> RobustnessSignal:
        rest = beyond[:ahead]
        rest = np.concatenate([rest, np.full(ahead - len(rest), beyond[-1])])
        return RobustnessSignal(numbers_of(np.concatenate([recorded, rest])))

    return lambda formula, best: both(formula)[best]
