"""Adapters of benchmarks and the table of Meta-World, on stand-ins for the packages."""

from __future__ import annotations

import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from benchmark_stand_ins import install
from gymnasium.utils.env_checker import check_env

from rtamt import InputError, InputTypeError
from rtamt_gym import StlMonitor, compare, evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.benchmarks import metaworld, robosuite
from rtamt_gym.signals.signals import Step
from rtamt_gym.success import readings

Output = pytest.CaptureFixture[str]
FLAG: Any = {"success": ("info['success']", 0.0)}


@pytest.fixture(autouse=True)
def packages(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch)


def up(_observation: Any) -> Any:  # noqa: ANN401
    return np.ones(1, np.float32)


# ---- robosuite ----


def test_robosuite_is_an_environment_of_gymnasium() -> None:
    env = gym.make("robosuite/Lift-v0", horizon=5)
    inner: Any = env.unwrapped
    check_env(inner, skip_render_check=True)
    assert (inner.dt, inner.model, inner.data) == (0.1, "model", "data")
    assert inner.robosuite.made == {
        "robots": "Panda",
        "has_renderer": False,
        "has_offscreen_renderer": False,
        "use_camera_obs": False,
    }
    env.close()
    assert inner.robosuite.horizon == 0


def test_robosuite_image_space() -> None:
    env = robosuite.make("Lift", picture=True)
    space: Any = env.observation_space
    assert space["picture"] == gym.spaces.Box(0, 255, (2, 3, 3), np.uint8)
    assert space["place"] == gym.spaces.Box(-np.inf, np.inf, (2,), np.float64)
    shown, _ = env.reset(seed=1)
    assert space.contains(shown)


def test_robosuite_horizon_truncates() -> None:
    ahead = "eventually[0:0.3](always[0:9](height > -1))"
    specs: Any = {**readings("success", hold=0.3), "ahead": ahead}
    signals = {**FLAG, "height": "obs['place'][0]"}
    env = StlMonitor(robosuite.make("Lift", horizon=8), specs, signals)
    shown, info = env.reset(seed=0)
    flags, ended = [info["success"]], False
    while not ended:
        shown, _, terminated, ended, info = env.step(up(shown))
        assert not terminated
        flags.append(info["success"])
        assert info["own"] == 1
    assert flags == [0.0, 0.0, 0.0, *[1.0] * 6]
    verdicts = {name: item["verdict"] for name, item in info["stl_episode"].items()}
    assert verdicts == {**dict.fromkeys(readings(), "SATISFIED"), "ahead": "UNDECIDED"}


def test_robosuite_early_end_terminates() -> None:
    env = robosuite.make("Lift")
    inner = env.robosuite
    env.reset(seed=0)
    inner.step = lambda _action: ({"height": 0.0, "place": np.zeros(2)}, 0.0, True, {})
    assert env.step(up(None))[2:4] == (True, False)


def test_a_seed_repeats_an_episode_of_robosuite() -> None:
    env = robosuite.make("Lift")
    heights = [float(env.reset(seed=seed)[0]["height"][0]) for seed in (3, 4, 3)]
    assert heights[0] == heights[2] != heights[1]
    result = evaluate_policy(up, env, readings("success", hold=0.3), FLAG, episodes=3)
    assert (result.repeats, result.success.satisfied) == (True, 3)
    assert len(compare(up, "zero", env, readings("success", hold=0.3), FLAG, episodes=3).seeds) == 3


def test_what_is_no_robosuite_is_refused() -> None:
    with pytest.raises(InputTypeError, match="without GymWrapper, got TimeLimit"):
        robosuite.RobosuiteEnv(gym.make("CartPole-v1"))


# ---- Meta-World ----


def test_table_of_fifty_tasks() -> None:
    assert len(metaworld.TASKS) == 50
    for name, row in metaworld.TASKS.items():
        assert (row.quantity == "flag") == (row.side == 0)
        assert set(metaworld.done(name).variables) == set(metaworld.signals_of(name))
        assert row.tolerance >= 0
        assert f"metaworld/{name}" in gym.registry
    with pytest.raises(InputError, match="no task 'door-opn-v3'; did you mean 'door-open-v3'"):
        metaworld.done("door-opn-v3")


def test_door_beyond_its_target_is_kept() -> None:
    name = "door-open-v3"
    specs = {**readings("success", hold=0.25), "side": readings(metaworld.done(name))["kept"]}
    env = metaworld.make(name)
    result = evaluate_policy(
        "baseline", env, specs, {**FLAG, **metaworld.signals_of(name)}, episodes=3
    )
    counts = {spec: result.requirements[spec].satisfied for spec in specs}
    # 17 samples lie in the band: 0.2 s, and the rest takes 24 steps or more.
    StlMonitor(env, metaworld.done(name).always(), metaworld.signals_of(name))
    assert counts == {"any": 3, "last": 0, "held": 0, "kept": 0, "side": 3}
    assert result.repeats is True


def test_a_seed_is_the_number_of_a_variation() -> None:
    env = metaworld.make("door-open-v3", render_mode=None)
    starts = [float(env.reset(seed=seed)[0][4]) for seed in (0, 1, 2, 3)]
    assert starts == [0.0, 0.02, 0.04, 0.0]
    assert float(env.reset()[0][4]) == 0.0
    assert env.unwrapped.made == {"render_mode": None}  # type: ignore[attr-defined]


def test_a_lever_is_read_as_an_angle() -> None:
    joint = type("Joint", (), {"qpos": np.array([-1.5])})
    data = type("Data", (), {"joint": staticmethod(lambda name: {"LeverAxis": joint}[name])})
    env: Any = type("Env", (), {"unwrapped": type("Simulation", (), {"data": data})})
    read: Any = metaworld.signals_of("lever-pull-v3")["past"]
    result = read(Step(None, None, None, {}, env))
    assert result == pytest.approx(1.5 - np.pi / 2)


def test_the_command_judges_a_task(capsys: Output) -> None:
    task = "rtamt_gym.benchmarks.metaworld:metaworld/door-open-v3"
    assert main(["evaluate", task, "--policy", "baseline", "--success", "--episodes", "2"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "success.any 100.0%" in out
    assert "success.kept 0.0%" in out
    assert "success at some step, and not kept: 2 of 2 episodes, seeds 0, 1" in out


# ---- both ----


def test_missing_benchmark_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for module in ("robosuite", "metaworld"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install robosuite 'mujoco<3\.10' h5py"):
        robosuite.make("Lift")
    with pytest.raises(ModuleNotFoundError, match="pip install metaworld packaging"):
        metaworld.make("door-open-v3")
