"""Signals in dense time, and their division into calls, for the property tests."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping
from typing import TypeVar

from dense_oracle import STEP
from hypothesis import strategies as st
from strategies import QUARTERS, VARIABLES

import rtamt

Breakpoints = list[tuple[float, float]]
Bits = list[tuple[float, float, float]]
Signals = dict[str, Breakpoints]
Chunks = list[Signals]
_Events = TypeVar("_Events")

INTEGERS = st.sampled_from((0.0, 0.0, -0.0, -2.0, -1.0, 1.0, 2.0))
"""Values of which nearly half are 0."""

_starts = st.sampled_from((0.0, STEP, 2 * STEP))
_gaps = st.lists(st.sampled_from((STEP, 2 * STEP, 3 * STEP, 5 * STEP)), max_size=6)
_values = st.sampled_from(QUARTERS)


@functools.cache
@st.composite
def signals(draw: st.DrawFn, values: st.SearchStrategy[float] = _values) -> Signals:
    """Events of every variable, each at its own times, with a common time."""
    made: Signals = {}
    for name in VARIABLES:
        times = itertools.accumulate([draw(_starts), *draw(_gaps)])
        made[name] = [(time, draw(values)) for time in times]
    begin = max(events[0][0] for events in made.values())
    for events in made.values():
        if events[-1][0] < begin:
            events.append((begin, draw(values)))
    return made


@functools.cache
def chunks(most: int = 6) -> st.SearchStrategy[list[list[float]]]:
    """For every variable, the shares of its events, from 0 to 1, at which a new call starts."""
    share = st.floats(0, 1)
    return st.lists(st.lists(share, min_size=most, max_size=most), min_size=3, max_size=3)


def chunked(whole: Signals, shares: list[list[float]]) -> Chunks:
    """Return the signals in consecutive chunks, cut at different places for every variable."""
    calls: Chunks = [{} for _ in range(len(shares[0]) + 1)]
    for (name, events), own in zip(whole.items(), shares, strict=True):
        cuts = [0, *sorted(round(share * len(events)) for share in own), len(events)]
        for call, (i, j) in zip(calls, itertools.pairwise(cuts), strict=True):
            if i < j:
                call[name] = events[i:j]
    return calls


def of(monitor: rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor, chunk: Signals) -> Signals:
    """Return the events of the variables that the monitor has."""
    return {name: events for name, events in chunk.items() if name in monitor.variables}


def relevant(whole: Mapping[str, _Events], names: tuple[str, ...]) -> dict[str, _Events]:
    """Return the signals of some variables, for the oracle."""
    return {name: whole[name] for name in names}


def play(monitor: rtamt.dense.Monitor, calls: Chunks) -> Breakpoints:
    """Update the monitor with every chunk and finish it; return all steps of the result."""
    given = [step for chunk in calls for step in monitor.update(of(monitor, chunk))]
    return given + monitor.finish()


def by_value(steps: Iterable[tuple[float, float]]) -> Breakpoints:
    """Return the steps without those that differ from the previous one only in the sign of zero."""
    return [next(same) for _, same in itertools.groupby(steps, key=lambda step: step[1])]


def bitwise(steps: Iterable[tuple[float, float]]) -> Bits:
    """Return steps with the signs of their values, which distinguish 0.0 and -0.0."""
    return [(time, value, math.copysign(1.0, value)) for time, value in steps]
