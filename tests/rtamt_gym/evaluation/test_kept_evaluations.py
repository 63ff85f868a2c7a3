"""Later calls change neither a finished evaluation nor its environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import rtamt_gym
from rtamt_gym import StlMonitor, evaluate_policy

EPISODES, STEPS = 4, 6
READ: Any = {"period": 1, "at_termination": "complete"}


class Level(gym.Env[Any, Any]):
    """Observes the number of steps; may act differently in a later reset."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (1,), np.float32)
    action_space = gym.spaces.Discrete(2)

    def __init__(self, at_reset: Callable[[int], None] = lambda _: None) -> None:
        self.at_reset, self.resets, self.at = at_reset, 0, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.resets, self.at = self.resets + 1, 0
        self.at_reset(self.resets)
        return self._shown(), {}

    def step(self, _action: object) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at += 1
        return self._shown(), 1.0, False, self.at == STEPS, {}

    def _shown(self) -> Any:  # noqa: ANN401
        return np.array([self.at], np.float32)


class Model:
    """A model that acts in a batch until an error is raised."""

    def __init__(self, raised: BaseException, after: int) -> None:
        self.raised, self.left = raised, after

    def predict(
        self,
        observation: Any,  # noqa: ANN401
        state: Any = None,  # noqa: ANN401
        episode_start: Any = None,  # noqa: ANN401, ARG002
        deterministic: bool = False,  # noqa: FBT001, FBT002, ARG002 - as models have it
    ) -> tuple[Any, Any]:
        self.left -= 1
        if self.left < 0:
            raise self.raised
        return np.zeros(len(observation), np.int64), state


def evaluate(env: Any, **options: Any) -> rtamt_gym.results.Evaluation:  # noqa: ANN401
    given: dict[str, Any] = {"episodes": EPISODES, "keep": 1, **READ, **options}
    return evaluate_policy(lambda _: 0, env, "always(x < 4)", {"x": "obs[0]"}, **given)


def raising(error: BaseException, resets: int) -> Callable[[int], None]:
    def at_reset(count: int) -> None:
        if count > resets:
            raise error

    return at_reset


def test_ctrl_c_while_the_worst_episodes_are_played_again_keeps_the_evaluation() -> None:
    # At the test of seeds, and at the repeat of the worst episode.
    for resets in (EPISODES, EPISODES + 2):
        with pytest.raises(KeyboardInterrupt) as pressed:
            evaluate(Level(raising(KeyboardInterrupt(), resets)))
        found: Any = pressed.value
        evaluation = found.evaluation
        assert [row.seed for row in evaluation.record] == list(range(EPISODES))
        assert evaluation.interrupted is None
        assert all(row.outcomes["spec"].robustness == -2 for row in evaluation.record)


def test_a_worst_episode_that_fails_when_it_is_played_again_is_told_and_left_out() -> None:
    with pytest.warns(RuntimeWarning, match="seed 0 is missing.*ValueError: gone"):
        found = evaluate(Level(raising(ValueError("gone"), EPISODES + 2)))
    assert len(found.record) == EPISODES
    assert found.worst_runs == {"spec": ()}


@pytest.mark.filterwarnings("ignore:6 of 9 episodes failed")
@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit])
def test_an_end_amid_episodes_side_by_side_leaves_the_monitors_as_they_were(
    kind: type[BaseException],
) -> None:
    made: list[StlMonitor[Any, Any]] = []

    def make() -> StlMonitor[Any, Any]:
        made.append(StlMonitor(Level(), "always(x < 4)", {"x": "obs[0]"}, **READ))
        return made[-1]

    model = Model(kind(3), STEPS + 2)
    try:
        evaluate_policy(model, make, episodes=9, n_envs=3, keep=0)
    except KeyboardInterrupt:
        assert kind is KeyboardInterrupt
    assert len(made) == 3
    for env in made:
        assert isinstance(env.env, Level)
        env.reset(seed=1)
        ended = [env.step(0)[2] for _ in range(4)]
        assert ended == [False, False, False, True]  # it terminates violated episodes again


def test_enough_episodes_leave_the_others_side_by_side_as_they_were() -> None:
    made: list[StlMonitor[Any, Any]] = []

    def make() -> StlMonitor[Any, Any]:
        made.append(StlMonitor(Level(), "always(x < 4)", {"x": "obs[0]"}, **READ))
        return made[-1]

    model = Model(AssertionError("never"), 10**6)
    evaluate_policy(*(model, make), episodes=500, n_envs=3, until_width=0.5, keep=0)
    assert all(isinstance(env.env, Level) for env in made)
