"""`RobustnessMap`: the robustness of a requirement over two columns of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.space import Space
from rtamt_gym.play.record import Record
from rtamt_gym.tables import shorten, table

__all__ = ["RobustnessMap", "map_of", "text_of", "two_of"]

Floats = NDArray[np.float64]

_WIDEST: Final = 80
"""The columns of a terminal."""


@dataclass(frozen=True, eq=False)
class RobustnessMap:
    """The robustness of a requirement over two columns.

    Attributes:
        requirement: The name of the requirement.
        x: The column that runs to the right.
        y: The column that runs upwards in a picture and downwards in a table.
        at: The x and y of each simulation with a robustness, shape (n, 2).
        values: The robustness of these simulations, shape (n,).
        xs: The different numbers of x, increasing.
        ys: The different numbers of y, increasing.
        cells: The robustness of each pair of numbers, shape (ys, xs), nan for failures; None if the
            simulations are not a grid.
        folded: Whether a cell is the minimum of several simulations.
    """

    requirement: str
    x: str
    y: str
    at: Floats
    values: Floats
    xs: Floats
    ys: Floats
    cells: Floats | None
    folded: bool

    def lines(self) -> list[str]:
        """Return the cells as a table for a terminal; empty if they are not a grid, or too wide."""
        if self.cells is None:
            return []
        rows = [(shorten(self.y, 24), *(f"{x:.4g}" for x in self.xs))]
        for y, cells in zip(self.ys, self.cells, strict=True):
            rows.append((f"{y:.4g}", *map(text_of, cells)))
        lines = table(rows, ">" * len(rows[0]))
        if max(map(len, lines)) > _WIDEST:
            return []
        minimum = ", minimum over all else" if self.folded else ""
        return [f"robustness of {self.requirement} over {self.x}{minimum}:", *lines]


def map_of(
    record: Record, space: Space, x: str | None, y: str | None, requirement: str | None
) -> RobustnessMap:
    """Return the map of a requirement over two columns, by default of a space with only two.

    Raises:
        InputError: If a column or requirement is unknown or must be named, or no simulation has a
            robustness.
    """
    name = record.name(requirement)
    x, y = two_of(space.columns, x, y)
    numbers = np.stack([record.numbers(x), record.numbers(y)], axis=1)
    heights = record.robustness_values(name)
    known = ~np.isnan(heights)
    if not known.any():
        raise InputError(f"cannot draw a map: no simulation has a robustness of {name!r}")
    xs, i = np.unique(numbers[:, 0], return_inverse=True)
    ys, j = np.unique(numbers[:, 1], return_inverse=True)
    counts = np.zeros((len(ys), len(xs)), np.int64)
    np.add.at(counts, (j, i), 1)
    cells: Floats | None = None
    if counts.all():
        cells = np.full(counts.shape, np.nan)
        np.fmin.at(cells, (j, i), heights)  # the minimum of the known values
    folded = cells is not None and bool((counts > 1).any())
    return RobustnessMap(name, x, y, numbers[known], heights[known], xs, ys, cells, folded)


def two_of(columns: Sequence[str], x: str | None, y: str | None) -> tuple[str, str]:
    """Return the columns of a map, by default the second and the first of a space with only two.

    Raises:
        InputError: If a column is unknown or must be named.
    """
    if x is None or y is None:
        if len(columns) != 2 or x is not y:
            raise InputError(
                f"expected x and y, two of the columns {listing(columns)}, got ",
                Argument("x", x),
                " and ",
                Argument("y", y),
            )
        y, x = columns
    for column in (x, y):
        if column not in columns:
            raise InputError(
                f"unknown column {column!r}; the space has "
                f"{listing(columns)}{nearest(column, columns)}"
            )
    if x == y:
        raise InputError(f"expected two different columns, got {x!r} as x and as y")
    return x, y


def text_of(value: float) -> str:
    """Return a robustness with three digits after the point, or fewer if it is large.

    Example:
        >>> text_of(-0.70512), text_of(1234.5), text_of(float("nan"))
        ('-0.705', '1234', 'failed')
    """
    if np.isnan(value):
        return "failed"
    return f"{value:.3f}" if abs(value) < 100 else f"{value:.4g}"
