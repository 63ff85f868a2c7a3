"""What stands between two wrappers and keeps what passes; and what rescales observations there."""

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

__all__ = ["StaysOpen", "Tap", "VectorTap", "rescaling", "tapped"]


class Tap(gym.Wrapper[Any, Any, Any, Any]):
    """Stands around an environment, and keeps what it has shown last.

    Attributes:
        seen: Observation, action, reward and info of the last step; at a reset action and reward
            are None.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.seen: tuple[Any, Any, Any, Any] = None, None, None, {}

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        """Resets the environment."""
        obs, info = self.env.reset(**options)
        self.seen = obs, None, None, info
        return obs, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Steps the environment."""
        result = self.env.step(action)
        self.seen = result[0], action, result[1], result[4]
        return result

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # as Gymnasium's wrappers do
        """The spec of the environment, without this wrapper: outer wrappers add theirs to it."""
        return self.env.spec


class StaysOpen:
    """A part of vector environments: they stay open when they are collected.

    Gymnasium before 1.3 closes a collected vector environment, also the environment in a wrapper
    whose constructor failed.
    """

    def __del__(self) -> None:
        """Do nothing, in place of Gymnasium's method."""


class VectorTap(StaysOpen, VectorWrapper):
    """Stands around a vector environment, and keeps what it has shown last.

    Attributes:
        shown: Observations and infos of the last reset.
        actions: The actions of the last step.
        result: What the last step has given.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self.shown: tuple[Any, Any] = None, {}
        self.actions: Any = None
        self.result: Any = None

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        """Resets the environment."""
        obs, infos = self.shown = self.env.reset(**options)
        return obs, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:  # noqa: ANN401
        """Steps the environment."""
        self.actions = actions
        result = self.result = self.env.step(actions)
        return result


_RESCALING = (
    wrappers.NormalizeObservation,
    wrappers.RescaleObservation,
    wrappers.vector.NormalizeObservation,
    wrappers.vector.RescaleObservation,
)
"""The wrappers that are recognised: they keep the shape of observations and change their units."""


def rescaling(
    env: Any,  # noqa: ANN401 - an environment, or many
    signals: Sequence[ParsedSignal],
    *,
    below: bool,
    rescaled: bool,
) -> Any:  # noqa: ANN401
    """The innermost wrapper inside that rescales observations, if signals are read beneath it.

    Args:
        env: The environment.
        signals: What is read from it.
        below: Whether they are to be read beneath such wrappers.
        rescaled: Whether what such wrappers give is meant.

    Returns:
        The wrapper, in whose ``env`` the signals are read; None: they are read in ``env``.

    Raises:
        InputError: If a signal would read rescaled observations, and nobody has said that it is to;
            if both is asked for, or there is nothing beneath which to read.
    """
    if below and rescaled:
        raise InputError(
            Argument("below", value=True),
            " reads signals beneath wrappers that rescale observations, and ",
            Argument("rescaled", value=True),
            " as these give them; expected one of the two",
        )
    if rescaled:
        return None
    found = _innermost(env)
    if below and isinstance(found, _RESCALING):
        return found
    inside = None if found is not None else _in_each(env)
    if below:
        where = "" if inside is None else f", but for a {inside} in each of its environments"
        raise InputError(
            "expected a wrapper that rescales observations, such as NormalizeObservation, for ",
            Argument("below", value=True),
            f", got none in {env}{where}; "
            + ("leave it out" if inside is None else "wrap each environment with StlMonitor"),
        )
    name = type(found).__name__ if found is not None else inside
    reading = [each for each in signals if each.source in {"obs", None}]
    if name is None or not reading:
        return None
    signal = reading[0]
    what = f"{signal} is given" if signal.source is None else f"{signal} reads"
    below_it = Argument("below", value=True)
    ways: tuple[object, ...] = ("pass ", below_it, " to read beneath it, ")
    if inside is not None:
        ways = ("wrap each environment inside of it with StlMonitor, or pass ",)
    raise InputError(
        f"signal {signal.name!r}: {what} observations that a {name} inside of the monitor has "
        "rescaled, and formulas mean other numbers there; ",
        *ways,
        Argument("rescaled", value=True),
        " to mean these",
        "" if inside is not None else ", or put the monitor inside of it",
    )


def tapped(rescaler: Any) -> Any:  # noqa: ANN401
    """The tap between a wrapper and its environment, which is made where there is none."""
    inner = rescaler.env
    if not isinstance(inner, Tap | VectorTap):
        inner = rescaler.env = VectorTap(inner) if isinstance(inner, VectorEnv) else Tap(inner)
    return inner


def _innermost(env: Any) -> Any:  # noqa: ANN401
    found = None
    while isinstance(env, gym.Wrapper | VectorWrapper):
        if isinstance(env, _RESCALING):
            found = env
        env = env.env
    return found


def _in_each(env: Any) -> str | None:  # noqa: ANN401
    """The name of the wrapper that rescales in an environment of a `SyncVectorEnv`."""
    base = getattr(env, "unwrapped", env)
    inside: Collection[Any] = base.envs if isinstance(base, SyncVectorEnv) else ()
    names = [type(found).__name__ for each in inside if (found := _innermost(each)) is not None]
    return names[0] if names else None
