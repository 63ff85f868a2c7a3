"""Samples inside the steps of an environment: one for every step of its simulation.

In one step an environment makes several steps of its simulation: Gymnasium's `MujocoEnv` calls
``mj_step`` ``frame_skip`` times, highway-env steps its road once for every frame. The function that
makes those steps is replaced during a step of the environment, and only then: copies, pickles,
resets and other environments never see it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rtamt import InputError, SpecificationError, StateError
from rtamt.errors import Argument
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.monitor_set import Assessment, MonitorSet, SeeValues, Take
from rtamt_gym.signals.signals import Env, MovingRead, ParsedSignal
from rtamt_gym.signals.sources import STEP


class Inside:
    """Reads the signals of an environment after every step of its simulation.

    Raises:
        InputError: If the simulation cannot be followed, or a signal reads results of the step.
    """

    def __init__(self, env: Env, signals: Sequence[ParsedSignal]) -> None:
        self.env = env
        self._follow = _follower(env.unwrapped)
        for signal in signals:
            if signal.source in STEP and signal.source != "action":
                raise InputError(
                    f"signal {signal.name!r}: {signal} is unknown during a step, and ",
                    Argument("substeps", value=True),
                    " samples there; read the simulation instead, such as qpos[0], "
                    "body:torso.xpos[2], vehicle.speed, or a callable that reads step.env",
                )
        self.reads = [signal.bind(env) for signal in signals]

    def step(self, action: Any, take: Take) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment, and call ``take``, a `Read`, after every step of its simulation."""
        undo = self._follow(take, action)
        try:
            result = self.env.step(action)
        finally:
            stepped = undo()
        if not stepped:
            raise StateError(
                f"expected a step of {self.env.unwrapped} to step its simulation, got none: it "
                "steps it without the function that is followed; leave out ",
                Argument("substeps", value=True),
            )
        return result


class SubSteps:
    """Updates a monitor set after every step of the simulation that an environment makes."""

    def __init__(
        self,
        env: Env,
        signals: Sequence[ParsedSignal],
        monitor_set: MonitorSet,
        keep: SeeValues | None = None,
    ) -> None:
        self.inside = Inside(env, signals)
        names = [signal.name for signal in signals]
        reads = self.inside.reads
        self._make_take = partial(monitor_set.taker, names, reads, keep)
        self._moving = next((read for read in reads if isinstance(read, MovingRead)), None)
        self._home = None if self._moving is None else self._moving.home()
        self._take = self._make_take()
        first = [signal.bind_reset(env) for signal in signals]
        self._feed_first = monitor_set.feeder(names, first, keep=keep)

    def reset(self, *_: object) -> Assessment:
        """Take sample 0."""
        return self._feed_first(None, None, None, {})

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment, and take a sample after every step of its simulation."""
        if self._moving is not None and self._moving.home() is not self._home:
            self._home, self._take = self._moving.home(), self._make_take()
        return self.inside.step(action, self._take)


def read_substep_period(env: Env) -> float | None:
    """Return the seconds between two steps of an environment's simulation; None if unknown."""
    simulation: Any = env.unwrapped
    if hasattr(simulation, "_step_mujoco_simulation"):
        return float(simulation.model.opt.timestep)
    config = getattr(simulation, "config", {})
    frequency = config.get("simulation_frequency") if isinstance(config, Mapping) else None
    return 1.0 / frequency if frequency else None


_Undo = Callable[[], bool]
"""Stops following a simulation; returns whether it was stepped meanwhile."""

_Follow = Callable[[Take, Any], _Undo]
"""Arranges that a sample is taken after every step of a simulation, with the action of the step."""


def _follower(simulation: Any) -> _Follow:
    config = getattr(simulation, "config", None)
    if isinstance(config, Mapping) and "simulation_frequency" in config:
        return partial(_follow_road, simulation)
    if not hasattr(simulation, "_step_mujoco_simulation"):
        raise InputError(
            Argument("substeps", value=True),
            " needs a MujocoEnv of Gymnasium or an environment of highway-env, got "
            f"{simulation}; leave it out",
        )
    from gymnasium.envs.mujoco.mujoco_env import MujocoEnv

    loop = getattr(simulation._step_mujoco_simulation, "__func__", None)  # noqa: SLF001
    if loop is not MujocoEnv._step_mujoco_simulation:  # noqa: SLF001
        raise InputError(
            Argument("substeps", value=True),
            f" exchanges MujocoEnv._step_mujoco_simulation, and {type(simulation).__name__} "
            "overrides it; omit substeps=True",
        )
    return _Loop(simulation).follow


class _Loop:
    """`MujocoEnv._step_mujoco_simulation`, one ``mj_step`` at a time."""

    def __init__(self, simulation: Any) -> None:
        self._simulation = simulation
        self._takes: list[tuple[Take, Any]] = []
        self._stepped = False

    def follow(self, take: Take, action: Any) -> _Undo:
        # Not through __dict__: Python reads attributes faster if nothing has read __dict__.
        simulation = self._simulation
        around = simulation._step_mujoco_simulation  # noqa: SLF001
        if type(around) is _Loop:  # a monitor around this one follows too
            around._takes.append((take, action))  # noqa: SLF001
            return around._leave  # noqa: SLF001
        self._takes, self._stepped = [(take, action)], False
        simulation._step_mujoco_simulation = self  # noqa: SLF001
        return self._undo

    def _undo(self) -> bool:
        del self._simulation._step_mujoco_simulation  # noqa: SLF001
        return self._stepped

    def _leave(self) -> bool:
        self._takes.pop()
        return self._stepped

    def __call__(self, ctrl: Any, n_frames: int) -> None:
        mujoco = sys.modules["mujoco"]  # the simulation has imported it
        step, takes = mujoco.mj_step, self._takes
        model, data = self._simulation.model, self._simulation.data
        data.ctrl[:] = ctrl
        for _ in range(n_frames):
            self._stepped = True
            step(model, data)
            for take, action in takes:
                take(None, action, None, {})
        mujoco.mj_rnePostConstraint(model, data)


def _follow_road(simulation: Any, take: Take, action: Any) -> _Undo:
    road = simulation.road  # every reset makes a new one
    step = road.step
    stepped = False

    def step_and_take(dt: float) -> None:
        nonlocal stepped
        stepped = True
        step(dt)
        take(None, action, None, {})

    around = vars(road).get("step")
    road.step = step_and_take

    def undo() -> bool:
        if around is None:
            del road.step
        else:
            road.step = around
        return stepped

    return undo


def fits(judging: Judging, period: float, cost: Cost | None) -> bool:
    """Return whether the specifications can be monitored with this period."""
    try:
        MonitorSet(judging.specs, judging.reading.having(period=period), cost)
    except SpecificationError:
        return False
    return True
