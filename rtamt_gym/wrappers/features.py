"""The state of monitors as bounded numbers, to be appended to an observation.

For every specification, in their order, times a weight:

| feature | range |
|---|---|
| robustness | [-clip, clip] |
| the least and the greatest robustness that the episode can still have | [-clip, clip] |
| time left until the horizon, as a fraction of it; 1 if there is none | [0, 1] |
| the verdict: 1 certainly satisfied, -1 certainly violated, 0 undecided; without weight | [-1, 1] |
| of each temporal operator that `StateFeatures.operators` lists: its clock | [0, 1] |
| and the newest known robustness of each of its operands | [-clip, clip] |

The functions take floats of one environment, or arrays of shape (lanes,) of many; the features of
many are an array of shape (lanes, features).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.judging.clocks import Owed
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.shaping import Numeric, scaled

__all__ = ["KEY", "StateFeatures", "append", "appended_space", "time_left"]

KEY = "stl"
"""Key of the features in a dictionary of observations."""

_NAMES = ("robustness", "lower", "upper", "time left", "verdict")


@dataclass(frozen=True, slots=True)
class StateFeatures:
    """What is shown of monitors.

    Attributes:
        weights: A factor of the numbers of each specification.
        clip: The bound to which they are clipped.
        horizons: For each specification, how many samples after the first it depends on.
        whole: Whether the robustness judges the whole episode in every view.
        operators: For each specification the temporal operators whose clocks and margins are shown;
            None if none are.
    """

    weights: tuple[float, ...]
    clip: float
    horizons: tuple[int | None, ...]
    whole: bool = False
    operators: tuple[tuple[Obligation, ...], ...] | None = None

    @property
    def box(self) -> spaces.Box:
        """The space of the features."""
        bound = self.clip
        low: list[float] = []
        high: list[float] = []
        for operators in self.operators or ((),) * len(self.weights):
            low += [-bound, -bound, -bound, 0.0, -1.0]
            high += [bound, bound, bound, 1.0, 1.0]
            for operator in operators:
                margins = [bound] * len(operator.operands)
                low += [0.0, *(-margin for margin in margins)]
                high += [1.0, *margins]
        return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

    def names(self, specs: Iterable[str]) -> list[str]:
        """A name for each feature, for a reader."""
        found = []
        for name, operators in zip(specs, self.operators or repeat(()), strict=False):
            found += [f"{name}: {what}" for what in _NAMES]
            for operator in operators:
                found.append(f"{name}: clock of {operator.formula}")
                found += [f"{name}: margin of {operand}" for operand in operator.operands]
        return found

    def read(self, values: MonitorValues[Numeric]) -> NDArray[np.float32]:
        """The features of all specifications."""
        if not isinstance(values.samples, np.ndarray):
            robustness = values.judged if self.whole else values.robustness
            return np.array(self._of_one(robustness, values), np.float32)
        return np.array(self.rows(values), np.float32).T

    def rows(self, values: MonitorValues[Any]) -> list[Any]:
        """The features of many environments, an array of each; arrays may be of any library."""
        robustness = values.judged if self.whole else values.robustness
        numbers = [
            scaled(column, self.weights, self.clip)
            for column in (robustness, values.lower, values.upper)
        ]
        sample = values.samples - 1.0
        left = [time_left(sample, horizon) for horizon in self.horizons]
        state: list[Any] = list(zip(*numbers, left, values.verdicts, strict=True))
        owing = None if self.operators is None else values.owed
        rows: list[Any] = []
        for place, each in enumerate(state):
            rows += each
            if owing is not None:
                rows += self._rows_of(owing[place], self.weights[place])
        return rows

    def _of_one(self, robustness: Sequence[Any], values: MonitorValues[Any]) -> list[float]:
        """The features of one environment: in loops, as calls would take twice the time."""
        high, low, found = self.clip, -self.clip, []
        owing = None if self.operators is None else values.owed
        shown = (robustness, values.lower, values.upper)
        for place, weight in enumerate(self.weights):
            for column in shown:
                number = weight * column[place]
                found.append(low if number < low else high if number > high else number)  # noqa: FURB136
            found.append(time_left(values.samples - 1.0, self.horizons[place]))
            found.append(values.verdicts[place])
            for clock, margins in () if owing is None else owing[place]:
                found.append(clock)
                for margin in margins:
                    number = weight * margin
                    found.append(low if number < low else high if number > high else number)  # noqa: FURB136
        return found

    def _rows_of(self, owing: Iterable[Owed], weight: float) -> list[Any]:
        """The clock and the margins of every operator of a specification."""
        rows = []
        for clock, margins in owing:
            rows += [clock, *scaled(margins, [weight] * len(margins), self.clip)]
        return rows


def time_left(sample: Numeric, horizon: int | None) -> Numeric:
    """``1 - sample / horizon``, 0 from the horizon on; 1 without a horizon.

    Args:
        sample: The sample taken last; the reset takes sample 0.
        horizon: Samples after the first on which the robustness depends.

    Example:
        >>> time_left(0, 4), time_left(3, 4), time_left(9, 4), time_left(9, None)
        (1.0, 0.25, 0.0, 1.0)
    """
    left = sample * 0.0 + 1.0 if horizon is None else (horizon - sample) / max(horizon, 1)
    if isinstance(left, float | int):
        return max(left, 0.0)
    return left * (left > 0.0)


def appended_space(
    space: spaces.Space[Any], box: spaces.Box, observe: str
) -> spaces.Box | spaces.Dict:
    """The space of observations with features appended.

    A ``Box`` of one dimension grows, and holds floats; a ``Dict`` gets one more key. ``observe`` is
    the argument that asks for it.

    Raises:
        InputError: If the space is neither, or the ``Dict`` has the key.
    """
    match space:
        case spaces.Dict() if KEY not in space.spaces:
            # Pairs, so that Gymnasium keeps the order.
            return spaces.Dict([*space.spaces.items(), (KEY, box)])
        case spaces.Dict():
            raise InputError(
                f"expected an observation space without the key {KEY!r}, which the monitor's "
                "state takes; rename it"
            )
        case spaces.Box(shape=(_,)):
            dtype: Any = np.result_type(space.dtype, np.float32)
            low = np.concatenate([space.low, box.low]).astype(dtype)
            high = np.concatenate([space.high, box.high]).astype(dtype)
            return spaces.Box(low, high, dtype=dtype)
    raise InputError(
        f"expected observations as a Box of one dimension or a Dict for observe={observe!r}, got "
        f"{space}; flatten them first: gymnasium.wrappers.FlattenObservation"
    )


def append(observation: Any, numbers: NDArray[np.float32]) -> Any:  # noqa: ANN401
    """Appends features to an observation or a batch of them: an array or a dictionary."""
    if isinstance(observation, dict):
        return {**observation, KEY: numbers}
    if observation.dtype != np.float32:
        numbers = numbers.astype(np.result_type(observation.dtype, np.float32))
    return np.concatenate([observation, numbers], axis=-1)
