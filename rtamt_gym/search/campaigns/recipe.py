"""`Recipe`: what a runner is made of, for other processes and to tell campaigns apart."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from rtamt import InputTypeError
from rtamt_gym.search.runs.runner import Runner
from rtamt_gym.search.runs.whole import Whole

__all__ = ["Recipe"]


_SIDE_BY_SIDE = ("batch", "n_envs")
"""What says how many runs there are at once, and changes no row."""


class Recipe:
    """What a runner is made of.

    An environment is made anew, as its spec says; all else is pickled.

    Args:
        runner: The runner.
        whole: Whether runs are judged once they are over, by a `Whole`.
    """

    def __init__(self, runner: Runner, *, whole: bool = False) -> None:
        self._whole = whole
        self._system = runner.origin
        self._requirements = runner.requirements
        self._kind = type(runner)
        self._options = runner.arguments
        spec = self._system.spec if isinstance(self._system, gym.Env) else None
        if spec is not None and all(each.kwargs is not None for each in spec.additional_wrappers):
            self._system = spec

    def runner(self) -> Runner | Whole:
        """Makes the runner."""
        system = self._system
        made = gym.make(system) if isinstance(system, EnvSpec) else system
        runner = self._kind(made, self._requirements, **self._options)
        return Whole(lambda _specs, _stop: runner, self._requirements) if self._whole else runner

    def pickled(self, name: str) -> bytes:
        """The recipe as bytes, functions of the main program and of functions with it.

        Raises:
            InputTypeError: If something in it cannot be pickled.
        """
        import cloudpickle

        try:
            sent: bytes = cloudpickle.dumps(self)
        except Exception as error:
            raise InputTypeError(
                f"{name} cannot be sent to other processes: {type(error).__name__}: {error}; give "
                "the id of a registered environment, or a function that makes in itself what "
                "cannot be pickled"
            ) from error
        return sent

    def identity(self) -> dict[str, Any]:
        """What tells rows of this runner from rows of another one, as JSON can write it.

        A function, and an object that JSON cannot write, is there by its name alone.
        """
        system = self._system
        return {
            "arguments of the system": _written(system.kwargs)
            if isinstance(system, EnvSpec)
            else {},
            **{
                name: _written(value)
                for name, value in self._options.items()
                if name not in _SIDE_BY_SIDE and value is not False  # as where it is not given
            },
        }


def _written(value: Any) -> Any:  # noqa: ANN401
    """An argument as JSON can write it."""
    if isinstance(value, Mapping):
        return {str(key): _written(each) for key, each in value.items()}
    if value is None or isinstance(value, str | int | float):
        return value
    if isinstance(value, list | tuple):
        return [_written(each) for each in value]
    if isinstance(value, Fraction):
        return str(value)
    return getattr(value, "__qualname__", type(value).__qualname__)
