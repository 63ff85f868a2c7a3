"""Samplers: the points of a space to simulate, from their number and a seed.

To add a sampler, such as ``"lhs"``: its name in `Sampler`, a row of `_SAMPLERS` here, and its name
in ``_SAMPLERS`` of `rtamt_gym.commands.sweep`. Describe it in ``docs/sweeps.md``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import Argument, Message, nearest
from rtamt_gym.checks.arguments import check_choice, check_count
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.space import Parameter, Space

Sampler = Literal["grid", "sobol", "lhs", "random", "morris", "saltelli"]
"""The way to choose the points of a sweep; docs/sweeps.md describes each."""

SampleCount = int | Mapping[str, int]
"""The number of points; for a grid also the number of values by name."""

Points = NDArray[np.float64]

LEVELS: Final = 4
"""The levels of the grid on which Morris's trajectories run."""

_MOST: Final = 10_000_000
"""The maximum number of coordinates; more would take gigabytes before the first simulation."""


def sample(space: Space, samples: SampleCount, sampler: Sampler = "sobol", seed: int = 0) -> Points:
    """Return points of the unit cube of a space, shape (points, dimension).

    docs/sweeps.md describes the samplers and what ``samples`` counts. A seed always gives the same
    points. With ``"sobol"``, more points start with the same points as fewer.

    Source: M. D. Morris, Technometrics 33(2), 1991; A. Saltelli et al., Computer Physics
    Communications 181(2), 2010; both as SALib makes them.
    """
    check_choice("sampler", sampler, get_args(Sampler))
    if sampler == "grid":
        return _grid(space, samples)
    if isinstance(samples, Mapping):
        raise InputError(
            "expected ",
            Argument("samples"),
            " as one number with ",
            Argument("sampler", sampler),
            f", got {samples}",
        )
    count = check_count(Argument("samples"), samples)
    if sampler == "saltelli" and count & (count - 1):
        less = 1 << (count.bit_length() - 1)
        raise InputError(
            "expected ",
            Argument("samples"),
            " as a power of two with ",
            Argument("sampler", "saltelli"),
            f", got {count}; use {less} or {2 * less}",
        )
    if count * space.dimension > _MOST:
        raise InputError(f"expected fewer samples, got {count} in {space.dimension} columns")
    try:
        return _SAMPLERS[sampler](space, count, seed)
    except ModuleNotFoundError as error:
        raise naming_extra(error, f"sampler={sampler!r}", "search") from error


def problem_of(space: Space) -> dict[str, Any]:
    """Return the unit cube of a space in the form of SALib."""
    return {
        "num_vars": space.dimension,
        "names": list(space.columns),
        "bounds": [[0.0, 1.0]] * space.dimension,
    }


def _grid(space: Space, samples: SampleCount) -> Points:
    axes: list[Points] = []
    for entry, counts in zip(space, _counts(space, samples), strict=True):
        for count in counts:
            if isinstance(entry, Parameter) and entry.values is not None:
                size = len(entry.values)
                axes.append((np.arange(size) + 0.5) / size)  # the middles of equal parts
            else:  # a single value is the middle
                axes.append(np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5]))
    total = math.prod(map(len, axes))
    if total * len(axes) > _MOST:
        raise InputError(
            f"expected a smaller grid, got {total} points in {len(axes)} columns; ",
            Argument("sampler", "sobol"),
            " fills a space with any number of points",
        )
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _counts(space: Space, samples: SampleCount) -> list[list[int]]:
    """Return the number of values of each column, by entry of the space."""
    if not isinstance(samples, Mapping):
        count = check_count(Argument("samples"), samples)
        return [[count] * len(entry.columns) for entry in space]
    for name in samples:
        known = [entry.name for entry in space]
        if name not in known:
            raise InputError(
                Argument("samples"),
                f" names {name!r}, which is not varied; the space has {listing(known)}"
                f"{nearest(name, known)}",
            )
    counts = []
    for entry in space:
        chosen = isinstance(entry, Parameter) and entry.values is not None
        if chosen == (entry.name in samples):
            problem = f" gives no number for {entry.name!r}"
            if chosen:
                problem = (
                    f" gives a number for {entry.name!r}, which takes all of its values; omit it"
                )
            raise InputError(Argument("samples"), problem)
        count = (
            1
            if chosen
            else check_count(
                Message(Argument("samples"), f" of {entry.name!r}"), samples[entry.name]
            )
        )
        counts.append([count] * len(entry.columns))
    return counts


def _sobol(space: Space, count: int, seed: int) -> Points:
    from scipy.stats import qmc

    # The sequence is balanced at powers of two; a shorter one is its start.
    sequence = qmc.Sobol(space.dimension, seed=seed)
    points: Points = sequence.random_base2((count - 1).bit_length())
    return points[:count]


def _lhs(space: Space, count: int, seed: int) -> Points:
    from scipy.stats import qmc

    points: Points = qmc.LatinHypercube(space.dimension, seed=seed).random(count)
    return points


def _random(space: Space, count: int, seed: int) -> Points:
    return np.random.default_rng(seed).random((count, space.dimension))


def _morris(space: Space, count: int, seed: int) -> Points:
    from SALib.sample import morris

    points: Points = morris.sample(problem_of(space), count, num_levels=LEVELS, seed=seed)
    return points


def _saltelli(space: Space, count: int, seed: int) -> Points:
    from SALib.sample import sobol

    points: Points = sobol.sample(problem_of(space), count, calc_second_order=False, seed=seed)
    return points


_SAMPLERS: Final[Mapping[str, Callable[[Space, int, int], Points]]] = {
    "sobol": _sobol,
    "lhs": _lhs,
    "random": _random,
    "morris": _morris,
    "saltelli": _saltelli,
}
