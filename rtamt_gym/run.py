"""Episodes of an environment under specifications: every sample, and the outcome."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

import rtamt
from rtamt import InputError
from rtamt_gym.signals import SignalLike, parse_signals
from rtamt_gym.specs import View
from rtamt_gym.wrappers import OnViolation, StlMonitor

__all__ = [
    "POLICIES",
    "Course",
    "Episode",
    "Policies",
    "Policy",
    "Watched",
    "import_highway",
    "make",
]

Policy = Callable[[Any, int], Any]
"""The action for an observation at a step, from 0."""

Policies = Callable[[int], Policy]
"""The policy of an episode of a seed."""


@dataclass(frozen=True, slots=True)
class Course:
    """What became of one specification, sample by sample and in the end.

    Attributes:
        formula: What it demands.
        robustness: Robustness if the episode ended now.
        lower: The least that it can still become.
        upper: The greatest.
        final: The robustness in the end.
        verdict: ``"VIOLATED"``, ``"UNDECIDED"`` or ``"SATISFIED"``, at the end.
        decided_at: The sample that decided, or None.
    """

    formula: str
    robustness: Sequence[float]
    lower: Sequence[float]
    upper: Sequence[float]
    final: float
    verdict: str
    decided_at: int | None


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode under specifications.

    Attributes:
        env_id: The environment.
        seed: It can be run again with it.
        label: Who drove, or an empty string.
        period: Seconds between samples, or None.
        limit: Steps after which the time limit ends an episode, or None.
        signals: Values of every variable, sample by sample; sample 0 is the reset.
        courses: What became of every specification.
        ended: ``"violation"`` if the monitor ended the episode, else ``"terminated"`` or
            ``"truncated"``, as the environment did.
        violated_by: The specification that was violated first, or None.
        on_violation: What the monitor was asked to do.
    """

    env_id: str
    seed: int
    label: str
    period: Fraction | None
    limit: int | None
    signals: Mapping[str, Sequence[float]]
    courses: Mapping[str, Course]
    ended: str
    violated_by: str | None
    on_violation: OnViolation

    @property
    def steps(self) -> int:
        """How many steps were made."""
        return len(next(iter(self.courses.values())).robustness) - 1

    @property
    def saved(self) -> int | None:
        """Steps from the stop to the time limit; None if the monitor did not stop the episode."""
        if self.ended != "violation" or self.limit is None:
            return None
        return self.limit - self.steps


_Bounds = dict[str, tuple[list[float], list[float], list[float]]]
"""Robustness, lower and upper bound of every specification, sample by sample."""


