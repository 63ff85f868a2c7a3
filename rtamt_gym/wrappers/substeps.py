"""Samples inside an environment's step: one for every step of its simulation.

In one step an environment makes several steps of its simulation: Gymnasium's `MujocoEnv` calls
``mj_step`` ``frame_skip`` times, highway-env steps its road once for every frame. The function that
makes those steps is replaced while the environment makes a step, and only then: copies, pickles,
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
from rtamt_gym.judging.feeding import Assessment
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.panel import Panel
from rtamt_gym.signals.signals import Env, ParsedSignal, Read
from rtamt_gym.signals.slots import MovingRead
from rtamt_gym.signals.sources import STEP

__all__ = ["Inside", "SubSteps", "fits", "read_substep_period"]


class Inside:
    """Reads the signals of an environment after every step of its simulation.

    Attributes:
        reads: What reads each signal there; observation, reward and info are not known yet.
        env: The environment that is stepped.

    Raises:
        InputError: If the simulation of the environment cannot be followed, or if a signal needs
            what only a whole step gives.
    """

    def __init__(self, env: Env, signals: Sequence[ParsedSignal]) -> None:
        self.env = env
        self._follow = _follower(env.unwrapped)
        self.reads = [self._bind(signal) for signal in signals]

    def step(
        self,
        action: Any,  # noqa: ANN401
        feed: Callable[..., object],
    ) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment, and calls ``feed`` after every step of its simulation.

        Args:
            action: The action of the step.
            feed: Takes the arguments of a `Read`.

        Raises:
            StateError: If the simulation was not stepped.
        """
        undo = self._follow(partial(feed, None, action, None, {}))
        try:
            result = self.env.step(action)
        finally:
            stepped = undo()
        if not stepped:
            raise StateError(
                f"expected a step of {self.env.unwrapped} to step its simulation, got none: it "
                "steps it in a way of its own; leave out ",
                Argument("substeps", value=True),
            )
        return result

    def _bind(self, signal: ParsedSignal) -> Read:
        if signal.source in STEP and signal.source != "action":
            raise InputError(
                f"signal {signal.name!r}: {signal} is not known inside of a step, and ",
                Argument("substeps", value=True),
                " takes samples there; read the simulation instead, such as qpos[0], "
                "body:torso.xpos[2], vehicle.speed, or a callable of a Step, whose env it may read",
            )
        return signal.bind(self.env)


class SubSteps:
    """Feeds a panel after every step of the simulation that an environment makes.

    Raises:
        InputError: As `Inside` does.
    """

    def __init__(self, env: Env, signals: Sequence[ParsedSignal], panel: Panel) -> None:
        self._panel = panel
        self.inside = Inside(env, signals)
        names = [signal.name for signal in signals]
        reads = self.inside.reads
        self._make_feed = partial(panel.feeder, names, reads, still=True)
        self._moving = next((read for read in reads if isinstance(read, MovingRead)), None)
        self._home = None if self._moving is None else self._moving.home()
        self._feed = self._make_feed()
        self._feed_first = panel.feeder(names, [signal.bind_reset(env) for signal in signals])

    def reset(self, *_: object) -> Assessment:
        """Feeds sample 0."""
        return self._feed_first(None, None, None, {})

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Steps the environment, and feeds a sample after every step of its simulation.

        Raises:
            StateError: If the simulation was not stepped.
            InputError: If a signal is nan or cannot be read.
        """
        if self._moving is not None and self._moving.home() is not self._home:
            self._home, self._feed = self._moving.home(), self._make_feed()
        return self.inside.step(action, self._feed)

    def read(self, *_: object) -> Assessment:
        """The assessment of the samples that the last step has fed."""
        return self._panel.read()


def read_substep_period(env: Env) -> float | None:
    """Seconds between two steps of an environment's simulation, or None if it does not say."""
    simulation: Any = env.unwrapped
    if hasattr(simulation, "_step_mujoco_simulation"):
        return float(simulation.model.opt.timestep)
    config = getattr(simulation, "config", {})
    frequency = config.get("simulation_frequency") if isinstance(config, Mapping) else None
    return 1.0 / frequency if frequency else None


_Feed = Callable[[], object]

_Undo = Callable[[], bool]
"""Ends what follows a simulation; returns whether that was stepped meanwhile."""

_Follow = Callable[[_Feed], _Undo]
"""Arranges that every step of a simulation is followed by a call; returns what undoes that."""


def _follower(simulation: Any) -> _Follow:  # noqa: ANN401
    config = getattr(simulation, "config", None)
    if isinstance(config, Mapping) and "simulation_frequency" in config:
        return lambda feed: _follow_road(simulation, feed)
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
            " exchanges MujocoEnv._step_mujoco_simulation, and "
            f"{type(simulation).__name__} has one of its own; leave it out",
        )
    return _Loop(simulation).follow


class _Loop:
    """`MujocoEnv._step_mujoco_simulation`, one ``mj_step`` at a time."""

    def __init__(self, simulation: Any) -> None:  # noqa: ANN401
        self._simulation = simulation
        self._feeds: list[_Feed] = []
        self._stepped = False

    def follow(self, feed: _Feed) -> _Undo:
        # Not by its dictionary: Python reads attributes faster while nobody has asked for that.
        simulation = self._simulation
        around = simulation._step_mujoco_simulation  # noqa: SLF001
        if type(around) is _Loop:  # a monitor around this one follows too
            around._feeds.append(feed)  # noqa: SLF001
            return around._leave  # noqa: SLF001
        self._feeds, self._stepped = [feed], False
        simulation._step_mujoco_simulation = self  # noqa: SLF001
        return self._undo

    def _undo(self) -> bool:
        del self._simulation._step_mujoco_simulation  # noqa: SLF001
        return self._stepped

    def _leave(self) -> bool:
        self._feeds.pop()
        return self._stepped

    def __call__(self, ctrl: Any, n_frames: int) -> None:  # noqa: ANN401
        mujoco = sys.modules["mujoco"]  # a simulation of it has loaded it
        step, feeds = mujoco.mj_step, self._feeds
        model, data = self._simulation.model, self._simulation.data
        data.ctrl[:] = ctrl
        for _ in range(n_frames):
            self._stepped = True
            step(model, data)
            for feed in feeds:
                feed()
        mujoco.mj_rnePostConstraint(model, data)


def _follow_road(simulation: Any, feed: _Feed) -> _Undo:  # noqa: ANN401
    road = simulation.road  # every reset makes a new one
    step = road.step
    stepped = False

    def followed(dt: float) -> None:
        nonlocal stepped
        stepped = True
        step(dt)
        feed()

    around = vars(road).get("step")
    road.step = followed

    def undo() -> bool:
        if around is None:
            del road.step
        else:
            road.step = around
        return stepped

    return undo


def fits(judged: Judging, period: float, cost: Cost | None) -> bool:
    """Whether the specifications can be monitored with this period."""
    try:
        Panel(judged.specs, judged.reading.having(period=period), cost)
    except SpecificationError:
        return False
    return True
