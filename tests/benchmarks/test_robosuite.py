"""robosuite as an environment of Gymnasium: the promises of its adapter, on Lift."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import robosuite
from gymnasium.utils.env_checker import check_env
from robosuite.wrappers import GymWrapper

from rtamt import InputError, InputTypeError
from rtamt_gym import StlMonitor, compare, evaluate_policy
from rtamt_gym.benchmarks.robosuite import TASKS, RobosuiteEnv, make
from rtamt_gym.evaluation.replays import alike
from rtamt_gym.success import readings

FLAG: Any = {"success": ("info['success']", 0.0)}


@pytest.fixture(scope="module")
def env() -> Iterator[RobosuiteEnv]:
    made = make("Lift", horizon=12)
    yield made
    made.close()


def test_the_tasks_are_tasks_of_the_package() -> None:
    assert set(TASKS) <= set(robosuite.ALL_ENVIRONMENTS)
    assert {f"robosuite/{name}-v0" for name in TASKS} <= set(gym.registry)


def test_it_is_an_environment_of_gymnasium(env: RobosuiteEnv) -> None:
    check_env(env, skip_render_check=True)
    assert env.unwrapped is env
    assert env.dt == env.robosuite.control_timestep == 0.05
    assert type(env.model).__name__ == "MjModel"
    assert type(env.data).__name__ == "MjData"


def test_the_end_of_the_horizon_is_a_truncation(env: RobosuiteEnv) -> None:
    _, info = env.reset(seed=0)
    assert info["success"] == 0.0
    ends = []
    for _ in range(12):
        *_, terminated, truncated, info = env.step(np.zeros(7, np.float32))
        ends.append((terminated, truncated))
        assert info["success"] == float(env.robosuite._check_success())
    assert ends == [(False, False)] * 11 + [(False, True)]


def test_a_seed_repeats_an_episode(env: RobosuiteEnv) -> None:
    shown = [env.reset(seed=seed)[0] for seed in (3, 4, 3)]
    assert alike(shown[0], shown[2])
    assert not alike(shown[0], shown[1])


def test_success_is_judged_and_policies_are_paired(env: RobosuiteEnv) -> None:
    specs: Any = {**readings("success", hold=0.25), "low": "always(z < 1)"}
    signals = {**FLAG, "z": "body:cube_main.xpos[2]"}
    found = evaluate_policy("random", env, specs, signals, episodes=2)
    assert [each.satisfied for each in found.requirements.values()] == [0, 0, 0, 0, 2]
    assert found.repeats is True
    assert len(compare("random", "zero", env, specs, signals, episodes=2).seeds) == 2


def test_a_window_that_looks_ahead_stays_open_at_the_horizon(env: RobosuiteEnv) -> None:
    signals = {"height": "obs['cube_pos'][2]"}
    monitored = StlMonitor(env, "always(always[0:0.5](height > 0))", signals)
    monitored.reset(seed=0)
    truncated = False
    while not truncated:
        *_, truncated, info = monitored.step(np.zeros(7, np.float32))
    assert info["stl_episode"]["spec"]["verdict"] == "UNDECIDED"


@pytest.mark.filterwarnings("ignore:.*precision lowered:UserWarning")
def test_robosuites_own_wrapper_ends_otherwise_and_does_not_repeat() -> None:
    drawn = dict.fromkeys(("has_renderer", "has_offscreen_renderer", "use_camera_obs"), False)
    made = robosuite.make("Lift", robots="Panda", horizon=3, **drawn)
    own = GymWrapper(made)
    with pytest.raises(InputError, match="two resets with one seed begin differently"):
        compare("random", "zero", own, {"any": "eventually(x > 9)"}, {"x": "obs[0]"}, episodes=2)
    own.reset(seed=0)
    ends = [own.step(np.zeros(7))[2:4] for _ in range(3)]
    assert ends[-1] == (True, False)
    with pytest.raises(InputTypeError, match="without GymWrapper, got GymWrapper"):
        RobosuiteEnv(own)
    own.close()
