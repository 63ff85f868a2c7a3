"""Wrappers that rescale observations, and taps that read the observations beneath them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import gymnasium as gym
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import SyncVectorEnv, VectorEnv, VectorWrapper

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.signals.signals import ParsedSignal


class Tap(gym.Wrapper[Any, Any, Any, Any]):
    """A wrapper that keeps the last results of an environment.

    ``seen`` are observation, action, reward and info; after a reset, action and reward are None.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.seen: tuple[Any, Any, Any, Any] = None, None, None, {}

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Reset the environment."""
        obs, info = self.env.reset(**options)
        self.seen = obs, None, None, info
        return obs, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment."""
        result = self.env.step(action)
        self.seen = result[0], action, result[1], result[4]
        return result

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # as Gymnasium's wrappers do
        """The spec without this wrapper; outer wrappers add their own."""
        return self.env.spec


class StaysOpen:
    """A mixin for vector environments that stay open when they are collected.

    Gymnasium before 1.3 closes a collected vector environment, and the environment in a wrapper
    after an error in its constructor.
    """

    def __del__(self) -> None:
        """Do nothing, in place of Gymnasium's method."""


class VectorTap(StaysOpen, VectorWrapper):
    """A wrapper that keeps the last results of a vector environment.

    Attributes:
        shown: Observations and infos of the last reset.
        actions: The actions of the last step.
        result: The result of the last step.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self.shown: tuple[Any, Any] = None, {}
        self.actions: Any = None
        self.result: Any = None

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Reset the environment."""
        obs, infos = self.shown = self.env.reset(**options)
        return obs, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environment."""
        self.actions = actions
        result = self.result = self.env.step(actions)
        return result


_RESCALING = (
    wrappers.NormalizeObservation,
    wrappers.RescaleObservation,
    wrappers.vector.NormalizeObservation,
    wrappers.vector.RescaleObservation,
)
"""Wrappers that keep the shape of observations and change their units."""


def rescaling(env: Any, signals: Sequence[ParsedSignal], *, below: bool, rescaled: bool) -> Any:
    """Return the innermost wrapper that rescales observations, if signals are read below it.

    None: the signals are read in ``env``; with ``rescaled``, from the rescaled observations.

    Raises:
        InputError: If a signal would read rescaled observations and neither option is set; if both
            are set; or if ``below`` is set without a rescaling wrapper.
    """
    if below and rescaled:
        raise InputError(
            Argument("below", value=True),
            " reads signals below the wrappers that rescale observations, and ",
            Argument("rescaled", value=True),
            " reads the rescaled values; omit one",
        )
    if rescaled:
        return None
    rescaler = _innermost(env)
    if below and rescaler is not None:
        return rescaler
    inside = None if rescaler is not None else _in_each(env)
    if below:
        where = "" if inside is None else f", but for a {inside} in each of its environments"
        raise InputError(
            "expected a wrapper that rescales observations, such as NormalizeObservation, for ",
            Argument("below", value=True),
            f", got none in {env}{where}; "
            + ("leave it out" if inside is None else "wrap each environment with StlMonitor"),
        )
    name = type(rescaler).__name__ if rescaler is not None else inside
    signal = next((item for item in signals if item.source in {"obs", None}), None)
    if name is None or signal is None:
        return None
    phrase = f"{signal} is given" if signal.source is None else f"{signal} reads"
    below_it = Argument("below", value=True)
    advice: tuple[object, ...] = ("pass ", below_it, " to read below it, ")
    if inside is not None:
        advice = ("wrap each environment inside it with StlMonitor, or pass ",)
    raise InputError(
        f"signal {signal.name!r}: {phrase} observations that a {name} inside the monitor has "
        "rescaled, so formulas would compare other numbers; ",
        *advice,
        Argument("rescaled", value=True),
        " to use the rescaled numbers",
        "" if inside is not None else ", or put the monitor inside it",
    )


def tapped(rescaler: Any) -> Any:
    """Return the tap between a wrapper and its environment; add one if necessary."""
    inner = rescaler.env
    if not isinstance(inner, Tap | VectorTap):
        inner = rescaler.env = VectorTap(inner) if isinstance(inner, VectorEnv) else Tap(inner)
    return inner


def _innermost(env: Any) -> Any:
    rescaler = None
    while isinstance(env, gym.Wrapper | VectorWrapper):
        if isinstance(env, _RESCALING):
            rescaler = env
        env = env.env
    return rescaler


def _in_each(env: Any) -> str | None:
    """Return the name of the rescaling wrapper in an environment of a `SyncVectorEnv`."""
    base = getattr(env, "unwrapped", env)
    inside: Collection[Any] = base.envs if isinstance(base, SyncVectorEnv) else ()
    rescalers = (_innermost(single) for single in inside)
    return next((type(rescaler).__name__ for rescaler in rescalers if rescaler is not None), None)
