"""A copy that is made in the midst of an episode goes on as the original does."""

from __future__ import annotations

import copy
import functools
import pickle
from typing import Any

import numpy as np
import pytest
from episode_oracle import chargeable, mismatch
from gymnasium.vector import AutoresetMode
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from scripts import Case, Scripted, cases, variables
from vector_environments import MODES, difference, sync

from rtamt_gym import StlMonitor, VectorStlMonitor

COSTS = (None, "violation", "depth", "latched", "first")
LANES = 3
pytestmark = [
    pytest.mark.filterwarnings(f"ignore:.*{word}:UserWarning")
    for word in ("at_termination", "is_success")
]


def arguments(case: Case, **options: Any) -> dict[str, Any]:  # noqa: ANN401
    assume(case.options.cost not in ("violation", "depth") or costs(case))
    return {**vars(case.options), "signals": variables(case.specs), "period": 1, **options}


def costs(case: Case) -> bool:
    return chargeable(case.specs, case.options.view)


@given(cases(COSTS), st.integers(0, 5))
def test_a_copied_or_pickled_monitor_goes_on_alike(case: Case, before: int) -> None:
    env = StlMonitor(Scripted(case.lanes[0]), case.specs, **arguments(case))
    env.reset()
    over = False
    for _ in range(before):
        over = over or any(env.step(0)[2:4])
        if over:
            break

    def rest(env: StlMonitor[Any, Any]) -> list[dict[str, Any]]:
        infos, ended = [], over
        for _ in range(12):
            if ended:
                infos.append(env.reset()[1])
                ended = False
            else:
                *_, terminated, truncated, info = env.step(0)
                infos.append(info)
                ended = terminated or truncated
        env.close()
        return [*infos, *env.stl_episodes]

    twins = pickle.loads(pickle.dumps(env)), copy.deepcopy(env)
    expected = rest(env)
    for twin in twins:
        assert mismatch(expected, rest(twin)) == ""


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@given(cases(COSTS, LANES), st.integers(0, 9))
@settings(max_examples=examples(30))
def test_a_copied_or_pickled_monitor_of_many_goes_on_alike(
    mode: AutoresetMode, case: Case, before: int
) -> None:
    def go(
        envs: VectorStlMonitor, steps: int, ended: NDArray[np.bool_]
    ) -> tuple[list[dict[str, Any]], NDArray[np.bool_]]:
        infos = []
        for _ in range(steps):
            if mode is AutoresetMode.DISABLED and ended.any():
                infos.append(envs.reset(options={"reset_mask": ended.copy()})[1])
            *_, terminated, truncated, info = envs.step(np.zeros(LANES, np.int64))
            infos.append(info)
            ended = np.logical_or(terminated, truncated)
        return infos, ended

    makes = [functools.partial(Scripted, scripts) for scripts in case.lanes]
    options = arguments(case, on_violation="report")
    envs = VectorStlMonitor(sync(makes, mode), case.specs, **options)
    envs.reset()
    _, ended = go(envs, before, np.zeros(LANES, np.bool_))
    twins = pickle.loads(pickle.dumps(envs)), copy.deepcopy(envs)
    expected = go(envs, 14, ended)
    for twin in twins:
        assert difference(go(twin, 14, ended), expected) == ""
        assert list(twin.stl_episodes) == list(envs.stl_episodes)
