"""The monitors of several specifications: updated in one call or one by one, and their results."""

from __future__ import annotations

import copy
import math
import pickle
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from bits import bits
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from replay import shaping_options
from strategies import VARIABLES, Trace, formulas, length, sample, traces

import rtamt
from rtamt import Formula
from rtamt_gym import EvaluationOptions, StlMonitor, StlReward
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.judging.monitors import InstantMonitor, VectorInstantMonitor, columns_of
from rtamt_gym.judging.vector_monitor_set import VectorMonitorSet

SIGNALS = {"a": "obs[0]", "b": "obs[1]", "c": ("info['c']", None)}
SPECS = st.lists(formulas(depth=2, endless=True), min_size=1, max_size=3).map(
    lambda given: {f"spec{i}": each.always() for i, each in enumerate(given)}
)


class Played(gym.Env[Any, Any]):
    """Observes a trace; the variable c is in the info, but not at a reset."""

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = spaces.Discrete(2)

    def __init__(self, trace: Trace) -> None:
        self.rows = [sample(trace, i) for i in range(length(trace))]
        self.at = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.at = 0
        return self._shown()

    def step(self, _action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at += 1
        obs, info = self._shown()
        return obs, 0.5, self.at == len(self.rows) - 1, False, info

    def _shown(self) -> tuple[Any, dict[str, Any]]:
        row = self.rows[self.at]
        return np.array([row["a"], row["b"]]), {"c": row["c"]}


class Passing(gym.Wrapper[Any, Any, Any, Any]):
    """A wrapper without an effect."""


def plain(value: Any) -> Any:  # noqa: ANN401 - an info
    """Return an info with its numbers as bits."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, float):
        return type(value), bits([value])
    return value


def played(env: gym.Env[Any, Any], steps: int) -> list[Any]:
    """Return the results of two episodes; the second continues in a copy and in a pickle."""
    found = []
    for _ in range(2):
        _, info = env.reset(seed=1)
        found.append(plain(info))
        for at in range(steps):
            *_, reward, terminated, truncated, info = env.step(0)
            found.append((plain(float(reward)), terminated, truncated, plain(info)))
            if terminated or truncated:
                break
            if at == 1:
                env = pickle.loads(pickle.dumps(copy.deepcopy(env)))
    return found


@settings(max_examples=examples(40))
@given(
    specs=SPECS,
    trace=traces(least=4),
    options=st.sampled_from(
        [{}, {"details": True}, {"cost": "latched"}, {"on_violation": "truncate"}]
    ),
)
def test_infos_match_single_monitors(
    specs: dict[str, Formula], trace: Trace, options: dict[str, Any]
) -> None:
    signals = {name: SIGNALS[name] for name in VARIABLES} | {"c": "info['c']"}
    given_options = {"at_termination": "complete", "period": 1, **options}
    at_once, kept = (
        StlMonitor(Played(trace), specs, signals, history=history, **given_options)
        for history in (False, True)
    )
    steps = length(trace) - 1
    assert played(at_once, steps) == played(kept, steps)


@pytest.mark.parametrize("mode", ["add", "replace", "potential", "terminal", "progress"])
@settings(max_examples=examples(15))
@given(
    specs=SPECS,
    trace=traces(least=4),
    weight=st.sampled_from([1.0, 0.1, 3.0]),
    bonus=st.sampled_from([0.0, 2.0]),
)
def test_rewards_survive_wrappers_that_change_infos(
    mode: str, specs: dict[str, Formula], trace: Trace, weight: float, bonus: float
) -> None:
    signals = {name: SIGNALS[name] for name in VARIABLES} | {"c": "info['c']"}
    shaping: dict[str, Any] = {
        **shaping_options(mode, *specs),
        "weights": dict.fromkeys(specs, weight),
        "bonus": bonus,
        "clip": 2.5,
    }
    monitors = [
        StlMonitor(Played(trace), specs, signals, at_termination="complete", period=1)
        for _ in range(2)
    ]
    alone, apart = StlReward(monitors[0], **shaping), StlReward(Passing(monitors[1]), **shaping)
    steps = length(trace) - 1
    assert played(alone, steps) == played(apart, steps)


def test_no_robustness_without_samples() -> None:
    spec = rtamt.parse("x > 1")
    assert math.isnan(InstantMonitor(spec).robustness)
    assert np.isnan(VectorInstantMonitor(spec, 3).robustness).tolist() == [True, True, True]


@pytest.mark.parametrize(
    ("above", "certain"),
    [({}, False), ({"task": 1.0}, True), ({"task": 2.0}, False), ({"task": 3.0}, False)],
)
def test_knows_values_that_stay_above(above: dict[str, float], *, certain: bool) -> None:
    """It is 2 or more from the first sample on, so it is not certain to stay above 2."""
    specs = {"task": rtamt.parse("eventually(x > 0)")}
    single, many = (
        MonitorSet(specs, EvaluationOptions()),
        VectorMonitorSet(specs, 2, EvaluationOptions(), ["x"]),
    )
    single.feeder(["x"])([2.0])
    many.feed(np.array([[2.0], [-2.0]]))
    assert single.knows(above) is certain
    assert many.knows(above).tolist() == [certain, False]


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ([], []),
        ([3], slice(3, 4)),
        ([2, 3, 4], slice(2, 5)),
        ([2, 4], [2, 4]),
        ([3, 2], [3, 2]),
    ],
)
def test_adjacent_columns_need_no_copy(columns: list[int], expected: slice | list[int]) -> None:
    monitor: Any = SimpleNamespace(variables=[str(column) for column in columns])
    assert columns_of(monitor, [*"0123456"]) == expected
