"""`Coverage`: how much of a space simulations have seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rtamt_gym.search.falsification.points import quasi_random, take
from rtamt_gym.search.falsification.protocol import Floats

__all__ = ["Coverage", "coverage_of"]

_PROBES: Final = 512
"""The points whose distances are measured: a power of two, which a Sobol sequence is even for."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much of a space simulations cover. It guarantees nothing about the points between them.

    Attributes:
        simulations: The number of judged simulations; simulations that an error ended do not count.
        columns: The number of columns of the space.
        gap: The widest part of a column's range without a simulation, as a share of the range; the
            maximum over all columns, which are examined separately.
        distance: The median distance of evenly spread cases to the nearest simulation: the largest
            difference in a column, as a share of its range. Columns are looked at together: in many
            columns it is large after any number of simulations that one can afford.
    """

    simulations: int
    columns: int
    gap: float
    distance: float

    def __str__(self) -> str:
        simulations = "simulation" if self.simulations == 1 else "simulations"
        one = self.columns == 1
        return (
            f"{self.simulations} {simulations} in {self.columns} {'column' if one else 'columns'}: "
            f"largest untested part of any range: {100 * self.gap:.0f} %; half of all possible "
            f"inputs are {100 * self.distance:.0f} % of a range or more from every simulated input"
        )


def coverage_of(points: Floats) -> Coverage:
    """How much of the unit cube points have seen: an array of shape (points, dimension).

    No points have seen nothing: the gap is all of a range, and no case is near.
    """
    count, dimension = points.shape
    ends = np.zeros((1, dimension)), np.ones((1, dimension))
    gap = np.diff(np.sort(np.concatenate([*ends, points]), axis=0), axis=0).max()
    probes = take(quasi_random(dimension, np.random.default_rng(0)), _PROBES, dimension)
    distances = [float(np.abs(points - probe).max(axis=1).min(initial=1.0)) for probe in probes]
    return Coverage(count, dimension, float(gap), float(np.median(distances)))
