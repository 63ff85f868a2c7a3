"""A policy gets the same observations in an evaluation as in training."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecEnv,
    VecExtractDictObs,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecTransposeImage,
)
from stable_baselines3.common.vec_env.base_vec_env import VecEnvWrapper

from rtamt import InputError
from rtamt_gym.learners.sb3 import as_trained

BOX = spaces.Box(-9, 9, (3,), np.float32)
IMAGE = spaces.Box(0, 255, (40, 36, 3), np.uint8)
DICT = spaces.Dict({"near": BOX, "far": spaces.Box(-1, 1, (2,), np.float32)})


class Drawn(gym.Env[Any, Any]):
    """Random observations, episodes of any length; the newest observation is kept."""

    action_space = spaces.Discrete(2)

    def __init__(self, space: spaces.Space[Any], seed: int) -> None:
        self.observation_space = space
        space.seed(seed)
        self.rng = np.random.default_rng(seed)

    def reset(self, **arguments: Any) -> Any:  # noqa: ANN401
        super().reset(**arguments)
        self.raw = self.observation_space.sample()
        return self.raw, {}

    def step(self, _action: object) -> Any:  # noqa: ANN401
        self.raw = self.observation_space.sample()
        return self.raw, 1.0, bool(self.rng.random() < 0.2), False, {}


class Seen:
    """A model that does not act, and keeps its observations."""

    action_space = spaces.Discrete(2)

    def __init__(self, venv: VecEnv) -> None:
        self.get_env = lambda: venv

    def predict(self, observation: Any, state: Any, starts: Any, **_: object) -> Any:  # noqa: ANN401
        self.shown, self.starts = observation, starts
        number = len(
            next(iter(observation.values())) if isinstance(observation, dict) else observation
        )
        return np.zeros(number, int), (state or 0) + 1


CASES: dict[str, tuple[spaces.Space[Any], Any]] = {
    "normalised": (BOX, VecNormalize),
    "stacked": (BOX, lambda envs: VecFrameStack(envs, 3)),
    "normalised, then stacked": (BOX, lambda envs: VecFrameStack(VecNormalize(envs), 2)),
    "stacked, then normalised": (BOX, lambda envs: VecNormalize(VecFrameStack(envs, 2))),
    "counted in between": (BOX, lambda envs: VecFrameStack(VecMonitor(VecNormalize(envs)), 2)),
    "pictures": (IMAGE, lambda envs: VecTransposeImage(VecFrameStack(envs, 2))),
    "pictures, turned first": (IMAGE, lambda envs: VecFrameStack(VecTransposeImage(envs), 2)),
    "dictionaries": (DICT, lambda envs: VecFrameStack(VecNormalize(envs), 3)),
    "one entry": (DICT, lambda envs: VecFrameStack(VecExtractDictObs(envs, "near"), 2)),
}


def equal(found: Any, expected: Any) -> bool:  # noqa: ANN401
    if isinstance(expected, dict):
        return found.keys() == expected.keys() and all(
            equal(found[key], part) for key, part in expected.items()
        )
    return bool(np.array_equal(found, expected))


def row(observation: Any, i: int) -> Any:  # noqa: ANN401
    """Return row i of a batch, as a batch."""
    if isinstance(observation, dict):
        return {key: part[i : i + 1] for key, part in observation.items()}
    return observation[i : i + 1]


@pytest.mark.parametrize("case", CASES)
def test_a_model_is_shown_what_the_wrappers_of_training_show(case: str) -> None:
    space, around = CASES[case]
    envs = [Drawn(space, seed) for seed in range(2)]
    batched = DummyVecEnv([lambda env=env: env for env in envs])
    venv = around(batched)
    model = Seen(venv)
    together, alone = as_trained(model), [as_trained(model) for _ in envs]
    states: list[Any] = [None, None, None]
    starts = np.ones(2, bool)
    shown = venv.reset()
    number = 0
    for step in range(80):
        if step == 40:  # training continues before it; its statistics stay fixed in an evaluation
            frozen(venv)
        if step >= 40:
            raw = [env.raw for env in envs]
            stack = (
                {key: np.stack([each[key] for each in raw]) for key in raw[0]}
                if isinstance(space, spaces.Dict)
                else np.stack(raw)
            )
            actions, states[2] = together.predict(stack, states[2], starts, deterministic=True)
            if number > 5:  # stacks were empty at the start
                assert equal(model.shown, shown)
                assert actions.shape == (2,)
                assert model.starts.tolist() == starts.tolist()
                assert states[2][1] == number + 1  # the memory of the model is passed on
            for i in range(2):
                action, states[i] = alone[i].predict(raw[i], states[i], starts[i : i + 1])
                assert np.shape(action) == ()
                if number > 5:
                    assert equal(model.shown, row(shown, i))
            number += 1
        shown, _, starts, _ = venv.step([0, 0])


def frozen(venv: VecEnv) -> None:
    """Freeze the statistics of a vector environment."""
    while isinstance(venv, VecEnvWrapper):
        if isinstance(venv, VecNormalize):
            venv.training = False
        venv = venv.venv


def test_a_state_that_was_given_is_not_changed() -> None:
    venv = VecFrameStack(DummyVecEnv([lambda: Drawn(BOX, 1)]), 2)
    model = Seen(venv)
    policy = as_trained(model)
    first, second = np.ones(3, np.float32), np.full(3, 2, np.float32)
    _, state = policy.predict(first)
    for _ in range(2):
        policy.predict(second, state, np.zeros(1, bool))
        assert model.shown.tolist() == [[1, 1, 1, 2, 2, 2]]
    policy.predict(second)
    assert model.shown.tolist() == [[0, 0, 0, 2, 2, 2]]


def test_a_model_whose_observations_no_wrapper_changes_is_its_own_policy() -> None:
    model = PPO("MlpPolicy", DummyVecEnv([lambda: Drawn(BOX, 1)]), n_steps=8, batch_size=8)
    assert as_trained(model) is model


def test_a_model_without_environment_and_an_unknown_wrapper_are_refused() -> None:
    class Rolled(VecEnvWrapper):  # type: ignore[misc]  # it has no types here
        def reset(self) -> Any:  # noqa: ANN401
            return self.venv.reset()

        def step_wait(self) -> Any:  # noqa: ANN401
            return self.venv.step_wait()

    with pytest.raises(InputError) as caught:
        as_trained(Seen(None))
    assert str(caught.value) == (
        "expected a model with its training environment, which shows how it sees, got one "
        "without; write model.set_env(...)"
    )
    with pytest.raises(InputError) as caught:
        as_trained(Seen(Rolled(DummyVecEnv([lambda: Drawn(BOX, 1)]))))
    assert str(caught.value) == (
        "expected a training environment with vector wrappers of Stable-Baselines3 only, such as "
        "VecNormalize and VecFrameStack, got Rolled; use a Gymnasium wrapper around each "
        "environment instead"
    )
