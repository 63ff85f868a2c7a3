"""Requests and grants: the four signals of the paper, and a server against shifted arrays."""

from typing import Any, Literal

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray
from scenario_courses import course, made

import rtamt
from rtamt import evaluate
from rtamt_gym import simulate

PAPER = "always((req >= 3) implies eventually[0:5s](gnt >= 3))"
# The figure: the heights of a request at 2 s and of a grant at 6 s, each of 2 s.
HEIGHTS = {"a": (6.0, 6.0), "b": (2.0, 2.0), "c": (6.0, 1.0), "d": (4.0, 1.0)}
SETTINGS = {"a": {}, "b": {"height": 2.0}, "c": {"limit": 1.0}, "d": {"height": 4.0, "limit": 1.0}}
STANDARD = {"a": 3.0, "b": 1.0, "c": -2.0, "d": -1.0}
OUTPUT = {"a": 3.0, "b": np.inf, "c": -2.0, "d": -2.0}
VACUITY = {"a": 0.0, "b": 1.0, "c": 0.0, "d": 0.0}


def observed(signal: str) -> NDArray[np.float64]:
    env = made("RequestGrant", parameters=SETTINGS[signal])
    rows = [env.reset(seed=0)[0]]
    rows += [env.step(env.baseline())[0] for _ in range(150)]
    return np.array(rows)


@pytest.mark.parametrize("signal", HEIGHTS)
def test_the_baseline_makes_the_four_signals_of_the_paper(signal: str) -> None:
    times = np.arange(151) / 10
    request, grant = HEIGHTS[signal]
    np.testing.assert_array_equal(
        observed(signal).T,
        [
            np.where((times >= 2) & (times < 4), request, 0.0),
            np.where((times >= 6) & (times < 8), grant, 0.0),
        ],
    )


@pytest.mark.parametrize("signal", HEIGHTS)
@pytest.mark.parametrize(
    ("semantics", "expected"),
    [("standard", STANDARD), ("output-robustness", OUTPUT), ("input-vacuity", VACUITY)],
)
def test_robustness_is_that_of_the_paper_under_each_semantics(
    signal: str,
    semantics: Literal["standard", "output-robustness", "input-vacuity"],
    expected: dict[str, float],
) -> None:
    env = gym.make("rtamt/RequestGrant-v0", parameters=SETTINGS[signal])
    inner: Any = env.unwrapped
    granted = inner.requirements["granted"]
    run = simulate(env, granted, policy=inner.baseline, semantics=semantics, stop="end")
    assert run.histories["granted"].robustness[-1] == expected[signal]
    # As in the paper: unbounded, on the signal itself.
    trace = dict(zip(("req", "gnt"), observed(signal).T, strict=True))
    options: Any = {"semantics": semantics, "inputs": ["req"], "outputs": ["gnt"]}
    assert evaluate(PAPER, trace, period=0.1, **options)[0] == expected[signal]
    request, grant = HEIGHTS[signal]
    events = {
        "req": [(0, 0), (2, request), (4, 0), (10, 0)],
        "gnt": [(0, 0), (6, grant), (8, 0), (10, 0)],
    }
    assert rtamt.dense.evaluate(PAPER, events, **options)[0] == (0.0, expected[signal])


@pytest.mark.parametrize("delay", [0.0, 0.3, 2.37, 10.0])
@pytest.mark.parametrize("limit", [0.0, 4.0, 8.0])
def test_a_grant_is_the_limited_request_of_a_delay_ago(delay: float, limit: float) -> None:
    env = made("RequestGrant", parameters={"delay": delay, "limit": limit})
    requests = np.random.default_rng(1).uniform(0, 8, (400, 1))  # longer than the stored past
    seen = course(env, requests)
    late = round(delay * 10)
    given = np.concatenate([np.zeros(late + 1), requests[:, 0]])[:401]
    np.testing.assert_array_equal(seen[:, 0], [0.0, *requests[:, 0]])
    np.testing.assert_array_equal(seen[:, 1], np.minimum(given, limit))


def test_noise_moves_grants_alone_and_none_below_zero() -> None:
    quiet = made("RequestGrant")
    noisy = made("RequestGrant", parameters={"noise": 0.5})
    requests = np.full((4000, 1), 5.0)
    level, seen = course(quiet, requests), course(noisy, requests)
    np.testing.assert_array_equal(seen[:, 0], level[:, 0])
    assert seen[:, 1].min() == 0.0
    apart = (seen - level)[50:, 1]
    assert abs(apart.mean()) < 0.03
    assert apart.std() == pytest.approx(0.5, rel=0.05)
