"""The effects of columns in a sweep: a map of the robustness, and sensitivity indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.space import Space
from rtamt_gym.play.record import Record
from rtamt_gym.search.sweeps.samplers import LEVELS, Sampler, problem_of, sample
from rtamt_gym.tables import counted, shorten, table

if TYPE_CHECKING:
    import pandas as pd


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
    """Return the map of a requirement over two columns, by default of a space with only two."""
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
    """Return the columns of a map, by default the second and the first of a space with only two."""
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


_MEASURES: Final = {
    "morris": {
        "mu*": "mu_star",
        "mu* +-": "mu_star_conf",
        "mu": "mu",
        "sigma": "sigma",
    },
    "saltelli": {"ST": "ST", "ST +-": "ST_conf", "S1": "S1", "S1 +-": "S1_conf"},
}
"""The names of the indices for each sampler, here and in SALib. The first index sorts the rows."""


@dataclass(frozen=True, eq=False)
class Indices:
    """How much each column of a space moves the robustness of a requirement, in descending order.

    A sweep with Morris's trajectories gives ``mu*``, the mean size of the change by a step in a
    column (in the unit of the robustness, for a step over the whole range), ``mu``, the same with
    its sign, and ``sigma``, its standard deviation, which is large where columns interact or act
    nonlinearly. Saltelli's points give ``S1``, the share of the variance that a column explains
    alone, and ``ST``, the share with its interactions. ``+-`` is half of the 95 % interval.

    Attributes:
        requirement: The name of the requirement.
        sampler: The sampler that chose the points, ``"morris"`` or ``"saltelli"``.
        names: The columns of the space.
        values: The indices by their names, an array for each with a number for every column.
    """

    requirement: str
    sampler: Sampler
    names: tuple[str, ...]
    values: Mapping[str, NDArray[np.float64]]

    def to_frame(self) -> pd.DataFrame:
        """Return the indices as a data frame of pandas, a row for each column of the space."""
        try:
            import pandas as pd
        except ModuleNotFoundError as error:
            raise naming_extra(error, "Indices.to_frame") from error
        return pd.DataFrame(dict(self.values), index=pd.Index(self.names, name=self.requirement))

    def __str__(self) -> str:
        head = ("varied", *self.values)
        # Rounding errors are shown as 0.
        limit = 1e-12 * max(float(np.abs(values).max()) for values in self.values.values())
        shown = [np.where(np.abs(values) > limit, values, 0.0) for values in self.values.values()]
        rows = [
            (shorten(name, 32), *(f"{values[i]:.4g}" for values in shown))
            for i, name in enumerate(self.names)
        ]
        title = f"what moves {shorten(self.requirement, 60)}:"
        return "\n".join([title, *table([head, *rows], "<" + ">" * len(self.values))])


def indices(
    record: Record, space: Space, sampler: Sampler, seed: int, requirement: str | None = None
) -> Indices:
    """Return the sensitivity indices of a requirement over the record of a sweep.

    Raises:
        InputError: If the sampler is neither Morris's nor Saltelli's, a simulation failed or was
            stopped, or the robustness is not finite or the same everywhere.
        ModuleNotFoundError: If SALib, of the extra ``search``, is not installed.
    """
    if sampler not in _MEASURES:
        raise InputError(
            "indices need ",
            Argument("sampler", "morris"),
            f" or 'saltelli', got a sweep with {sampler!r}",
        )
    name = record.name(requirement)
    heights = _heights(record, name)
    try:
        result = _analyzed(space, sampler, seed, heights)
    except ModuleNotFoundError as error:
        raise naming_extra(error, "indices", "search") from error
    measured = _MEASURES[sampler]
    order = np.argsort(
        -np.asarray(result[next(iter(measured.values()))], np.float64), kind="stable"
    )
    return Indices(
        name,
        sampler,
        tuple(space.columns[i] for i in order),
        {ours: np.asarray(result[theirs], np.float64)[order] for ours, theirs in measured.items()},
    )


def _heights(record: Record, name: str) -> NDArray[np.float64]:
    """Return the robustness of every simulation; raise InputError if one has no finite value."""
    failed = sum(1 for row in record if row.error or name not in row.outcomes)
    if failed:
        raise InputError(
            f"indices need every simulation of a sweep, and {counted(failed, 'simulation')} of "
            f"{len(record)} failed"
        )
    if any(row.ended in {"violation", "decided"} for row in record):
        raise InputError(
            "indices need simulations up to their end, and some were stopped; sweep with ",
            Argument("stop", "end"),
        )
    heights = record.robustness_values(name)
    infinite = int(np.count_nonzero(~np.isfinite(heights)))
    if infinite:
        raise InputError(
            f"indices need a finite robustness, and {name!r} has an infinite one in "
            f"{counted(infinite, 'simulation')} of {len(record)}"
        )
    if np.ptp(heights) == 0.0:
        raise InputError(
            f"the robustness of {name!r} is {heights[0]:g} in every simulation: nothing moves it"
        )
    return heights


def _analyzed(space: Space, sampler: Sampler, seed: int, heights: NDArray[np.float64]) -> Any:  # noqa: ANN401 - SALib is not typed
    from SALib.analyze import morris, sobol

    problem = problem_of(space)
    salib_seed = seed + 1  # SALib ignores a seed of 0
    if sampler == "saltelli":
        return sobol.analyze(problem, heights, calc_second_order=False, seed=salib_seed)
    count = len(heights) // (space.dimension + 1)
    points = sample(space, count, sampler, seed)
    return morris.analyze(problem, points, heights, num_levels=LEVELS, seed=salib_seed)
