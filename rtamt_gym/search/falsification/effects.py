"""Inputs without an effect on the robustness, found by moving each to its other end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rtamt_gym.search.falsification.protocol import Floats
from rtamt_gym.tables import counted

__all__ = ["Effects", "inputs_without_effect"]


class Effects(NamedTuple):
    """The inputs that did not change the robustness.

    Attributes:
        without: The names of the inputs.
        simulations: The number of simulations for this.
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
    """Return the inputs that leave the result of a simulation as it is, on all base points.

    Each input is moved alone, to the end of its range that is farther away. An input that changes
    the result on one base point is not moved on the next.

    Args:
        groups: The coordinates of each input.
        bases: Points of the unit cube.
        run: Runs simulations of points next to a base point, which has an index, and returns their
            results.

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
