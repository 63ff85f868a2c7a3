"""A signal from info reads the info of a reset, or its default if the key is missing."""

from __future__ import annotations

import functools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from vector_environments import MODES, both, difference, trajectory

from rtamt import InputError
from rtamt_gym import StlMonitor, VectorStlMonitor, simulate

SPECS = {"all": "always(speed + 2 * gap + 4 * load < 40)", "speed": "always(speed < 9)"}
SIGNALS: dict[str, Any] = {
    "speed": ("info['speed']", -1.0),
    "gap": ("info['near']['gap']", -2.0),
    "load": ("info['loads'][1]", -3.0),
}


class Told(gym.Env[Any, Any]):
    """Has numbers in its info; at reset those that the count of its episodes has bits for."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __init__(self, first: int, length: int) -> None:
        self.episode = first - 1
        self.length = length

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.episode += 1
        self.at = 0
        told = self.info()
        kept = {key: told[key] for bit, key in enumerate(told) if self.episode >> bit & 1}
        if self.episode == 3:
            kept["near"] = {"far": 1.0}
        return np.zeros(1), kept

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        self.at += 1
        return np.ones(1), 0.0, self.at == self.length, False, self.info()

    def info(self) -> dict[str, Any]:
        speed = float(self.episode + self.at)
        return {"speed": speed, "near": {"gap": speed / 2}, "loads": np.array([0.0, speed / 4])}


def told(reset: dict[str, Any]) -> tuple[float, ...]:
    """Return the values at reset, by hand."""
    return (
        reset.get("speed", -1.0),
        reset.get("near", {}).get("gap", -2.0),
        reset["loads"][1] if "loads" in reset else -3.0,
    )


@pytest.mark.parametrize("first", range(9))
def test_the_first_sample_is_what_the_info_of_the_reset_has(first: int) -> None:
    speed, gap, load = told(Told(first, 5).reset()[1])
    _, info = StlMonitor(Told(first, 5), SPECS, SIGNALS, details=True).reset()
    assert info["stl"]["all"]["robustness"] == 40 - (speed + 2 * gap + 4 * load)
    assert info["stl"]["speed"]["robustness"] == 9 - speed
    run = simulate(Told(first, 5), SPECS, SIGNALS, policy=lambda _: 0)
    assert [run.signals[name][0] for name in SIGNALS] == [speed, gap, load]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_many_environments_read_it_environment_by_environment(mode: AutoresetMode) -> None:
    makes = [functools.partial(Told, first, length) for first, length in ((0, 3), (3, 2), (5, 4))]
    options: dict[str, Any] = {"on_violation": "report", "details": True}
    together, singles = both(StlMonitor, VectorStlMonitor, makes, mode, SPECS, SIGNALS, **options)
    assert difference(trajectory(together, 30), trajectory(singles, 30)) == ""


def test_what_is_there_and_is_no_number_is_refused_at_reset() -> None:
    env = Told(7, 5)
    with pytest.raises(InputError) as caught:
        StlMonitor(env, "always(x < 1)", {"x": ("info['speed']['m']", 0.0)}).reset()
    assert (
        str(caught.value) == "signal 'x': the info has no info['speed']['m']; it has 7.0 before 'm'"
    )
