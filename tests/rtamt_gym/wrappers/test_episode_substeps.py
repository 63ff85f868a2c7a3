"""The cost of a step that has several samples is that of the worst of them."""

from __future__ import annotations

import gymnasium as gym
import pytest
from episode_oracle import Options, charge

import rtamt
from rtamt_gym import Step, StlMonitor
from rtamt_gym.judging.costs import Cost

TEXTS = (
    "always(v < 0.5)",
    "always(v < 0.5) and always[2:9](v > -0.2)",
    "always(v > 0.2 implies eventually[0:3](v < 0))",
)


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("cost", ["violation", "depth"])
def test_the_cost_of_a_step_is_the_greatest_of_its_samples(text: str, cost: Cost) -> None:
    seen: list[float] = []

    def speed(step: Step) -> float:
        seen.append(float(step.env.unwrapped.data.qvel[1]))
        return seen[-1]

    env = StlMonitor(
        gym.make("HalfCheetah-v5"),
        text,
        {"v": speed},
        period=1,
        substeps=True,
        cost=cost,
        on_violation="report",
    )
    _, info = env.reset(seed=3)
    env.action_space.seed(3)
    assert "cost" not in info
    formula, costs = rtamt.parse(text).formula, []
    for _ in range(12):
        begin = env.samples
        info = env.step(env.action_space.sample())[4]
        charged = [
            charge(formula, {"v": seen}, t, Options(cost=cost)) for t in range(begin, env.samples)
        ]
        assert len(charged) == 5
        assert info["cost"] == max(charged)
        costs.append(info["cost"])
    assert 0 < sum(cost > 0 for cost in costs) < 12
    env.close()
