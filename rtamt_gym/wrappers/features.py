"""The state of monitors as bounded numbers, to be appended to an observation.

For every specification, in their order:

| feature | range |
|---|---|
| robustness, as the reward takes it | [-clip, clip] |
| the least and the greatest robustness that the episode can still have | [-clip, clip] |
| time left until the horizon, as a fraction of it; 1 if there is none | [0, 1] |

The functions take floats of one environment, or arrays of shape (lanes,) of many; the features of
many are an array of shape (lanes, features).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.shaping import Shaping, Value

__all__ = ["KEY", "append", "appended_space", "feature_box", "features", "time_left"]

KEY = "stl"
"""Key of the features in a dictionary of observations."""


def feature_box(shaping: Shaping) -> spaces.Box:
    """The space of `features`."""
    count = len(shaping.weights)
    bound = shaping.clip
    low = np.array([-bound, -bound, -bound, 0.0] * count, np.float32)
    high = np.array([bound, bound, bound, 1.0] * count, np.float32)
    return spaces.Box(low, high, dtype=np.float32)


def features(
    shaping: Shaping,
    robustness: Sequence[Value],
    lower: Sequence[Value],
    upper: Sequence[Value],
    left: Sequence[Value],
) -> NDArray[np.float32]:
    """The features of all specifications, from a sequence with an element for each."""
    rows: list[Value] = []
    for now, low, high, time in zip(
        shaping.scaled(robustness), shaping.scaled(lower), shaping.scaled(upper), left, strict=True
    ):
        rows += [now, low, high, time]
    return np.array(rows, np.float32).T


def time_left(sample: Value, horizon: int | None) -> Value:
    """``1 - sample / horizon``, 0 from the horizon on; 1 without a horizon.

    Args:
        sample: The sample taken last, 0 being that of reset.
        horizon: Samples after the first on which the robustness depends.

    Example:
        >>> time_left(0, 4), time_left(3, 4), time_left(9, 4), time_left(9, None)
        (1.0, 0.25, 0.0, 1.0)
    """
    left = sample * 0.0 + 1.0 if horizon is None else (horizon - sample) / max(horizon, 1)
    if isinstance(left, np.ndarray):
        return np.maximum(left, 0.0)
    return max(left, 0.0)


def appended_space(space: spaces.Space[Any], box: spaces.Box) -> spaces.Box | spaces.Dict:
    """The space of observations with features appended.

    A ``Box`` of one dimension grows, and holds floats; a ``Dict`` gets one more key.

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
        "expected observations as a Box of one dimension or a Dict for observe='state', got "
        f"{space}; flatten them first: gymnasium.wrappers.FlattenObservation"
    )


def append(observation: Any, numbers: NDArray[np.float32]) -> Any:  # noqa: ANN401
    """Appends features to an observation or a batch of them: an array or a dictionary."""
    if isinstance(observation, dict):
        return {**observation, KEY: numbers}
    dtype = np.result_type(observation.dtype, np.float32)
    return np.concatenate([observation, numbers], axis=-1, dtype=dtype)
