"""`rtamt demo`: a pendulum and a highway under monitors, with good controllers and bad."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import rtamt
from rtamt_gym import plot
from rtamt_gym.outcomes import report, saved_note
from rtamt_gym.run import Episode, Policies, Policy, Watched, import_highway, make
from rtamt_gym.signals import SignalLike, Step

__all__ = ["HIGHWAY", "PENDULUM", "Scenario", "run", "watch"]

Driver = Callable[[gym.Env[Any, Any]], Policies]
"""Makes the policies for an environment, which a driver may look into."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """An environment, two requirements, and who drives.

    Attributes:
        env_id: The environment.
        specs: The specifications.
        signals: What their variables read.
        limit: Steps to the time limit.
        drivers: An episode for each; all start from the same seed.
        shown: The driver of the picture.
    """

    env_id: str
    specs: Mapping[str, str]
    signals: Mapping[str, SignalLike]
    limit: int
    drivers: Mapping[str, Driver]
    shown: str


def _balance(leave: float = 4.0, gains: tuple[float, ...] = (1.0, 12.0, 1.0, 2.0)) -> Driver:
    """Linear feedback that holds the pole; from 2 s to ``leave`` it goes 0.5 m aside."""

    def act(obs: Any, step: int) -> Any:  # noqa: ANN401
        target = 0.5 if 2.0 <= 0.04 * step < leave else 0.0
        force = np.dot(gains, obs - np.array([target, 0.0, 0.0, 0.0]))
        return np.clip([force], -3.0, 3.0).astype(np.float32)

    return lambda _env: lambda _seed: act


PENDULUM = Scenario(
    env_id="InvertedPendulum-v5",
    specs={
        "upright": "always[0:40](abs(angle) < 0.1)",
        "returns": "always[0:35](cart > 0.2 implies eventually[0:5](cart < 0.1))",
    },
    signals={"cart": "obs[0]", "angle": "obs[1]"},
    limit=1000,
    drivers={
        "comes back": _balance(),
        "stays away": _balance(leave=40.0),
        "lets go": _balance(gains=(0.0, 0.0, 0.0, 0.0)),
    },
    shown="stays away",
)


def front_gap(step: Step) -> float:
    """Metres to the vehicle ahead in the same lane, at most 100.

    Read from the simulation: highway-env's observations are normalised and relative by default.
    """
    return _front_gap(step.env)


def own_speed(step: Step) -> float:
    """Speed in m/s."""
    simulation: Any = step.env.unwrapped
    return float(simulation.vehicle.speed)


def _front_gap(env: gym.Env[Any, Any]) -> float:
    simulation: Any = env.unwrapped
    own = simulation.vehicle
    ahead, _ = simulation.road.neighbour_vehicles(own)
    if ahead is None:
        return 100.0
    return min(100.0, float(ahead.position[0] - own.position[0]) - float(ahead.LENGTH))


_IDLE, _FASTER, _SLOWER = 1, 3, 4
"""Actions of highway-env; 0 and 2 change the lane."""


def _keep_distance(env: gym.Env[Any, Any]) -> Policies:
    simulation: Any = env.unwrapped

    def act(_obs: Any, _step: int) -> int:  # noqa: ANN401
        gap = _front_gap(env)
        if gap < 1.4 * simulation.vehicle.speed:
            return _SLOWER
        return _FASTER if gap > 45.0 else _IDLE

    return lambda _seed: act


def _always(action: int) -> Driver:
    policy: Policy = lambda _obs, _step: action  # noqa: E731 - one of two that never look
    return lambda _env: lambda _seed: policy


HIGHWAY = Scenario(
    env_id="highway-fast-v0",
    specs={
        "distance": "always[0:30](gap > 0.5 * speed)",
        "closes": "always[0:20](gap > 60 implies eventually[0:10](gap < 60))",
    },
    signals={"gap": front_gap, "speed": own_speed},
    limit=30,
    drivers={
        "keeps distance": _keep_distance,
        "races": _always(_FASTER),
        "creeps": _always(_SLOWER),
    },
    shown="races",
)


def watch(scenario: Scenario, seed: int = 0) -> list[Episode]:
    """Runs one episode for every driver of a scenario."""
    env = make(scenario.env_id)
    specs = {name: rtamt.parse(text) for name, text in scenario.specs.items()}
    watched = Watched(env, specs, scenario.signals, limit=scenario.limit)
    episodes = [
        watched.episode(driver(env), seed, name) for name, driver in scenario.drivers.items()
    ]
    env.close()
    return episodes


def run(seed: int, picture: Path) -> Iterator[str]:
    """Runs both scenarios and draws the picture; gives the lines to print as they are known."""
    import_highway()  # without it, better not to begin
    shown: list[Episode] = []
    watched: list[Episode] = []
    for scenario in (PENDULUM, HIGHWAY):
        episodes = watch(scenario, seed)
        period = float(episodes[0].period or 1)
        yield f"{scenario.env_id}: {scenario.limit * period:g} s in steps of {period:g} s"
        yield from (f"  {name:8}  {text}" for name, text in scenario.specs.items())
        yield ""
        yield from report(episodes)
        yield ""
        watched += episodes
        shown += [e for e in episodes if e.label == scenario.shown]
    yield from saved_note(watched)
    plot.save(shown, picture)
    yield f"picture: {picture.resolve()}"
