"""Finds the `System` for each kind of simulation that `simulate` takes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
from gymnasium.vector import VectorEnv

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.inputs.case import Case
from rtamt_gym.mujoco.values import MonitorSetValues
from rtamt_gym.systems.environment import Environment
from rtamt_gym.systems.samples import SampleSource
from rtamt_gym.systems.system import Drivable, Policy, System

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
    """Return the caller's simulation as a `System`."""
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


def refuse_seed(seed: int | None, system: object) -> None:
    """Raise InputError if a system without seeds is given one."""
    if seed is not None:
        raise InputError(
            Argument("seed"),
            " is for environments, got ",
            Argument("seed", seed),
            f" for {system!r}",
        )
