"""Optimizers by name: how a search chooses its points.

To add an optimizer, such as ``"tpe"``: a function and a row of `OPTIMIZERS`. The tests run
`check_optimizer` on every row. List it in the table of ``docs/falsification.md``. ``rtamt falsify
--help`` shows the first line of its docstring, so run ``tests/support/command_options.py``, which
writes ``docs/reference/commands.md``. Errors in ``tests/rtamt_gym/search/test_falsify_errors.py``
and ``tests/rtamt_gym/commands/falsify.txt`` list all optimizers. A library is an extra, as for a
trace format in `rtamt_gym.recorded.readers`.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any, Final

import numpy as np

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.extras import plugins
from rtamt_gym.checks.names import listing
from rtamt_gym.search.falsification.points import (
    Evaluate,
    Floats,
    Optimizer,
    extremes,
    quasi_random,
    spread,
    take,
)

_STALL: Final = 12
"""A climb ends after this many generations without a better value."""

_BETTER: Final = 1e-3
"""The minimum improvement of a better value, as a share of the best so far."""


def population_of(dimension: int) -> int:
    """Return the usual number of points in a generation: ``4 + 3 log(dimension)``."""
    return 4 + int(3 * math.log(max(dimension, 2)))


class Climb:
    """One run of CMA-ES from a start, by the package ``cma``; its points are in the unit cube.

    A point outside the cube is moved to the nearest point inside, and gets the value of that point.
    This reaches the extremes of inputs, where many violations are, at once.

    Attributes:
        over: Whether the run has converged, or has not improved for twelve generations.
        level: The median of the last generation, or infinite. The better half makes the next
            generation, so the exact values of points above the median rarely matter.
    """

    def __init__(
        self, start: Floats, rng: np.random.Generator, *, sigma: float, population: int
    ) -> None:
        import cma

        # By default, the package draws from NumPy's global generator, which belongs to the caller.
        generator = np.random.RandomState(int(rng.integers(1, 2**31)))
        options = {
            "seed": math.nan,
            "randn": generator.randn,
            "verbose": -9,
            "verb_log": 0,
            "tolfun": 1e-3,
            "popsize": population,
        }
        self.over = False
        self.level = math.inf
        self._dimension = len(start)
        self._best = math.inf
        self._stalled = 0
        self._points: list[Any] = []
        # The package refuses one dimension, so add a second that nothing reads.
        mean = np.resize(start, max(len(start), 2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._strategy: Any = cma.CMAEvolutionStrategy(mean, sigma, options)

    def ask(self) -> Floats:
        """Return the points of the next generation, shape (points, dimension)."""
        self._points = self._strategy.ask()
        return np.array(self._points)[:, : self._dimension].clip(0.0, 1.0)

    def tell(self, values: Floats) -> None:
        """Pass the values of the points that `ask` returned."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # flat values cause a warning, and end the climb
            self._strategy.tell(self._points, values.tolist())
            ended = bool(self._strategy.stop())
        minimum = float(values.min())
        if minimum < self._best - _BETTER * abs(self._best) or not math.isfinite(self._best):
            self._best = minimum
            self._stalled = 0
        else:
            self._stalled += 1
        self.over = ended or self._stalled >= _STALL
        self.level = float(np.median(values))


_CORNERS: Final = 16
"""The maximum number of corners to run."""

_POINTS: Final = 24
"""The quasi-random points before the first climb."""

_POPULATION: Final = 12
"""The points of a generation."""

_SIGMA: Final = 0.45
"""The standard deviation of the first generation of a climb."""

_EVERY: Final = 6
"""The number of generations after which as many quasi-random points follow as one has."""

_FLAT: Final = 8
"""The generations of quasi-random points before a climb on flat values."""

_STARTS: Final = 4
"""The exact value of a quasi-random point matters if it is among this many best unused points."""


