"""The robustness of a few requirements by their definitions, in NumPy and without rtamt.

A course of samples is an array; a sample that is not known is nan, and so is what reads it. Before
the first sample there is nothing: a least value over nothing is inf, a greatest one is -inf.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Course = np.ndarray[Any, np.dtype[np.float64]]


class Requirement(NamedTuple):
    """A requirement, and what it means.

    Attributes:
        text: The formula over `cmd.linear.x` and `cmd.angular.z`, at 100 samples a second.
        means: Its robustness at every sample, from the courses of both.
        late: Samples after which the robustness at a sample is known.
    """

    text: str
    means: Callable[[Course, Course], Course]
    late: int = 0


def windows(course: Course, first: int, last: int, empty: float) -> Course:
    """For each sample those from `first` to `last` after it, as rows; `empty` beyond the ends."""
    before, after = max(0, -first), max(0, last)
    padded = np.concatenate([np.full(before, empty), course, np.full(after, empty)])
    rows = np.lib.stride_tricks.sliding_window_view(padded, last - first + 1)
    begin = before + first
    return rows[begin : begin + len(course)]


def least(course: Course, first: int, last: int) -> Course:
    """The least of a window around each sample."""
    return windows(course, first, last, np.inf).min(axis=1)


def greatest(course: Course, first: int, last: int) -> Course:
    """The greatest of a window around each sample."""
    return windows(course, first, last, -np.inf).max(axis=1)


def since(left: Course, right: Course, last: int) -> Course:
    """`left since[0:last] right`: the best sample of `right`, with all of `left` after it."""
    found = np.full(len(left), -np.inf)
    held = np.full(len(left), np.inf)  # the least of `left` in (now - back, now]
    for back in range(min(last + 1, len(left))):
        at = np.concatenate([np.full(back, -np.inf), right[: len(right) - back]])
        found = np.maximum(found, np.minimum(at, held))
        until = np.concatenate([np.full(back, np.inf), left[: len(left) - back]])
        held = np.minimum(held, until)
    return found


REQUIREMENTS = {
    "x": Requirement("cmd.linear.x >= 0", lambda x, _: x - 0.0),
    "z": Requirement("cmd.angular.z >= 0", lambda _, z: z - 0.0),
    "kept": Requirement(
        "historically[0:0.3s](cmd.linear.x >= 0.2)", lambda x, _: least(x - 0.2, -30, 0)
    ),
    "near": Requirement(
        "once[0.1s:0.5s](abs(cmd.linear.x - cmd.angular.z) <= 0.1)",
        lambda x, z: greatest(0.1 - np.abs(x - z), -50, -10),
    ),
    "after": Requirement(
        "cmd.linear.x <= 0.9 since[0:1s] cmd.angular.z >= 0.5",
        lambda x, z: since(0.9 - x, z - 0.5, 100),
    ),
    "answer": Requirement(
        "always[0:0.2s](cmd.linear.x >= 0.7 implies eventually[0:0.3s](cmd.angular.z >= 0.7))",
        lambda x, z: least(np.maximum(-(x - 0.7), greatest(z - 0.7, 0, 30)), 0, 20),
        50,
    ),
    "whole": Requirement(
        "always(cmd.linear.x >= 0.01)", lambda x, _: np.minimum.accumulate(x - 0.01)
    ),
}
"""`x` and `z` say what a sample held; the others are judged on it."""
