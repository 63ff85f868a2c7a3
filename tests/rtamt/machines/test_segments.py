"""Runs of places in C++ against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtamt.machines.backend import BACKENDS
from rtamt.machines.segments import PlaceRuns, Segments

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Bounds = list[tuple[int, int, int]]
Window = tuple[int, int]


@st.composite
def cases(draw: st.DrawFn) -> tuple[Bounds, list[int], list[Window]]:
    """Bounds in each segment, the starts of the segments, and windows of places in order."""
    key = st.integers(-3, 2)
    rows = draw(st.lists(st.tuples(key, key, key), min_size=1, max_size=40))
    starts = np.cumsum([0, *draw(st.lists(st.integers(1, 3), min_size=40, max_size=40))])
    edges = sorted(draw(st.sets(st.integers(0, int(starts[len(rows)]) - 1), max_size=4)))
    windows = [*zip(edges[::2], edges[1::2], strict=False)]
    return rows, starts[: len(rows)].tolist(), windows or [(0, int(starts[len(rows)]) - 1)]


@given(case=cases(), known=st.booleans(), apart=st.booleans())
def test_failing_runs_match_numpy(
    case: tuple[Bounds, list[int], list[Window]],
    known: bool,  # noqa: FBT001
    apart: bool,  # noqa: FBT001
) -> None:
    rows, starts, windows = case
    robustness, *bounds = np.array(rows, np.int64).T
    lower, upper = np.minimum(*bounds), np.maximum(*bounds)
    if known:
        lower = upper = robustness
    places, last = (np.array(starts), windows[-1][1] + 5) if apart else (None, len(rows) - 1)
    if apart:
        last = max(last, starts[-1])
    else:
        windows = [(first, min(final, last)) for first, final in windows if first <= last]
    recorded = PlaceRuns.of(tuple(windows), last)
    found = []
    for find_runs in (BACKENDS["native"].find_runs, None):
        segments = Segments(places, last, robustness, lower, upper, find_runs).divided(recorded)
        runs, minima = segments.failing(recorded)
        columns = *runs.places, *minima
        found.append([column.tolist() for column in columns])
    assert found[0] == found[1]
    # By hand: the places that fail are those of the runs.
    segment = (
        [*range(len(rows))]
        if places is None
        else np.repeat(np.arange(len(rows)), np.diff([*starts, last + 1])).tolist()
    )
    failing = [
        place
        for first, final in windows
        for place in range(first, final + 1)
        if upper[segment[place]] < 0
    ]
    covered = [p for a, b in zip(*found[0][:2], strict=True) for p in range(a, b + 1)]
    assert covered == failing
