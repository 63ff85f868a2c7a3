"""Repeated worst episodes are compared with the record."""

from __future__ import annotations

import warnings
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import SyncVectorEnv

from rtamt import StateError
from rtamt_gym import compare, evaluate_policy
from rtamt_gym.evaluation.replays import HOW_TO_REPLAY, UnrepeatedSeedWarning
from rtamt_gym.results import Evaluation

SPECS, SIGNALS = {"low": "always(x < 3)"}, {"x": "obs[0]"}
STOPS: list[Any] = ["end", "violation", "decided", "known", "verdicts"]


class Line(gym.Env[Any, Any]):
    """Observes the action; episodes take four steps, and every reset starts at 0."""

    observation_space = spaces.Box(-99.0, 99.0, (1,), np.float64)
    action_space = spaces.Box(-99.0, 99.0, (1,), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.at = 0
        return np.zeros(1), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        self.at += 1
        return np.array(action, np.float64), 0.0, False, self.at == 4, {}


def drifting() -> Any:  # noqa: ANN401
    """Return a policy with its own numbers: each action is larger than all before."""
    numbers = count(1)
    return lambda _: np.array([next(numbers) / 10])


class Seeded:
    """A policy whose numbers depend on the seed of the episode."""

    def __init__(self, seed: int) -> None:
        self.generator = np.random.default_rng(seed)

    def __call__(self, _: Any) -> Any:  # noqa: ANN401
        return self.generator.uniform(0.0, 4.0, 1)


def told_by(policy: Any, env: Any, **options: Any) -> tuple[Evaluation, list[str]]:  # noqa: ANN401
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = evaluate_policy(
            policy, env, SPECS, SIGNALS, **{"period": 1, "episodes": 9, **options}
        )
    assert all(each.category is UnrepeatedSeedWarning for each in told)
    assert all(each.filename == __file__ for each in told)
    return found, [str(each.message) for each in told]


@pytest.mark.parametrize("keep", [1, 3])
def test_policy_with_numbers_of_its_own_does_not_repeat(keep: int, tmp_path: Path) -> None:
    found, told = told_by(drifting(), Line(), keep=keep)
    # The last of nine episodes has the actions 3.3 to 3.6; it is repeated with 3.7 to 4.0.
    (message,) = told
    assert message == (
        "episode 8 of Line does not repeat: low had robustness -0.6 (VIOLATED), and -1 (VIOLATED) "
        f"when it was played again; {HOW_TO_REPLAY}"
    )
    assert found.repeats is False
    assert found.differing == (8, 7, 6)[:keep]
    assert found.worst_runs == {"low": ()}
    assert "note: episode 8 differed when it was played again" in str(found)
    with pytest.raises(StateError, match="cannot play episode 2 again: episode 8 differed"):
        found.replay(2)
    found.save(tmp_path / "e.json")
    assert Evaluation.load(tmp_path / "e.json") == found


@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("n_envs", [1, 4])
def test_seeded_policy_repeats_however_episodes_stop(stop: Any, n_envs: int) -> None:  # noqa: ANN401
    found, told = told_by(Seeded, Line(), stop=stop, n_envs=n_envs, keep=9)
    assert (told, found.repeats, found.differing) == ([], True, ())
    assert len(found.worst_runs["low"]) == 9
    violated = [
        each.verdict.name == "VIOLATED" for row in found.record for each in [row.outcomes["low"]]
    ]
    assert 0 < sum(violated) < 9


@pytest.mark.parametrize("stop", STOPS)
def test_drifting_policy_is_noticed_however_episodes_stop(stop: Any) -> None:  # noqa: ANN401
    found, told = told_by(drifting(), Line(), stop=stop)
    assert (len(told), found.repeats) == (1, False)


def test_vector_environments_are_compared_too() -> None:
    found, told = told_by(drifting(), SyncVectorEnv([Line] * 3))
    assert (len(told), found.repeats) == (1, False)
    found, told = told_by(Seeded, SyncVectorEnv([Line] * 3))
    assert (told, found.repeats) == ([], True)


def test_replay_of_another_episode_warns() -> None:
    found, told = told_by(drifting(), Line(), keep=0)
    assert (told, found.repeats) == ([], True)  # no episode was repeated
    with pytest.warns(UnrepeatedSeedWarning, match="episode 2 of Line does not repeat"):
        found.replay(2)


def test_policies_with_numbers_of_their_own_are_still_paired() -> None:
    one, _ = told_by(drifting(), Line(), name="one")
    other, _ = told_by(drifting(), Line(), name="other")
    assert len(compare(one, other, accept_changed=True).seeds) == 9
