"""How long the steps of an environment last by its own time, beside the period of its samples."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any, NamedTuple

import gymnasium as gym
from gymnasium.wrappers import TimeLimit

from rtamt import StateError
from rtamt.errors import Argument
from rtamt_gym.checks.callers import caller_level

__all__ = ["STEPS", "StepTime", "step_time_of"]

STEPS = 10
"""How many steps are compared."""

_SLACK = 0.001
"""How much of a period a time may differ from what it should be: it is a sum, which is rounded."""


class _Time(NamedTuple):
    """The time of a simulation.

    Attributes:
        read: Gives it, in seconds.
        what: What has it, for messages.
    """

    read: Callable[[], float]
    what: str


class StepTime:
    """Compares the first steps of an environment with its own time.

    Attributes:
        samples: How many samples it has seen since the reset, beside that of the reset.
        left: How many steps it still compares.
        told: Whether it has told another time.
    """

    def __init__(
        self,
        env: Any,  # noqa: ANN401
        time: _Time,
        period: float,
        *,
        was_read: bool,
        refuses: bool,
    ) -> None:
        self._env, self._time, self._period = env, time, period
        self._was_read, self._refuses = was_read, refuses
        self._begun: float | None = None
        self.samples = 0
        self.left, self.told = STEPS, False

    def begin(self) -> None:
        """Takes the time of the reset."""
        self._begun, self.samples = self._time.read(), 0

    def step(self, samples: int = 1) -> None:
        """Compares the time after a step, in which so many samples were taken.

        Raises:
            StateError: If it is another one, and that is to be refused; else a `UserWarning` tells
                it once.
        """
        if self._begun is None or not self.left:
            return
        self.samples += samples
        elapsed = self._time.read() - self._begun
        # A time that stands still, or was set back, is none.
        if elapsed <= 0.0 or abs(elapsed - self.samples * self._period) <= _SLACK * self._period:
            self.left -= 1
            return
        error = self._error(elapsed / self.samples)
        if self._refuses:
            raise error
        self.left, self.told = 0, True
        warnings.warn(str(error), UserWarning, stacklevel=caller_level())

    def _error(self, lasts: float) -> StateError:
        says = f"{self._env.unwrapped} says" if self._was_read else "period= says"
        return StateError(
            f"expected samples {self._period:g} s apart, as {says}, got {lasts:g} s by "
            f"{self._time.what}: bounds last {lasts / self._period:g} times what they say; where a "
            "wrapper inside makes several steps in one, give ",
            Argument("period", round(lasts, 9)),
            ", or put the monitor inside of it",
        )


def step_time_of(
    env: Any,  # noqa: ANN401 - an environment, of whatever form
    period: float,
    *,
    was_read: bool,
    timed: bool,
    substeps: bool = False,
) -> StepTime | None:
    """What compares the steps of an environment with its own time; None where it has none.

    The time of MuJoCo is ``data.time``, of highway-env ``time``; elsewhere the innermost
    `TimeLimit` counts the steps that were made. Another period than the time of a step is refused
    where the environment has said it and a bound hangs on it; else it is told in a warning, unless
    it is ``1``, which counts steps.

    Args:
        env: The environment.
        period: Seconds between samples.
        was_read: Whether the environment has said the period.
        timed: Whether a specification has bounds.
        substeps: Whether there are several samples in a step.
    """
    time = _simulated(env.unwrapped, substeps=substeps)
    if time is None and was_read and not substeps:
        time = _counted(env, period)
    if time is None or (not was_read and period == 1.0):
        return None
    return StepTime(env, time, period, was_read=was_read, refuses=was_read and timed)


def _simulated(simulation: Any, *, substeps: bool) -> _Time | None:  # noqa: ANN401
    mujoco = sys.modules.get("mujoco")  # a simulation of it has loaded it
    if mujoco is not None and isinstance(getattr(simulation, "data", None), mujoco.MjData):
        return _Time(lambda: float(simulation.data.time), "data.time")
    config = getattr(simulation, "config", None)
    if isinstance(config, Mapping) and "policy_frequency" in config and not substeps:
        time = getattr(simulation, "time", None)
        if isinstance(time, Real):
            return _Time(lambda: float(simulation.time), "time")
    return None


def _counted(env: Any, period: float) -> _Time | None:  # noqa: ANN401
    limit: Any = None
    while isinstance(env, gym.Wrapper):
        if isinstance(env, TimeLimit):
            limit = env
        env = env.env
    if not isinstance(getattr(limit, "_elapsed_steps", None), int | None) or limit is None:
        return None
    return _Time(
        lambda: (limit._elapsed_steps or 0) * period,  # noqa: SLF001 - there is no other count
        "the steps that its TimeLimit counts",
    )
