"""`rtamt demo`: a pendulum and a highway under monitors, with good and bad controllers."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from rtamt_gym.drawing import save
from rtamt_gym.play.run import Run, draw
from rtamt_gym.play.simulate import simulate
from rtamt_gym.play.summaries import run_table, saved_note
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.registry import make, register
from rtamt_gym.systems.system import Policy

Driver = Callable[[gym.Env[Any, Any]], Policy]
"""Returns the policy of an episode; it may read the state of the environment."""


@dataclass(frozen=True, slots=True)
class Demo:
    """An environment, two specifications, and drivers."""

    env_id: str
    specs: Mapping[str, str]
    signals: Mapping[str, SignalLike]
    duration: float
    drivers: Mapping[str, Driver]
    shown: str


def _balance(leave: float = 4.0, gains: tuple[float, ...] = (1.0, 12.0, 1.0, 2.0)) -> Driver:
    """Return linear feedback that balances the pole, 0.5 m aside from 2 s to ``leave``."""

    def drive(_env: gym.Env[Any, Any]) -> Policy:
        steps = itertools.count()

        def act(obs: Any) -> Any:  # noqa: ANN401
            target = 0.5 if 2.0 <= 0.04 * next(steps) < leave else 0.0
            force = np.dot(gains, obs - np.array([target, 0.0, 0.0, 0.0]))
            return np.clip([force], -3.0, 3.0).astype(np.float32)

        return act

    return drive


PENDULUM = Demo(
    env_id="InvertedPendulum-v5",
    specs={
        "upright": "always[0:40](abs(angle) < 0.1)",
        "returns": "always[0:35](cart > 0.2 implies eventually[0:5](cart < 0.1))",
    },
    signals={"cart": "obs[0]", "angle": "obs[1]"},
    duration=40.0,
    drivers={
        "recovers": _balance(),
        "drifts": _balance(leave=40.0),
        "lets go": _balance(gains=(0.0, 0.0, 0.0, 0.0)),
    },
    shown="drifts",
)


def _front_gap(env: gym.Env[Any, Any]) -> float:
    """Return the metres to the vehicle ahead in the same lane, at most 100.

    The observations of highway-env are normalised and relative by default.
    """
    simulation: Any = env.unwrapped
    own = simulation.vehicle
    ahead, _ = simulation.road.neighbour_vehicles(own)
    if ahead is None:
        return 100.0
    return min(100.0, float(ahead.position[0] - own.position[0]) - float(ahead.LENGTH))


_IDLE, _FASTER, _SLOWER = 1, 3, 4
"""Actions of highway-env; its actions 0 and 2 change the lane."""


def _keep_distance(env: gym.Env[Any, Any]) -> Policy:
    simulation: Any = env.unwrapped

    def act(_obs: Any) -> int:  # noqa: ANN401
        gap = _front_gap(env)
        if gap < 1.4 * simulation.vehicle.speed:
            return _SLOWER
        return _FASTER if gap > 45.0 else _IDLE

    return act


def _always(action: int) -> Driver:
    return lambda _env: lambda _obs: action


HIGHWAY = Demo(
    env_id="highway-fast-v0",
    specs={
        "distance": "always[0:30](gap > 0.5 * speed)",
        "closes": "always[0:20](gap > 60 implies eventually[0:10](gap < 60))",
    },
    signals={"gap": lambda step: _front_gap(step.env), "speed": "vehicle.speed"},
    duration=30.0,
    drivers={
        "careful": _keep_distance,
        "races": _always(_FASTER),
        "creeps": _always(_SLOWER),
    },
    shown="races",
)


def watch(scenario: Demo, seed: int = 0) -> list[Run]:
    """Run one episode for each driver of a scenario."""
    with closing(make(scenario.env_id)) as env:
        return [
            simulate(
                env,
                scenario.specs,
                scenario.signals,
                policy=driver(env),
                seed=seed,
                duration=scenario.duration,
                label=name,
            )
            for name, driver in scenario.drivers.items()
        ]


def run(seed: int, picture: Path) -> Iterator[str]:
    """Run both scenarios and draw the picture; yield the lines to print as they are known."""
    register("highway_env")  # fails before the first scenario, not after it
    shown: list[Run] = []
    watched: list[Run] = []
    for scenario in (PENDULUM, HIGHWAY):
        runs = watch(scenario, seed)
        period = float(runs[0].period or 1)
        yield f"{scenario.env_id}: {scenario.duration:g} s in steps of {period:g} s"
        yield from (f"  {name:8}  {text}" for name, text in scenario.specs.items())
        yield ""
        yield from run_table(runs)
        yield ""
        watched += runs
        shown += [run for run in runs if run.label == scenario.shown]
    yield from saved_note(watched)
    save(draw(shown), picture)
    yield f"picture: {picture.resolve()}"
