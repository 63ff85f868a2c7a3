"""Adapters: a `System` for each kind of simulation that `simulate` takes."""

from __future__ import annotations

import inspect
import itertools
import os
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from inspect import isgeneratorfunction
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
from gymnasium.vector import VectorEnv

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.judge import MonitorSetValues
from rtamt_gym.systems.environment import Environment
from rtamt_gym.systems.system import (
    Drivable,
    Policy,
    Sample,
    Signals,
    System,
    named_signals,
    refuse_unknown,
)

if TYPE_CHECKING:
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor

_MUJOCO = {"MjModel", "MjData"}


def as_system(
    system: Any,  # noqa: ANN401
    policy: Policy | None = None,
    start: Snapshot | None = None,
    *,
    substeps: bool = False,
) -> System:
    """Return a simulation as a `System`."""
    simulation = _of_mujoco(system, policy, start)
    if simulation is not None:
        return simulation
    if isinstance(system, gym.Env):
        return Environment(system, policy, substeps=substeps)
    if isinstance(system, VectorEnv):
        raise InputError(
            f"expected one environment, got {system}; VectorStlMonitor monitors many at once"
        )
    if isinstance(system, str | os.PathLike):
        fmu = os.fspath(system).endswith(".fmu")
        raise InputTypeError(
            "expected a system to run, got its name; write "
            f"{'Fmus' if fmu else 'gym.make'}({os.fspath(system)!r})"
        )
    if policy is not None:
        raise InputError(
            Argument("policy"),
            f" is for environments and MuJoCo models, got {policy!r} for {system!r}",
        )
    if isinstance(system, System):
        return system
    if hasattr(system, "keys"):
        raise InputTypeError(
            "expected samples one after the other, got columns; rtamt.evaluate takes these, and "
            "to_dict('records') makes samples of a data frame"
        )
    if callable(system) or isinstance(system, Iterable):
        return SampleSource(system)
    raise InputTypeError(
        "expected an environment, a pair (model, data) of MuJoCo, a StepMonitor, Fmus, a function "
        f"of time or an iterable of samples, got {system!r}"
    )


def _of_mujoco(
    system: Any,  # noqa: ANN401
    policy: Policy | None,
    start: Snapshot | None,
) -> System | None:
    """Return a simulation of MuJoCo as a `System`; None for other systems, without importing it."""
    if type(system).__name__ == "Snapshot":
        raise InputTypeError(
            "expected a system to run, got a Snapshot, which holds no model; "
            "write simulate(monitor, start=snapshot)"
        )
    if isinstance(system, MonitorSetValues):
        from rtamt_gym.systems.mujoco import Monitored

        return Monitored(cast("StepMonitor", system), policy, start)
    if start is not None:
        raise InputError(f"start= is for a StepMonitor, got start={start!r} for {system!r}")
    if isinstance(system, tuple | list) and {type(part).__name__ for part in system} == _MUJOCO:
        from rtamt_gym.systems.mujoco import MujocoModel

        model, data = system
        return MujocoModel(model, data, policy)
    return None


def driven(system: System, case: Case) -> System:
    """Return a system driven by a case."""
    if not isinstance(system, Drivable):
        raise InputError(
            f"{system.name} takes no case, got {case!r}; environments, pairs (model, data) of "
            "MuJoCo, Fmus, functions of time and generator functions take one"
        )
    return system.driven(case)


class SampleSource(System):
    """A function of time, a generator function, or an iterable that returns samples."""

    def __init__(
        self,
        source: Callable[[float], Sample | None]
        | Callable[[], Iterator[Sample]]
        | Iterable[Sample],
        case: Mapping[str, Any] | None = None,
    ) -> None:
        self.needs_period = self.endless = callable(source) and not isgeneratorfunction(source)
        name = getattr(source, "__name__", "function").replace("<lambda>", "function")
        self.name = name if callable(source) else "samples"
        self._source: Any = source
        self._case = case or {}
        self._samples: Iterator[Sample | None] = iter(())
        self._count = 0

    def driven(self, case: Case) -> System:
        """Return the function with the entries of a case as keyword arguments."""
        if not callable(self._source):
            raise InputError(
                "a sequence of samples takes no case; give a generator function with the keyword "
                f"arguments {listing(case)}"
            )
        known, takes_any = _keywords(self._source, 1 if self.endless else 0)
        for name in case:
            if name not in known and not takes_any:
                self._refuse_as_time(name)
                refuse_unknown(self.name, name, known, "" if known else "no keyword arguments")
        for name, required in known.items():
            if required and name not in case:
                raise InputError(
                    f"{self.name} needs a value of {name!r}: vary it (--vary {name}=1:2, "
                    f"Parameter) or fix it (--set {name}=1, fixed=)"
                )
        return SampleSource(self._source, case)

    def _refuse_as_time(self, name: str) -> None:
        """Raise InputError if a name is the first argument of a function, which is the time."""
        first = [*_keywords(self._source, 0)[0]][:1]
        if self.endless and first == [name]:
            raise InputError(
                f"{self.name} does not yield, so that its first argument, {name!r}, is the time; "
                f"yield samples, or write {self.name}(time, {name}) to return one"
            )

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        self._reads = named_signals(variables, signals)
        self._period = period

    def start(self) -> list[float]:
        self.ended = ""
        source = self._source
        if self.endless:
            period = self._period or Fraction(1)
            self._samples = (source(float(i * period), **self._case) for i in itertools.count())
        else:
            self._samples = iter(source(**self._case) if callable(source) else source)
        self._count = 0
        first = self.advance()
        if first is None:
            raise InputError(f"expected at least one sample, {self.name} returned none")
        return first

    def advance(self) -> list[float] | None:
        try:
            sample = next(self._samples, None)
        except TypeError as error:
            self._refuse_number(error)
            raise
        if sample is None:
            self.ended = "terminated"
            return None
        if not isinstance(sample, Mapping):
            raise InputTypeError(
                f"expected a mapping of names to numbers as sample {self._count} of {self.name}, "
                f"got {sample!r}"
            )
        try:
            values = [sample[name] for name in self._reads]
        except KeyError:
            missing = next(name for name in self._reads if name not in sample)
            raise InputError(
                f"sample {self._count} of {self.name} has no {missing!r}; "
                f"it has {listing(sample)}{nearest(missing, sample)}"
            ) from None
        self._count += 1
        return values

    def _refuse_number(self, error: TypeError) -> None:
        """Raise InputError if a function calls a number of the case as a signal over time."""
        numbers = [name for name, value in self._case.items() if isinstance(value, int | float)]
        if numbers and re.fullmatch("'(float|int)' object is not callable", str(error)):
            raise InputError(
                f"{self.name} calls a number as a function of time; a signal over time needs "
                f"points (--vary {numbers[-1]}=0:1,points=5, Signal)"
            ) from error

    def close(self) -> None:
        """Close a generator, which may hold open files."""
        if isinstance(self._samples, Generator):
            self._samples.close()


def _keywords(function: Callable[..., object], skip: int) -> tuple[dict[str, bool], bool]:
    """Return the keyword arguments after the first ``skip``, and whether any name is allowed.

    The value of an argument is whether it is required.
    """
    try:
        parameters = [*inspect.signature(function).parameters.values()]
    except ValueError:  # some functions in C have no signature
        return {}, True
    named = {
        parameter.name: parameter.default is parameter.empty
        for parameter in parameters[skip:]
        if parameter.kind in {parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY}
    }
    return named, any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
