"""A comparison of the period of samples with what an environment states and what its time shows."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray

from rtamt import StateError
from rtamt.errors import Argument
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.signals.periods import StatedTimes, simulations
from rtamt_gym.signals.simulation_time import SimulationClock, StepCount, clock_of

__all__ = ["AGAIN", "STEPS", "ReadPeriod", "StepTime", "StepTimes"]

ReadPeriod = Callable[[Any], float | None]
"""A function that reads the period that an environment states now."""

STEPS = 10
"""How many steps of the first episode are compared."""

AGAIN = 2
"""How many steps of each later episode are compared, as a reset may change the time of a step."""

_SLACK = 0.001
"""How much of a period a time may differ from what it should be: it is a sum, which is rounded."""


class StepTime:
    """Compares a period with the environment at each reset, and with its time in the first steps.

    A period that was read, and that a bound depends on, must stay what it was: a change is an
    error. All other differences are warnings, each once. A period of 1 that was set counts steps,
    and is compared with nothing.

    The time of MuJoCo is ``data.time``, the time of highway-env is
    ``steps / config["simulation_frequency"]``. For all others, the innermost `TimeLimit` counts
    steps, which shows a wrapper inside the monitor that repeats actions.

    Args:
        env: The environment, one or a vector.
        period: Seconds between samples.
        read: What reads the period that the environment states.
        was_read: Whether the period was read, not set.
        timed: Whether a specification has bounds in time.
        substeps: Whether there are several samples in a step.
        stated: What the environment states now; None if it states nothing, or to read it at the
            first reset.

    Attributes:
        samples: The samples since the reset without the sample of the reset.
        left: How many more steps are compared in this episode; 0 until a reset.
        reported: The times of a step that warnings have reported; many environments share it.
    """

    def __init__(
        self,
        env: Any,  # noqa: ANN401
        period: float,
        read: ReadPeriod,
        *,
        was_read: bool,
        timed: bool,
        substeps: bool = False,
        stated: float | None = None,
    ) -> None:
        self._env, self._period, self._read = env, period, read
        self._was_read, self._timed, self._substeps = was_read, timed, substeps
        self._stated = stated
        # Quicker to read at every reset than the period itself.
        self._times = StatedTimes(env)
        self._values = None if stated is None else self._times.read()
        self._clock: SimulationClock | None = None
        self._counts_steps = period == 1.0 and not was_read
        if not self._counts_steps:
            inside = [clock_of(each) for _, each in simulations(env.unwrapped)]
            self._clock = next(filter(None, inside), None)
        self._states_time = self._clock is not None
        if self._clock is None and was_read and not substeps:
            self._clock = StepCount.of(env, period)
        self._begun, self._due = 0.0, STEPS
        self.samples = self.left = 0
        self.reported: list[float] = []

    def begin(self) -> None:
        """Compare the period after a reset, and take the time of sample 0.

        Raises:
            StateError: If the environment states another period than the one that was read.
        """
        self._compare_stated()
        if self._clock is not None:
            self._begun, self.samples = self._clock.read(), 0
            self.left, self._due = self._due, AGAIN

    def step(self, samples: int = 1) -> None:
        """Compare the time after a step, in which so many samples were taken.

        Raises:
            StateError: If it differs from the period that was read and a bound depends on it.
        """
        if not self.left or self._clock is None:
            return
        self.samples += samples
        elapsed = self._clock.read() - self._begun
        # A time that stands still, or was set back, is not a time.
        if elapsed <= 0.0 or abs(elapsed - self.samples * self._period) <= _SLACK * self._period:
            self.left -= 1
            return
        lasts = elapsed / self.samples
        error = self._error(lasts, self._clock.what)
        if self._was_read and self._timed:
            raise error
        self.left = 0
        self._warn(lasts, str(error))

    def _compare_stated(self) -> None:
        if self._counts_steps or not self._timed:
            return
        values = self._times.read()
        if values == self._values and not self._substeps:
            return
        stated, before = self._read(self._env), self._stated
        if self._was_read:
            if before is not None and (stated is None or not math.isclose(stated, self._period)):
                raise StateError(
                    f"expected the period of {self._period} s that {self._env.unwrapped} had at "
                    f"construction, got {stated} s; wrap it again, or give period="
                )
            self._values = values
            return
        self._stated, self._values = stated, values
        if self._states_time or stated is None or before is None or math.isclose(stated, before):
            return
        if not math.isclose(stated, self._period):
            self._warn(
                stated,
                f"period= is {self._period:g} s, but a step of {self._env.unwrapped}, which lasted "
                f"{before:g} s, lasts {stated:g} s since this reset; make the monitor again with "
                "the seconds between two samples as period=",
            )

    def _warn(self, lasts: float, text: str) -> None:
        """Warn of a time of a step, unless a warning has reported it."""
        if not any(math.isclose(lasts, each, rel_tol=_SLACK) for each in self.reported):
            self.reported.append(lasts)
            warnings.warn(text, UserWarning, stacklevel=caller_level())

    def _error(self, lasts: float, time: str) -> StateError:
        says = f"{self._env.unwrapped} says" if self._was_read else "period= says"
        return StateError(
            f"expected samples {self._period:g} s apart, as {says}, got {lasts:g} s by "
            f"{time}: bounds last {lasts / self._period:g} times what they say; where a "
            "wrapper inside makes several steps in one, give ",
            Argument("period", round(lasts, 9)),
            ", or put the monitor inside of it",
        )


class StepTimes:
    """The same for a vector environment: each environment of a `SyncVectorEnv` by itself.

    All other vector environments state one period, which is compared at every reset of some.

    Args:
        env: The vector environment.
        make: Makes the comparison of an environment, one or a vector; None: there is no period.
    """

    def __init__(self, env: Any, make: Callable[[Any], StepTime] | None) -> None:  # noqa: ANN401
        base = env.unwrapped
        self._alone: StepTime | None = None
        self._times: Sequence[StepTime] = ()
        if make is None:
            pass
        elif isinstance(base, SyncVectorEnv):
            self._times = [make(each) for each in base.envs]
            for time in self._times:
                time.reported = self._times[0].reported
        else:
            self._alone = make(env)
        self._compared: set[int] = set()

    def begin(self, lanes: NDArray[Any]) -> None:
        """Compare the environments of a mask, which were reset.

        Raises:
            StateError: As `StepTime.begin` does.
        """
        if self._alone is not None:
            self._alone.begin()
        if self._times:
            for lane in lanes.nonzero()[0].tolist():
                self._times[lane].begin()
                if self._times[lane].left:
                    self._compared.add(lane)

    def step(self, again: NDArray[Any] | None) -> None:
        """Compare the step of all environments.

        Args:
            again: The environments that the step has reset; None: none.

        Raises:
            StateError: As `StepTime.step` does.
        """
        if self._compared:
            for lane in sorted(self._compared):
                if again is None or not again[lane]:
                    self._times[lane].step()
            self._compared = {lane for lane in self._compared if self._times[lane].left}
        if again is not None and again.any():
            self.begin(again)
