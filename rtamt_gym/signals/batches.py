"""Functions as signals of many environments: for one environment, or marked for all at once.

A function is for one environment, and is called for each. One that is marked with `batched` gets
the batch of all of them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import concatenate, create_empty_array

from rtamt import InputTypeError

__all__ = ["Batched", "batch_of_one", "batched"]


class Batched:
    """A function that reads all environments at once; `batched` makes one.

    Attributes:
        function: The function.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function
        self.__module__ = getattr(function, "__module__", None) or type(self).__module__
        self.__qualname__ = f"batched({getattr(function, '__qualname__', None) or repr(function)})"
        self.__doc__ = function.__doc__

    def __call__(self, step: Any) -> Any:  # noqa: ANN401 - a `Step` of a batch; an array
        """Calls the function."""
        return self.function(step)

    def __repr__(self) -> str:
        return self.__qualname__

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Batched) and self.function == other.function

    def __hash__(self) -> int:
        return hash(self.function)

    def __reduce__(self) -> Any:  # noqa: ANN401 - as `pickle` has it
        # As a decorator it has taken the name of the function, by which pickle would look for that.
        name = getattr(self.function, "__qualname__", "")
        if getattr(sys.modules.get(self.__module__), name, None) is self:
            return name
        return Batched, (self.function,)


def batched(function: Callable[[Any], Any]) -> Batched:
    """Marks a function as a signal of many environments that gets all of them at once.

    A function is for one environment: in a vector environment it is called for each. A function
    that is marked gets the `rtamt_gym.Step` of all, in which observations, actions, rewards and
    infos are batches as vector environments give them, and returns an array with a number for each
    environment. It has to keep environments apart, and to depend on nothing but its argument: its
    first calls, at a reset and at a step, are compared with calls for each environment alone, and
    one that gives other numbers then is refused. Where there is one environment it gets a batch of
    one; in `rtamt_gym.relabel` all samples of an episode.

    Args:
        function: The function. ``@batched`` marks it where it is defined.

    Raises:
        InputTypeError: If it is no function.

    Example:
        >>> import gymnasium as gym
        >>> import numpy as np
        >>> from rtamt_gym import VectorStlMonitor, batched
        >>> envs = gym.make_vec("CartPole-v1", 3, vectorization_mode="vector_entry_point")
        >>> energy = batched(lambda step: np.square(step.obs[:, 1]) + np.square(step.obs[:, 3]))
        >>> envs = VectorStlMonitor(envs, "always(energy < 1)", {"energy": energy})
        >>> _, infos = envs.reset(seed=123)
        >>> infos["robustness"].round(3)
        array([0.997, 0.999, 0.998])
    """
    if isinstance(function, Batched):
        return function
    if not callable(function):
        raise InputTypeError(
            f"expected a function of a rtamt_gym.Step to mark with batched, got {function!r}; "
            "selectors such as 'obs[2]' read all environments at once as they are"
        )
    return Batched(function)


def batch_of_one(
    step: Any,  # noqa: ANN401 - a `Step`
    observations: spaces.Space[Any],
    actions: spaces.Space[Any],
) -> Any:  # noqa: ANN401
    """The step of one environment as a vector environment of one would give it.

    Args:
        step: The `rtamt_gym.Step`; what is None stays None.
        observations: The space of an observation.
        actions: The space of an action.
    """
    return step._replace(
        obs=_stacked(observations, step.obs),
        action=_stacked(actions, step.action),
        reward=None if step.reward is None else np.array([step.reward], np.float64),
        info=_infos(step.info),
    )


def _stacked(space: spaces.Space[Any], value: Any) -> Any:  # noqa: ANN401
    if value is None:
        return None
    room: Any = create_empty_array(space, 1)
    return concatenate(space, [value], room)


def _infos(info: Mapping[str, Any]) -> dict[str, Any]:
    made: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, Mapping):
            held: Any = _infos(value)
        elif isinstance(value, np.ndarray | np.number | bool | int | float):
            held = np.asarray(value)[None]
        else:
            held = np.empty(1, object)
            held[0] = value
        made[key], made[f"_{key}"] = held, np.ones(1, np.bool_)
    return made
