"""`StlMonitor`: its reports about an episode, when it ends an episode, and its errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from replay import Replay, X, run

import rtamt
from rtamt_gym import StlMonitor
from rtamt_gym.judging.specs import SpecLike
from rtamt_gym.options.evaluation import View


def verdict(info: dict[str, Any], name: str = "spec") -> str:
    return str(info["stl_episode"][name]["verdict"])


def test_a_formula_built_in_python_is_a_specification() -> None:
    formula = (abs(rtamt.variable("theta")) < 0.2).always()
    env = StlMonitor(gym.make("CartPole-v1"), {"upright": formula}, {"theta": "obs[2]"})
    assert env.spec is not None
    remade = gym.make(env.spec)
    assert env.reset(seed=1)[1]["robustness"] == remade.reset(seed=1)[1]["robustness"] > 0.1


def test_a_fallen_pole_is_violated_though_only_the_terminal_observation_shows_it() -> None:
    upright = StlMonitor(
        gym.make("CartPole-v1"), "always(abs(theta) < 0.2095)", {"theta": "obs[2]"}
    )
    obs, info = upright.reset(seed=3)
    terminated = False
    while not terminated:
        assert abs(obs[2]) < 0.2095
        assert info["robustness"] > 0.0
        obs, _, terminated, _, info = upright.step(1)
    assert abs(obs[2]) > 0.2095
    assert verdict(info) == "VIOLATED"
    assert info["stl_violated_at"] == upright.samples - 1
    assert info["is_success"] is False


def test_robustness_is_that_of_the_samples_so_far() -> None:
    text = "always(abs(theta) > 0.05 implies eventually[0:0.1](abs(omega) < 0.3))"
    signals = {"theta": "obs[2]", "omega": "obs[3]"}
    env = StlMonitor(gym.make("CartPole-v1"), text, signals, on_violation="report")
    obs, info = env.reset(seed=5)
    env.action_space.seed(5)
    seen = [obs]
    ended = False
    while not ended:
        columns = {"theta": np.array(seen)[:, 2], "omega": np.array(seen)[:, 3]}
        assert info["robustness"] == rtamt.evaluate(text, columns, period=0.02)[0]
        obs, _, terminated, truncated, info = env.step(env.action_space.sample())
        seen.append(obs)
        ended = terminated or truncated
    assert env.samples == len(seen)


# ---- ends ----


def test_every_specification_gets_its_own_variables() -> None:
    specs = {"a": "always(u + x > 0)", "b": "always(r < 9)", "c": "always(x - u > 0)"}
    signals = {"x": "obs[0]", "u": ("action[0]", 0.25), "r": ("reward", 0)}
    infos = run(StlMonitor(Replay([1, 2, 3]), specs, signals, details=True))
    result = [[spec["robustness"] for spec in info["stl"].values()] for info in infos]
    assert result == [[1.25, 9.0, 0.75], [1.25, 8.0, 0.75], [1.25, 7.0, 0.75]]


# ---- info ----


def test_info_is_flat_typed_and_fresh() -> None:
    env = Replay([3, 2, 4])
    infos = run(StlMonitor(env, "always(x > 1)", X))
    for info in infos:
        types = [type(info[key]) for key in STATE]
        assert types == [np.float64, np.float64, np.float64, bool]
        assert info["own"] == 1
    assert env.info == {"own": 1}
    assert [sorted(info.keys() - {"own"}) for info in infos[:2]] == [sorted(STATE)] * 2
    last = infos[-1]["stl_episode"]["spec"]
    assert [type(value) for value in last.values()] == [np.float64, str, bool, int]


STATE = ("robustness", "stl_lower", "stl_upper", "stl_violated")


# ---- view="step" ----


def test_the_step_view_is_the_monitor_instant_by_instant() -> None:
    text = "x > 2 implies eventually[0:2](x < 1)"
    values = [3, 0, 4, 2, 0.5, 3, 3, 3, 0]
    online = rtamt.Monitor(text)
    monitor = StlMonitor(Replay(values), text, X, view="step", on_violation="report", period=1)
    infos = run(monitor)
    expected = [online.update(x) for x in values]
    assert [info["robustness"] for info in infos[2:]] == expected[2:]
    # Before the first instant is settled: time 0, of the samples so far.
    sofar = [rtamt.evaluate(text, {"x": np.array(values[: n + 1])})[0] for n in range(2)]
    assert [info["robustness"] for info in infos[:2]] == sofar


def test_the_step_view_keeps_names_constants_and_units() -> None:
    text = "const float c = 1\nfloat x\np = x > c\nq = eventually[0:20](p)"
    spec = rtamt.parse(text, unit="ms")
    last = run(StlMonitor(Replay([0, 2] + [0] * 9), spec, X, view="step", period=0.01))[-1]
    assert (last["stl_violated_by"], last["stl_violated_at"]) == ("q", 4)


# ---- specifications ----


def test_a_specification_comes_as_text_path_or_object(tmp_path: Path) -> None:
    path = tmp_path / "low.stl"
    path.write_text("specification low\nalways(x < 5)\n", encoding="utf-8")
    for spec in (path, str(path), rtamt.load(path), "specification low\nalways(x < 5)"):
        last = run(StlMonitor(Replay([1, 9]), spec, X))[-1]
        assert last["stl_violated_by"] == "low"
        assert last["stl_violated_at"] == 1
    several: dict[str, SpecLike] = {"a": path, "b": "always(x < 20)"}
    assert run(StlMonitor(Replay([1, 9]), several, X))[-1]["stl_violated_by"] == "a"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("always(x > 5)", "spec"),
        ("low = always(x > 5)", "low"),
        ("specification s\nlow = always(x > 5)", "s"),
        ("p = x > 5; always(p)", "spec"),
    ],
)
def test_one_specification_has_the_name_that_its_text_gives(text: str, name: str) -> None:
    assert run(StlMonitor(Replay([1, 9]), text, X))[-1]["stl_violated_by"] == name


@pytest.mark.parametrize("view", ["episode", "step"])
def test_requirements_of_one_text_are_each_fed_what_they_read(view: View) -> None:
    signals = {"y": ("reward", 0.0), **X}
    text = "r = always(y > -9); q = always(x > 1)"
    env = StlMonitor(Replay([3, 2, 4]), text, signals, view=view)
    assert [info["robustness"] for info in run(env)] == [2.0, 1.0, 1.0]
