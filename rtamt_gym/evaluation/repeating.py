"""Whether a seed repeats an episode: its first observation, and its robustness in a replay."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Mapping
from typing import Any, Final, NoReturn

import numpy as np
from gymnasium.vector import VectorEnv

from rtamt import InputError
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.play.run import Run
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import number

HOW_TO_REPEAT: Final = (
    "give a function that makes an environment whose reset(seed=...) chooses all that is random: "
    "Meta-World wants env.set_task(task) before a reset, robosuite rtamt_gym.benchmarks"
)
"""What to do about an environment that seeds do not repeat."""


HOW_TO_REPLAY: Final = (
    "the policy or the environment draws numbers that the seed does not choose, or the policy "
    "keeps a state between episodes. Give a class of policies, which is made anew as "
    "Class(seed=...) for each episode; a network may also round differently in a batch (n_envs=)"
)
"""Why a replay may differ from the recorded episode, and what to do about it."""

_ROUNDING: Final = 1e-6
"""The relative difference of robustness that networks make by rounding in a batch."""


class UnrepeatedSeedWarning(UserWarning):
    """A seed did not repeat an episode: its first observation, or its robustness in a replay."""


def repeats(env: Any, seed: int) -> bool | None:  # noqa: ANN401 - an environment, or many
    """Return whether two resets with a seed show the same observation; None if a reset fails.

    It costs two resets, and leaves the environment reset.
    """
    seeds: Any = [seed] * env.num_envs if isinstance(env, VectorEnv) else seed
    try:
        first, _ = env.reset(seed=seeds)
        stored = copy.deepcopy(first)  # which an environment may write the next one into
        second, _ = env.reset(seed=seeds)
    except (Exception, SystemExit):  # noqa: BLE001 - the episodes will say it
        return None
    return alike(stored, second)


def tell_unrepeated(name: str, seed: int) -> None:
    """Warn that seeds do not repeat episodes of an environment."""
    warnings.warn(
        f"two resets of {name} with seed {seed} begin differently: the same call plays other "
        f"episodes, none is played again, and compare refuses to pair them; {HOW_TO_REPEAT}",
        UnrepeatedSeedWarning,
        stacklevel=caller_level(),
    )


def difference(row: Trial, run: Run) -> str:
    """Return the first requirement with a different replay, or an empty string.

    Args:
        row: The recorded episode.
        run: The episode of the same seed, played again and stopped as the recorded one.
    """
    for name, outcome in row.outcomes.items():
        course = run.histories[name]
        same = math.isclose(course.final, outcome.robustness, rel_tol=_ROUNDING) or (
            math.isnan(course.final) and math.isnan(outcome.robustness)
        )
        if course.verdict is not outcome.verdict or not same:
            return (
                f"{name} had robustness {number(outcome.robustness)} ({outcome.verdict.name}), and "
                f"{number(course.final)} ({course.verdict.name}) when it was played again"
            )
    return ""


def warn_of_difference(name: str, seed: int, differing: str) -> None:
    """Warn that the replay of an episode differs from the recorded episode."""
    warnings.warn(
        f"episode {seed} of {name} does not repeat: {differing}; {HOW_TO_REPLAY}",
        UnrepeatedSeedWarning,
        stacklevel=caller_level(),
    )


def refuse_unrepeated(name: str) -> NoReturn:
    """Refuse to pair episodes of an environment by seeds that do not repeat them."""
    raise InputError(
        f"cannot pair episodes of {name} by their seeds: two resets with one seed begin "
        f"differently; {HOW_TO_REPEAT}"
    )


def alike(a: Any, b: Any) -> bool:  # noqa: ANN401 - observations of any space
    """Return whether two observations are the same; nan is the same as nan.

    Example:
        >>> alike({"x": np.array([1.0, np.nan])}, {"x": np.array([1.0, np.nan])})
        True
        >>> alike((1, "a"), (1, "b"))
        False
    """
    if isinstance(a, Mapping):
        return isinstance(b, Mapping) and a.keys() == b.keys() and all(alike(a[n], b[n]) for n in a)
    if isinstance(a, list | tuple):
        same = isinstance(b, list | tuple) and len(a) == len(b)
        return same and all(alike(one, two) for one, two in zip(a, b, strict=True))
    one, two = np.asarray(a), np.asarray(b)
    numbers = one.dtype.kind in "fc" and two.dtype.kind in "fc"
    return bool(np.array_equal(one, two, equal_nan=numbers))
