"""Signals that are unknown at a step: ``nan="unknown"`` in the wrappers."""

import math
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from replay import Replay

import rtamt
from rtamt import InputError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

X = {"x": "obs[0]"}
NAN = math.nan
VALUES = [5.0, NAN, 3.0, 2.0]


def test_an_episode_has_the_bounds_of_its_monitor() -> None:
    env = StlMonitor(Replay(VALUES), "always(x > 1)", X, period=1, nan="unknown")
    monitor = rtamt.EpisodeMonitor("always(x > 1)", period=1, nan="unknown")
    _, info = env.reset()
    for i, value in enumerate(VALUES):
        monitor.update(value)
        if i:
            _, _, _, _, info = env.step(0)
        assert (info["stl_lower"], info["stl_upper"]) == monitor.bounds()
    outcome = info["stl_episode"]["spec"]
    assert (outcome["robustness"], outcome["verdict"]) == (-math.inf, "UNDECIDED")
    assert info["stl_undecided"]
    assert not info["stl_success"]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("mode", AutoresetMode)
def test_environments_have_what_single_environments_have(mode: AutoresetMode) -> None:
    traces = [VALUES, [1.5, 3.0, NAN, 0.0], [9.0, 8.0, 7.0, 6.0]]
    made = SyncVectorEnv([partial(Replay, trace) for trace in traces], autoreset_mode=mode)
    env = VectorStlMonitor(made, "always(x > 1)", X, period=1, nan="unknown")
    singles = [StlMonitor(Replay(t), "always(x > 1)", X, period=1, nan="unknown") for t in traces]
    _, infos = env.reset()
    item = [single.reset()[1] for single in singles]
    for i in range(3):
        for key in ("stl_lower", "stl_upper", "stl_violated"):
            assert infos[key].tolist() == [info[key] for info in item], (i, key)
        _, _, _, _, infos = env.step(np.zeros(3, np.int64))
        item = [single.step(0)[4] for single in singles]
        if mode is AutoresetMode.SAME_STEP and "final_info" in infos:
            infos = infos["final_info"]


@pytest.mark.parametrize(
    "options", [{"view": "step"}, {"cost": "violation"}, {"observe": "obligations"}]
)
def test_what_needs_the_robustness_of_instants_is_refused(options: dict[str, Any]) -> None:
    ((name, value),) = options.items()
    expected = (
        f"^nan='unknown' leaves the robustness between two bounds, and {name}='{value}' needs"
    )
    spec = "always(x > 1 implies eventually[0:2](x > 2))"
    with pytest.raises(InputError, match=expected):
        StlMonitor(Replay(VALUES), spec, X, period=1, nan="unknown", **options)
    vector = SyncVectorEnv([lambda: Replay(VALUES)])
    with pytest.raises(InputError, match=expected):
        VectorStlMonitor(vector, spec, X, period=1, nan="unknown", **options)


REFUSED = (
    r"^specification 'spec' reads 'x' at the sample of the reset, where nothing is known of it"
)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("spec", "refused"),
    [
        ("always(x > 1)", True),
        ("eventually(x > 1)", True),
        ("always(once[0:2](x > 1))", True),
        ("always(once[1:2](x > 1))", True),
        ("eventually[0:3](historically[2:2](x > 1))", True),
        ("next(always(x > 1))", False),
        ("always[1:inf](x > 1)", False),
        ("always[2:3](once[0:1](x > 1))", False),
        ("eventually[0:3](once[5:6](x > 1))", False),  # before sample 0 there is nothing
    ],
)
def test_a_reward_refuses_what_is_unknown_at_the_reset(spec: str, *, refused: bool) -> None:
    def made(values: list[float]) -> list[gym.Env[Any, Any] | Any]:
        options: dict[str, Any] = {"period": 1, "nan": "unknown", "mode": "terminal"}
        vector = SyncVectorEnv([lambda: Replay([5.0, 5.0]), lambda: Replay(values)])
        return [
            StlReward(Replay(values), spec, X, **options),
            VectorStlReward(vector, spec, X, **options),
        ]

    for env in made([NAN, 5.0, 3.0]):
        if refused:
            with pytest.raises(InputError, match=REFUSED) as error:
                env.reset()
            assert str(error.value).endswith("or pass nan='hold'")
        else:
            env.reset()
    for env in made([5.0, NAN, 3.0]):
        env.reset()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_an_episode_that_begins_in_a_step_is_looked_at_too(mode: AutoresetMode) -> None:
    class Later(Replay):
        episodes = 0

        def reset(self, **options: Any) -> Any:
            obs, info = super().reset(**options)
            self.episodes += 1
            return (np.full_like(obs, NAN) if self.episodes > 1 else obs), info

    vector = SyncVectorEnv([lambda: Later([5.0, 4.0])], autoreset_mode=mode)
    env = VectorStlReward(vector, "always(x > 1)", X, period=1, nan="unknown", mode="terminal")
    env.reset()
    still = np.zeros(1, np.int64)
    if mode is AutoresetMode.NEXT_STEP:  # the step after the last one resets
        env.step(still)
    with pytest.raises(InputError, match=REFUSED):
        env.step(still)
