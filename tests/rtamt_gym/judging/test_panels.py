"""What a panel says of its monitors: before the first sample, and of what is certain."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rtamt
from rtamt_gym import Reading
from rtamt_gym.judging.monitors import InstantMonitor, VectorInstantMonitor, pick
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.vector_panel import VectorPanel


def test_no_sample_has_no_robustness() -> None:
    spec = rtamt.parse("x > 1")
    assert math.isnan(InstantMonitor(spec).robustness)
    assert np.isnan(VectorInstantMonitor(spec, 3).robustness).tolist() == [True, True, True]


@pytest.mark.parametrize(
    ("above", "certain"),
    [({}, False), ({"task": 1.0}, True), ({"task": 2.0}, False), ({"task": 3.0}, False)],
)
def test_what_stays_above_a_number_is_known(above: dict[str, float], *, certain: bool) -> None:
    """It is 2 or more from the first sample on, so it is not certain to stay above 2."""
    specs = {"task": rtamt.parse("eventually(x > 0)")}
    single, many = Panel(specs, Reading()), VectorPanel(specs, 2, Reading(), ["x"])
    single.feeder(["x"])([2.0])
    many.feed(np.array([[2.0], [-2.0]]))
    assert single.knows(above) is certain
    assert many.knows(above).tolist() == [certain, False]


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ([], []),
        ([3], slice(3, 4)),
        ([2, 3, 4], slice(2, 5)),
        ([2, 4], [2, 4]),
        ([3, 2], [3, 2]),
        ([2, 2], [2, 2]),
    ],
)
def test_neighbours_are_read_without_a_copy(
    columns: list[int], expected: slice | list[int]
) -> None:
    assert pick(columns) == expected
