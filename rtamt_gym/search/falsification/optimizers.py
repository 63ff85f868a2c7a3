"""Optimizers by name: how a search chooses its points.

To add an optimizer, such as ``"tpe"``: a function and a row of `OPTIMIZERS`. The tests run
`check_optimizer` on every row. List it in the table of ``docs/falsification.md``. ``rtamt falsify
--help`` shows the first line of its docstring, so run ``tests/support/command_options.py``, which
writes ``docs/reference/commands.md``.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from itertools import count
from typing import Final

import numpy as np

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.plugins import plugins
from rtamt_gym.search.falsification.evolution import Climb, population_of
from rtamt_gym.search.falsification.points import extremes, quasi_random, take
from rtamt_gym.search.falsification.portfolio import portfolio
from rtamt_gym.search.falsification.protocol import Evaluate, Optimizer

__all__ = ["GROUP", "OPTIMIZERS", "OptimizerLike", "described", "find_optimizer", "optimizers"]

OptimizerLike = str | Optimizer
"""The name of an optimizer, or one's own."""

_BATCH: Final = 64
"""The points that are asked for at once where their number is free."""


def find_optimizer(given: OptimizerLike) -> Optimizer:
    """The optimizer of a name; one's own as it is.

    Raises:
        InputError: If the optimizer is unknown.
        InputTypeError: If it is neither a name nor a function.
    """
    if isinstance(given, str):
        known = optimizers()
        if given not in known:
            raise InputError(
                f"unknown optimizer {given!r}; the optimizers are "
                f"{listing(known)}{nearest(given, known)}"
            )
        return known[given]
    if not callable(given):
        raise InputTypeError(
            "expected ",
            Argument("optimizer"),
            f" as a name or a function (evaluate, dimension, rng), got {given!r}",
        )
    return given


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
"""The optimizers by name; ``--help`` has the first line of each docstring."""

GROUP: Final = "rtamt.optimizers"
"""The entry points of other packages that add an optimizer under their name."""


def optimizers() -> Mapping[str, Optimizer]:
    """Return the optimizers of this and other packages, by name.

    Raises:
        InputError: If an added optimizer is not a function, or its name is taken.
    """
    added = plugins(GROUP)
    for name, optimizer in added.items():
        if name in OPTIMIZERS or not callable(optimizer):
            raise InputError(
                f"expected a function with a name of its own as the entry point {name!r} of "
                f"{GROUP}, got {optimizer!r}"
            )
    return {**OPTIMIZERS, **added}


def described() -> str:
    """A sentence about each optimizer, the first line of its docstring."""
    return "; ".join(
        f"{name}: {(inspect.getdoc(optimizer) or 'no docstring').partition(chr(10))[0].rstrip('.')}"
        for name, optimizer in optimizers().items()
    )
