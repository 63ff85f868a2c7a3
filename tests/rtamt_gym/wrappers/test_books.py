"""Wrappers inside of a monitor that count episodes count those too that the monitor ends."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics
from keepers import Fresh, Monitor
from replay import X, run

from rtamt_gym import StlMonitor
from rtamt_gym.wrappers.monitoring import OnViolation

# Ends by itself, is violated at sample 2, is violated at the sample that ends it.
EPISODES = [[3, 3, 3], [3, 3, 0, 3, 3], [3, 3, 0], [3, 0, 3]]


def played(env: gym.Env[Any, Any], replay: Fresh) -> list[dict[str, Any]]:
    """The last infos of the episodes."""
    lasts = []
    for values in EPISODES:
        replay.values = values
        lasts.append(run(env)[-1])
    return lasts


def counts(info: dict[str, Any]) -> tuple[float, int]:
    return float(info["episode"]["r"]), int(info["episode"]["l"])


EXPECTED = [(3.0, 2), (3.0, 2), (3.0, 2), (1.0, 1)]
"""Returns and lengths: the reward of step n is n."""


class Derived(Monitor):
    """A class of a user's own."""


@pytest.mark.parametrize("on_violation", ["terminate", "truncate"])
@pytest.mark.parametrize("keeper", [Monitor, Derived, RecordEpisodeStatistics])
def test_every_episode_is_counted_once_inside_as_outside(
    keeper: Any,  # noqa: ANN401 - a class of wrappers
    on_violation: OnViolation,
) -> None:
    replay = Fresh([])
    inside = keeper(replay)
    env = StlMonitor(inside, "always(x > 1)", X, on_violation=on_violation)
    assert [counts(info) for info in played(env, replay)] == EXPECTED
    outside = Fresh([])
    around = keeper(StlMonitor(outside, "always(x > 1)", X, on_violation=on_violation))
    assert [counts(info) for info in played(around, outside)] == EXPECTED
    if issubclass(keeper, Monitor):
        assert inside.rows == around.rows
        assert inside.total_steps == around.total_steps == 7
    else:
        assert list(inside.return_queue) == list(around.return_queue) == [3.0, 3.0, 3.0, 1.0]
        assert list(inside.length_queue) == list(around.length_queue) == [2, 2, 2, 1]
        assert inside.episode_count == around.episode_count == 4


def test_an_episode_that_goes_on_after_a_violation_is_counted_at_its_end() -> None:
    replay = Fresh([3, 0, 3, 3])
    env = StlMonitor(RecordEpisodeStatistics(replay), "always(x > 1)", X, on_violation="report")
    *running, last = run(env)
    assert not any("episode" in info for info in running)
    assert counts(last) == (6.0, 3)


def test_a_wrapper_of_the_same_name_that_keeps_no_books_is_left_alone() -> None:
    named = type("Monitor", (gym.Wrapper,), {})
    env = StlMonitor(named(Fresh([3, 0, 3])), "always(x > 1)", X)
    last = run(env)[-1]
    assert last["stl_violated"]
    assert "episode" not in last


def test_books_are_kept_by_a_wrapper_whose_environment_is_the_same_after_it() -> None:
    replay = Fresh([3, 0, 3])
    inside = RecordEpisodeStatistics(replay)
    env = StlMonitor(inside, "always(x > 1)", X)
    env.reset()
    env.step(np.array([0.5]))
    assert inside.env is replay
