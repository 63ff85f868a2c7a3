"""Bounds that fit no step: wrappers and `StepMonitor` round them as the monitors do."""

from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

import rtamt_gym
from rtamt import InputError, SpecificationError

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


def episode(specs: str, **options: Any) -> list[float]:  # noqa: ANN401 - those of the wrapper
    """The robustness after each step of an episode."""
    env = rtamt_gym.StlMonitor(
        gym.make("CartPole-v1"), specs, SIGNALS, on_violation="report", **options
    )
    env.reset(seed=3)
    return [env.step(i % 2)[4]["robustness"] for i in range(12)]


@pytest.mark.parametrize("align", FITTING)
def test_an_environment_is_monitored_as_with_the_rounded_bounds(align: str) -> None:
    assert episode(MISFIT, align=align) == episode(FITTING[align])
    part, fitting = (text[len("always(") : -1] for text in (MISFIT, FITTING[align]))
    assert episode(part, align=align, view="step") == episode(fitting, view="step")


@pytest.mark.parametrize("align", FITTING)
def test_environments_are_monitored_as_with_the_rounded_bounds(align: Any) -> None:  # noqa: ANN401
    found = []
    for text, options in ((MISFIT, {"align": align}), (FITTING[align], {})):
        envs = gym.make_vec("CartPole-v1", 2, vectorization_mode="sync")
        env = rtamt_gym.VectorStlMonitor(envs, text, SIGNALS, **options)
        env.reset(seed=3)
        steps = [env.step(np.array([i % 2, 1]))[4]["robustness"].tolist() for i in range(8)]
        found.append(steps)
    assert found[0] == found[1]


@pytest.mark.parametrize("align", FITTING)
def test_a_simulation_is_monitored_as_with_the_rounded_bounds(align: Any) -> None:  # noqa: ANN401
    found = []
    for text, options in ((MISFIT, {"align": align}), (FITTING[align], {})):
        model = mujoco.MjModel.from_xml_string(MODEL)
        data = mujoco.MjData(model)
        spec = text.replace("abs(x) < 0.03", "x > 0.99")
        monitor = rtamt_gym.StepMonitor(model, data, spec, {"x": "body:ball.xpos[2]"}, **options)
        found.append([monitor.step() for _ in range(6)])
    assert found[0] == found[1]


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