class _Tap(gym.Wrapper[Any, Any, Any, Any]):
    """Keeps what the environment returned last, before a monitor around it sees it."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.last: tuple[Any, Any, Any, dict[str, Any]] = (None, None, None, {})
        self.ended = ""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        obs, info = self.env.reset(seed=seed, options=options)
        self.last, self.ended = (obs, None, None, info), ""
        return obs, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401
        obs, reward, terminated, truncated, info = self.env.step(action)
        self.last = (obs, action, reward, info)
        self.ended = "terminated" if terminated else "truncated" if truncated else ""
        return obs, reward, terminated, truncated, info


class Watched:
    """An environment whose episodes are watched and written down.

    Args:
        env: The environment.
        specs: The specifications by name.
        signals: What every variable reads; see `StlMonitor`.
        period: Seconds between samples; None asks the environment.
        on_violation: What a certain violation does to the episode.
        view: Whether formulas speak of the episode or of every step.
        limit: Time limit in steps, where the environment's own says none.

    Raises:
        RtamtError: As `StlMonitor` does.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        specs: Mapping[str, rtamt.Specification],
        signals: Mapping[str, SignalLike],
        *,
        period: float | str | None = None,
        on_violation: OnViolation = "terminate",
        view: View = "episode",
        limit: int | None = None,
    ) -> None:
        self._tap = _Tap(env)
        self._specs = specs
        self._on_violation = on_violation
        self._env: StlMonitor[Any, Any] = StlMonitor(
            self._tap,
            specs,
            signals,
            period=period,
            on_violation=on_violation,
            view=view,
            details=True,
        )
        variables = [v for spec in specs.values() for v in spec.variables]
        parsed = parse_signals(signals, variables)
        self._reads = [(s.name, s.bind_reset(self._tap), s.bind(self._tap)) for s in parsed]
        self._id = env.spec.id if env.spec else type(env.unwrapped).__name__
        self._limit = limit or (env.spec.max_episode_steps if env.spec else None)

    def episode(self, policies: Policies, seed: int, label: str = "") -> Episode:
        """Runs one episode to its end.

        Args:
            policies: Makes the policy of the episode from its seed.
            seed: Of the environment and of the policy.
            label: Who drives, for the table.
        """
        policy = policies(seed)
        obs, info = self._env.reset(seed=seed)
        signals = {name: [at_reset(*self._tap.last)] for name, at_reset, _ in self._reads}
        bounds: _Bounds = {name: ([], [], []) for name in self._specs}
        _note(bounds, info["stl"])
        steps = 0
        done = False
        while not done:
            obs, _, terminated, truncated, info = self._env.step(policy(obs, steps))
            steps += 1
            done = terminated or truncated
            for name, _, read in self._reads:
                signals[name].append(read(*self._tap.last))
            _note(bounds, info["stl"])
        courses = {
            name: Course(
                str(self._specs[name].formula),
                *bounds[name],
                outcome["robustness"],
                outcome["verdict"],
                outcome.get("decided_at"),
            )
            for name, outcome in info["stl_episode"].items()
        }
        return Episode(
            env_id=self._id,
            seed=seed,
            label=label,
            period=self._env.period,
            limit=self._limit,
            signals=signals,
            courses=courses,
            ended=self._tap.ended or "violation",
            violated_by=info.get("stl_violated_by"),
            on_violation=self._on_violation,
        )


def _note(bounds: _Bounds, stl: Mapping[str, Any]) -> None:
    for name, (robustness, lower, upper) in bounds.items():
        robustness.append(stl[name]["robustness"])
        lower.append(stl[name]["lower"])
        upper.append(stl[name]["upper"])


def make(env_id: str, max_steps: int | None = None) -> gym.Env[Any, Any]:
    """The environment of an id; those of highway-env are found without an import.

    Args:
        env_id: As `gymnasium.make` takes it.
        max_steps: Time limit in steps; None is the environment's own.

    Raises:
        InputError: If there is no such environment, or it cannot be made; names the nearest.
    """
    name = env_id.rpartition(":")[2].rpartition("-v")[0]
    if ":" not in env_id and not _known(name) and find_spec("highway_env"):
        import_highway()
    try:
        return gym.make(env_id, max_episode_steps=max_steps, disable_env_checker=True)
    except (gym.error.Error, ModuleNotFoundError) as error:
        hint = ""
        if isinstance(error, gym.error.NameNotFound) and not find_spec("highway_env"):
            hint = "; the environments of highway-env need pip install '.[highway]'"
        raise InputError(f"cannot make {env_id}: {error}{hint}") from error


def import_highway() -> None:
    """Registers the environments of highway-env."""
    # pygame greets on stdout otherwise.
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import_module("highway_env")


def _known(name: str) -> bool:
    return any(spec.id.rpartition("-v")[0] == name for spec in gym.registry.values())


def _random(space: spaces.Space[Any]) -> Policies:
    def policies(seed: int) -> Policy:
        space.seed(seed)
        return lambda _obs, _step: space.sample()

    return policies


def _zero(space: spaces.Space[Any]) -> Policies:
    match space:
        case spaces.Box():
            action: Any = np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        case spaces.Discrete():
            action = int(space.start)
        case spaces.MultiDiscrete() | spaces.MultiBinary():
            action = np.zeros(space.shape, space.dtype)
        case _:
            raise InputError(f"--policy zero: expected a space of numbers, got {space}")
    return lambda _seed: lambda _obs, _step: action


POLICIES: Mapping[str, Callable[[spaces.Space[Any]], Policies]] = {
    "random": _random,
    "zero": _zero,
}
"""Policies that need no training, by name."""
