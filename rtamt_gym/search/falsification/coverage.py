"""How much of a space the simulations of a search cover, and which inputs have no effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rtamt_gym.search.falsification.points import Floats, quasi_random, take
from rtamt_gym.tables import counted

__all__ = ["Coverage", "Effects", "coverage_of", "inputs_without_effect"]


class Effects(NamedTuple):
    """The inputs that did not change the robustness.

    Attributes:
        without: The names of the inputs.
        simulations: The number of simulations that showed this.
    """

    without: tuple[str, ...] = ()
    simulations: int = 0

    def __str__(self) -> str:
        runs = counted(self.simulations, "further simulation")
        return (
            f"no effect on the robustness: {', '.join(self.without)} (each alone at the other end "
            f"of its range, {runs})"
        )


def inputs_without_effect(
    groups: Mapping[str, slice],
    bases: Sequence[Floats],
    run: Callable[[int, Sequence[Floats]], Sequence[object]],
) -> Effects:
    """Return the inputs that do not change the result of a simulation at any base point.

    Each input is moved alone, to the farther end of its range. An input that changes the result at
    one base point is not moved at the next.

    Args:
        groups: The coordinates of each input.
        bases: Points of the unit cube.
        run: Runs the points for the base point of an index, and returns their results.

    Example:
        >>> low, high = np.zeros(2), np.ones(2)
        >>> groups = {"inflow": slice(0, 1), "spare": slice(1, 2)}
        >>> inputs_without_effect(groups, [low, high], lambda _, points: [p[0] for p in points])
        Effects(without=('spare',), simulations=5)
    """
    left, count = list(groups), 0
    for index, base in enumerate(bases):
        if not left:
            break
        points = [base.copy() for _ in range(len(left) + 1)]
        for name, point in zip(left, points[1:], strict=True):
            group = groups[name]
            point[group] = 0.0 if float(np.mean(base[group])) > 0.5 else 1.0
        first, *others = run(index, points)
        count += len(points)
        left = [name for name, other in zip(left, others, strict=True) if other == first]
    return Effects(tuple(left), count)


_PROBES: Final = 512
"""The points whose distances are measured: a power of two keeps a Sobol sequence balanced."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much of a space simulations cover. It guarantees nothing about the points between them.

    Attributes:
        simulations: The number of judged simulations; simulations that an error ended do not count.
        columns: The number of columns of the space.
        gap: The widest part of a column's range without a simulation, as a share of the range; the
            maximum over all columns, which are examined separately.
        distance: The median distance of evenly spread cases to the nearest simulation: the largest
            difference in a column, as a share of its range. All columns count together: with many
            columns it is large after any affordable number of simulations.
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
    """Return how much of the unit cube the points cover, an array of shape (points, dimension).

    Without points, the gap and the distance are 1.
    """
    count, dimension = points.shape
    ends = np.zeros((1, dimension)), np.ones((1, dimension))
    gap = np.diff(np.sort(np.concatenate([*ends, points]), axis=0), axis=0).max()
    probes = take(quasi_random(dimension, np.random.default_rng(0)), _PROBES, dimension)
    distances = [float(np.abs(points - probe).max(axis=1).min(initial=1.0)) for probe in probes]
    return Coverage(count, dimension, float(gap), float(np.median(distances)))
