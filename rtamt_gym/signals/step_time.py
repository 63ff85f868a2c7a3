"""A comparison of the period of samples with the stated period and the clock of an environment."""

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
from rtamt_gym.signals.periods import SimulationClock, StatedTimes, StepCount, clock_of, simulations

ReadPeriod = Callable[[Any], float | None]
"""Returns the period that an environment states now."""

STEPS = 10
"""The number of steps of the first episode that are compared."""

AGAIN = 2
"""The number of steps of each later episode, as a reset may change the time of a step."""

_SLACK = 0.001
"""The tolerance in periods, because the time is a rounded sum."""


class StepTime:
    """Compares a period with the environment at each reset, and with its clock in the first steps.

    A period that was read from the environment, and that a bound depends on, must not change: a
    change is an error. All other differences are warnings, each once. A period of 1 that the user
    has set counts steps, and is compared with nothing.

    The clock of MuJoCo is ``data.time``, the clock of highway-env is
    ``steps / config["simulation_frequency"]``. For all others, the innermost `TimeLimit` counts
    steps, which reveals a wrapper inside the monitor that repeats actions.

    Args:
        env: The environment, or a vector environment.
        period: Seconds between samples.
        read: Reads the period that the environment states.
        was_read: Whether the period was read, not set.
        timed: Whether a specification has bounds in time.
        substeps: Whether there are several samples in a step.
        stated: The period that the environment states now; None without one, or to read it at the
            first reset.

    Attributes:
        samples: The samples since the reset, without the sample of the reset.
        left: The number of steps of this episode that are still to compare; 0 until a reset.
        reported: The times of a step in earlier warnings, a list that many environments share.
    """

    def __init__(
        self,
        env: Any,
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
            inside = [clock_of(inner) for _, inner in simulations(env.unwrapped)]
            self._clock = next(filter(None, inside), None)
        self._has_clock = self._clock is not None
        if self._clock is None and was_read and not substeps:
            self._clock = StepCount.of(env, period)
        self._start, self._due = 0.0, STEPS
        self.samples = self.left = 0
        self.reported: list[float] = []

    def begin(self) -> None:
        """Compare the period after a reset; the clock shows the time of sample 0.

        Raises:
            StateError: If the environment states another period than before.
        """
        self._compare_stated()
        if self._clock is not None:
            self._start, self.samples = self._clock.read(), 0
            self.left, self._due = self._due, AGAIN

    def step(self, samples: int = 1) -> None:
        """Compare the clock after a step with this number of samples.

        Raises:
            StateError: If it differs from the period that was read and a bound depends on it.
        """
        if not self.left or self._clock is None:
            return
        self.samples += samples
        elapsed = self._clock.read() - self._start
        # A clock that stands still, or was set back, is not a clock.
        if elapsed <= 0.0 or abs(elapsed - self.samples * self._period) <= _SLACK * self._period:
            self.left -= 1
            return
        lasts = elapsed / self.samples
        source = f"{self._env.unwrapped} states" if self._was_read else "period= states"
        error = StateError(
            f"expected samples {self._period:g} s apart, as {source}, got {lasts:g} s by "
            f"{self._clock.name}: bounds last {lasts / self._period:g} times as long as specified; "
            "if an inner wrapper makes several steps in one, pass ",
            Argument("period", round(lasts, 9)),
            ", or put the monitor inside of it",
        )
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
        if self._has_clock or stated is None or before is None or math.isclose(stated, before):
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
        if not any(math.isclose(lasts, time, rel_tol=_SLACK) for time in self.reported):
            self.reported.append(lasts)
            warnings.warn(text, UserWarning, stacklevel=caller_level())


class StepTimes:
    """The `StepTime` of each environment of a `SyncVectorEnv`.

    All other vector environments have one, which is compared at every reset of some environments.

    Args:
        env: The vector environment.
        make: Returns the `StepTime` of an environment or a vector; None if there is no period.
    """

    def __init__(self, env: Any, make: Callable[[Any], StepTime] | None) -> None:
        base = env.unwrapped
        self._shared: StepTime | None = None
        self._times: Sequence[StepTime] = ()
        if make is not None and isinstance(base, SyncVectorEnv):
            self._times = [make(single) for single in base.envs]
            for time in self._times:
                time.reported = self._times[0].reported
        elif make is not None:
            self._shared = make(env)
        self._compared: set[int] = set()

    def begin(self, entries: NDArray[Any]) -> None:
        """Compare the environments of a mask after their reset."""
        if self._shared is not None:
            self._shared.begin()
        if self._times:
            for entry in entries.nonzero()[0].tolist():
                self._times[entry].begin()
                if self._times[entry].left:
                    self._compared.add(entry)

    def step(self, again: NDArray[Any] | None) -> None:
        """Compare the step of all environments; ``again`` is the mask of the reset ones."""
        if self._compared:
            for entry in sorted(self._compared):
                if again is None or not again[entry]:
                    self._times[entry].step()
            self._compared = {entry for entry in self._compared if self._times[entry].left}
        if again is not None and again.any():
            self.begin(again)
