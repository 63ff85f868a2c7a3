"""Monitors and simulations round bounds that are not multiples of a step equally."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

import rtamt_gym
from rtamt import InputError, SpecificationError
from rtamt_gym.__main__ import main

# CartPole makes a step in 0.02 s.
MISFIT = "always(eventually[0.01:0.05](abs(x) < 0.03))"
FITTING = {
    "outward": "always(eventually[0:0.06](abs(x) < 0.03))",
    "inward": "always(eventually[0.02:0.04](abs(x) < 0.03))",
    "nearest": "always(eventually[0:0.06](abs(x) < 0.03))",
}
SIGNALS = {"x": "obs[0]"}
MODEL = """<mujoco><option timestep="0.02"/><worldbody>
<body name="ball" pos="0 0 1"><freejoint/><geom size="0.1" mass="1"/></body>
</worldbody></mujoco>"""


def episode(specs: str, **options: Any) -> list[float]:
    """Return the robustness after each step of an episode."""
    env = rtamt_gym.StlMonitor(
        gym.make("CartPole-v1"), specs, SIGNALS, on_violation="report", **options
    )
    env.reset(seed=3)
    return [env.step(i % 2)[4]["robustness"] for i in range(12)]


def instants(text: str, **options: Any) -> list[float]:
    """The same of the formula without its outer always, with ``view="step"``."""
    return episode(text[len("always(") : -1], view="step", **options)


def episodes(text: str, **options: Any) -> list[list[float]]:
    """The robustness of two environments after each step."""
    envs = gym.make_vec("CartPole-v1", 2, vectorization_mode="sync")
    env = rtamt_gym.VectorStlMonitor(envs, text, SIGNALS, **options)
    env.reset(seed=3)
    return [env.step(np.array([i % 2, 1]))[4]["robustness"].tolist() for i in range(8)]


def simulation(text: str, **options: Any) -> list[float]:
    """The robustness after each step of a simulation in MuJoCo."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    spec = text.replace("abs(x) < 0.03", "x > 0.99")
    signals: Any = {"x": "body:ball.xpos[2]"}
    monitor = rtamt_gym.StepMonitor(model, mujoco.MjData(model), spec, signals, **options)
    return [monitor.step() for _ in range(6)]


def rollouts(text: str, **options: Any) -> Any:
    """The robustness of rollouts."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.random.default_rng(0).uniform(-0.1, 0.1, (2, 20, size))
    found = rtamt_gym.mujoco.evaluate_rollouts(model, text, {"x": "qpos[0]"}, states, **options)
    return found["spec"].tolist()


@pytest.mark.parametrize("align", FITTING)
@pytest.mark.parametrize("run", [episode, instants, episodes, simulation, rollouts])
def test_monitored_as_with_the_rounded_bounds(run: Callable[..., Any], align: str) -> None:
    assert run(MISFIT, align=align) == run(FITTING[align])


@pytest.mark.parametrize("align", FITTING)
def test_a_run_and_its_replay_are_those_of_the_rounded_bounds(align: Any, tmp_path: Path) -> None:
    env = gym.make("CartPole-v1", max_episode_steps=12)
    run, fitting = (
        rtamt_gym.simulate(env, {"s": text}, SIGNALS, policy=lambda _: 1, seed=3, **options)
        for text, options in ((MISFIT, {"align": align}), (FITTING[align], {}))
    )
    np.testing.assert_array_equal(run.histories["s"].robustness, fitting.histories["s"].robustness)
    run.save(tmp_path / "run.parquet")
    for again in (run, rtamt_gym.results.Run.load(tmp_path / "run.parquet")):
        assert again == run
        assert again.align == align
        np.testing.assert_array_equal(again.replay()["s"], fitting.replay()["s"])
        np.testing.assert_array_equal(again.replay({"s": MISFIT})["s"], fitting.replay()["s"])


def test_the_command_takes_it_and_its_advice_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["run", "CartPole-v1", "--spec", MISFIT, "--signal", "x=obs[0]"]
    assert main([*command, "--align", "nearest"]) == 0
    assert main(["run", "CartPole-v1", "--spec", FITTING["nearest"], *command[4:]]) == 0
    first, second = capsys.readouterr().out.split("spec: ")[1:]
    assert first.splitlines()[1:] == second.splitlines()[1:]
    assert main(command) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: STL:1:18: bound 0.01 s is not a multiple of the period 0.02 s (0.5 steps)\n"
        f"  {MISFIT}\n                   ^\n"
        "  hint: use 0 s or 0.02 s, take samples 0.01 s apart, or let --align round it\n"
    )


def test_a_reward_takes_it_and_a_wrapper_can_be_made_again() -> None:
    env = rtamt_gym.StlReward(gym.make("CartPole-v1"), MISFIT, SIGNALS, mode="add", align="inward")
    env.reset(seed=3)
    assert env.spec is not None
    again = gym.make(env.spec)
    again.reset(seed=3)
    assert again.step(0)[1] == env.step(0)[1]


def test_without_it_bounds_must_fit_and_another_way_is_refused() -> None:
    with pytest.raises(SpecificationError, match="or let align= round it"):
        episode(MISFIT)
    with pytest.raises(InputError, match="align"):
        episode(MISFIT, align="up")
    env = gym.make("CartPole-v1")
    with pytest.raises(SpecificationError, match="or let align= round it"):
        rtamt_gym.simulate(env, MISFIT, SIGNALS, policy=lambda _: 0)
    with pytest.raises(InputError) as caught:
        rtamt_gym.simulate(env, MISFIT, SIGNALS, policy=lambda _: 0, align="up")  # type: ignore[arg-type]  # refused
    assert str(caught.value) == ("expected align=None, 'outward', 'inward' or 'nearest', got 'up'")
