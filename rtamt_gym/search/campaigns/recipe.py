"""`Recipe`: what a runner is made of, for other processes and to tell campaigns apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from rtamt import InputError, InputTypeError
from rtamt_gym.results.fingerprint import Fingerprint, listed
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
        fingerprint: The fingerprint of the runner here, which it must have elsewhere too as far as
            the files are there. None: it is not compared.
    """

    def __init__(
        self, runner: Runner, *, whole: bool = False, fingerprint: Fingerprint | None = None
    ) -> None:
        self._fingerprint = fingerprint
        self._whole = whole
        self._system = runner.origin
        self._requirements = runner.requirements
        self._kind = type(runner)
        self._name, self._duration = runner.name, runner.duration
        self._options = runner.arguments
        spec = self._system.spec if isinstance(self._system, gym.Env) else None
        if spec is not None and all(each.kwargs is not None for each in spec.additional_wrappers):
            self._system = spec

    def runner(self) -> Runner | Whole:
        """Makes the runner.

        Raises:
            InputError: If a file or a package that it runs is another one than where the recipe
                was made, as after an edit or on another machine.
        """
        system = self._system
        made = gym.make(system) if isinstance(system, EnvSpec) else system
        runner = self._kind(made, self._requirements, **self._options)
        if self._fingerprint is not None:
            there = replace(self._fingerprint, values={})  # a run changes what objects hold
            here = runner.fingerprint()
            if changes := there.common(here).changes(here.common(there)):
                raise InputError(f"{listed(changes)} since the run began, or on this machine")
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

    def identity(self, requirements: Mapping[str, str]) -> dict[str, Any]:
        """What tells rows of this runner from rows of another one, as JSON can write it.

        A function, and an object that JSON cannot write, is there by its name alone: its source
        and what it holds are in the fingerprint of the runner.

        Args:
            requirements: The text of each requirement, by name.
        """
        system = self._system
        return {
            "system": self._name,
            "requirements": dict(requirements),
            "time limit": self._duration,
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
