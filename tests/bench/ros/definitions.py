"""The robustness of several requirements by their definitions, in NumPy and without rtamt.

A signal is an array of samples. An unknown sample is nan, and so is every value that depends on it.
Before the first sample a minimum is inf and a maximum -inf.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Course = np.ndarray[Any, np.dtype[np.float64]]


class Requirement(NamedTuple):
    """A requirement and its definition.

    Attributes:
        text: The formula over `cmd.linear.x` and `cmd.angular.z`, at 100 samples per second.
        means: Returns its robustness at every sample from both signals.
        late: The number of samples after which the robustness at a sample is known.
    """

    text: str
    means: Callable[[Course, Course], Course]
    late: int = 0


def windows(course: Course, first: int, last: int, empty: float) -> Course:
    """Return, for each sample, the samples `first` to `last` after it as rows; `empty` outside."""
    before, after = max(0, -first), max(0, last)
    padded = np.concatenate([np.full(before, empty), course, np.full(after, empty)])
    rows = np.lib.stride_tricks.sliding_window_view(padded, last - first + 1)
    begin = before + first
    return rows[begin : begin + len(course)]


def least(course: Course, first: int, last: int) -> Course:
    """Return the minimum of a window around each sample."""
    return windows(course, first, last, np.inf).min(axis=1)


def greatest(course: Course, first: int, last: int) -> Course:
    """Return the maximum of a window around each sample."""
    return windows(course, first, last, -np.inf).max(axis=1)


def since(left: Course, right: Course, last: int) -> Course:
    """Return `left since[0:last] right`: the best of `right`, with all of `left` after it."""
    best = np.full(len(left), -np.inf)
    held = np.full(len(left), np.inf)  # the minimum of `left` in (now - back, now]
    for back in range(min(last + 1, len(left))):
        delayed = np.concatenate([np.full(back, -np.inf), right[: len(right) - back]])
        best = np.maximum(best, np.minimum(delayed, held))
        until = np.concatenate([np.full(back, np.inf), left[: len(left) - back]])
        held = np.minimum(held, until)
    return best


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
"""`x` and `z` are the values that a sample held; the others are evaluated on them."""
