"""What costs charge of verdicts that an end, or the sample of a reset, decides."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from replay import Replay
from vector_environments import sync

from rtamt_gym import StlMonitor, VectorStlMonitor
from rtamt_gym.judging.costs import Cost

OWED = "always(x > 0 implies eventually[0:5](x < 0))"
"""Of 1, 2, 3 the end alone decides that nothing has answered."""

ENDS: dict[str, tuple[str, list[float], dict[str, Any]]] = {
    "an answer missing at the end": (OWED, [1.0, 2.0, 3.0], {"at_termination": "complete"}),
    "a failure": ("always(x > 0)", [1.0, 2.0, 3.0], {"at_termination": "failure"}),
}


def costs(text: str, values: list[float], cost: Any, **options: Any) -> list[float]:  # noqa: ANN401
    """The costs of the steps, the same of one environment and of many."""
    given: dict[str, Any] = {"period": 1, "cost": cost, "on_violation": "report", **options}
    env = StlMonitor(Replay(values), text, {"x": "obs[0]"}, **given)
    envs = VectorStlMonitor(
        sync([lambda: Replay(values)], AutoresetMode.NEXT_STEP), text, {"x": "obs[0]"}, **given
    )
    env.reset()
    envs.reset()
    found = []
    for _ in values[1:]:
        found.append(float(env.step(np.zeros(1))[4]["cost"]))
        assert envs.step(np.zeros((1, 1)))[4]["cost"].tolist() == [found[-1]]
    return found


@pytest.mark.parametrize("case", ENDS)
def test_latched_and_first_charge_what_only_the_end_decides(case: str) -> None:
    text, values, options = ENDS[case]
    for cost in get_args(Cost):
        charged = cost in {"latched", "first"}
        assert costs(text, values, cost, **options) == [0.0, float(charged)], cost


def test_latched_and_first_charge_what_the_reset_decides_at_the_first_step() -> None:
    values = [-1.0, 2.0, 3.0]
    found = {
        cost: costs("always(x > 0)", values, cost, at_termination="complete")
        for cost in get_args(Cost)
    }
    assert found == {
        "violation": [0.0, 0.0],
        "depth": [0.0, 0.0],
        "latched": [1.0, 1.0],
        "first": [1.0, 0.0],
    }