def portfolio(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """Corners, then quasi-random points, then CMA-ES with restarts from the best of these.

    All inputs constant at the ends of their ranges come first, 16 such points at most. Then come 24
    quasi-random points, see `spread`. CMA-ES climbs from the best of them, with 12 points in a
    generation; after every sixth generation come 12 more quasi-random points. When a climb has
    converged or made no progress in 12 generations, the next starts at the best unused point. If a
    quarter of the points share the minimum, up to 96 more points, even in the whole space, come
    before a climb: such plateaus occur with requirements about events, such as shifts of gears,
    which inputs with large movements cause.
    """
    corners = take(extremes(evaluate.groups), _CORNERS, dimension)
    starts = _Starts(spread(evaluate.groups, rng), dimension)
    starts.evaluate(evaluate, corners, _POINTS)
    even = quasi_random(dimension, rng)
    generations = 0
    while True:
        for _ in range(_FLAT):
            if starts.flat:
                starts.evaluate(evaluate, take(even, _POPULATION, dimension), 0)
        climb = Climb(starts.take(), rng, sigma=_SIGMA, population=_POPULATION)
        while not climb.over:
            climb.tell(evaluate(climb.ask(), climb.level))
            generations += 1
            if generations % _EVERY == 0:
                starts.evaluate(evaluate, np.empty((0, dimension)), _POPULATION)


class _Starts:
    """Points with their values; each climb starts at the best unused point."""

    def __init__(self, spread: Iterator[Floats], dimension: int) -> None:
        self._spread = spread
        self._dimension = dimension
        self._points = np.empty((0, dimension))
        self._values = np.empty(0)

    def evaluate(self, evaluate: Evaluate, points: Floats, count: int) -> None:
        """Evaluate points, and `count` further points of the sequence."""
        more = np.concatenate([points, take(self._spread, count, self._dimension)])
        best = np.sort(self._values)[:_STARTS]
        values = evaluate(more, best[-1] if len(best) == _STARTS else math.inf)
        self._points = np.concatenate([self._points, more])
        self._values = np.concatenate([self._values, values])

    @property
    def flat(self) -> bool:
        """Whether a quarter of the points share the minimum, which then shows no direction."""
        ties = np.count_nonzero(self._values == self._values.min())
        return bool(4 * ties >= len(self._values))

    def take(self) -> Floats:
        """Return the best unused point, and mark it as used."""
        index = int(self._values.argmin())
        self._values[index] = math.inf
        point: Floats = self._points[index]
        return point


OptimizerLike = str | Optimizer
"""The name of an optimizer, or a function."""

_BATCH: Final = 64
"""The points per call of optimizers that can evaluate any number at once."""


def find_optimizer(optimizer: OptimizerLike) -> Optimizer:
    """Return the optimizer of a name; return a function unchanged."""
    if isinstance(optimizer, str):
        known = optimizers()
        if optimizer not in known:
            raise InputError(
                f"unknown optimizer {optimizer!r}; the optimizers are "
                f"{listing(known)}{nearest(optimizer, known)}"
            )
        return known[optimizer]
    if not callable(optimizer):
        raise InputTypeError(
            "expected ",
            Argument("optimizer"),
            f" as a name or a function (evaluate, dimension, rng), got {optimizer!r}",
        )
    return optimizer


def _random(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """Independent uniform points."""
    while True:
        evaluate(rng.random((_BATCH, dimension)))


def _sobol(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """A scrambled Sobol sequence."""
    points = quasi_random(dimension, rng)
    while True:
        evaluate(take(points, _BATCH, dimension))


def _corners(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:  # noqa: ARG001 - an optimizer's
    """Constant inputs at the ends of their ranges, then points at these ends."""
    for groups in (evaluate.groups, [slice(i, i + 1) for i in range(dimension)]):
        points = extremes(groups)
        while len(batch := take(points, _BATCH, dimension)):
            evaluate(batch)


def _cma(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """CMA-ES from random starts with growing populations."""
    for number in count():
        size = population_of(dimension) * 2 ** (number // 2)
        climb = Climb(rng.random(dimension), rng, sigma=0.3, population=size)
        while not climb.over:
            climb.tell(evaluate(climb.ask(), climb.level))


def _dual_annealing(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """Dual annealing of SciPy."""
    from scipy.optimize import dual_annealing

    def value(point: np.ndarray) -> float:
        return float(evaluate(point[None].clip(0.0, 1.0))[0])

    while True:
        dual_annealing(value, [(0.0, 1.0)] * dimension, seed=rng)


def _differential_evolution(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """Differential evolution of SciPy, a generation at a time."""
    from scipy.optimize import differential_evolution

    while True:
        differential_evolution(
            lambda points: evaluate(points.reshape(dimension, -1).T.clip(0.0, 1.0)),
            [(0.0, 1.0)] * dimension,
            vectorized=True,
            updating="deferred",
            polish=False,
            seed=rng,
        )


def _tpe(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """The tree-structured Parzen estimator of Optuna."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=int(rng.integers(2**31))))
    while True:
        trial = study.ask()
        point = [trial.suggest_float(str(i), 0.0, 1.0) for i in range(dimension)]
        study.tell(trial, float(evaluate([point])[0]))


OPTIMIZERS: Final[Mapping[str, Optimizer]] = {
    "portfolio": portfolio,
    "random": _random,
    "sobol": _sobol,
    "corners": _corners,
    "cma": _cma,
    "dual_annealing": _dual_annealing,
    "differential_evolution": _differential_evolution,
    "tpe": _tpe,
}
"""The optimizers by name; ``--help`` shows the first line of each docstring."""

GROUP: Final = "rtamt.optimizers"
"""The group of entry points by which other packages add optimizers."""


def optimizers() -> Mapping[str, Optimizer]:
    """Return the optimizers of this and other packages, by name."""
    added = plugins(GROUP)
    for name, optimizer in added.items():
        if name in OPTIMIZERS or not callable(optimizer):
            raise InputError(
                f"expected a function with a name of its own as the entry point {name!r} of "
                f"{GROUP}, got {optimizer!r}"
            )
    return {**OPTIMIZERS, **added}


def described() -> str:
    """Return the first line of each optimizer's docstring, with the names."""
    return "; ".join(
        f"{name}: {(inspect.getdoc(optimizer) or 'no docstring').partition(chr(10))[0].rstrip('.')}"
        for name, optimizer in optimizers().items()
    )
