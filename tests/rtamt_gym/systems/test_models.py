"""A trained model as a policy: its random numbers, its identity, and its transfer to workers."""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Iterator
from io import BytesIO
from types import SimpleNamespace
from typing import Any

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest

from rtamt_gym.systems.policies import WITHOUT_TRAINING, Model


class Torch:
    """Stands for Torch: one global generator, whose state can be read and set."""

    def __init__(self) -> None:
        self.random = random.Random(7)
        self.manual_seed = self.random.seed
        self.get_rng_state = self.random.getstate
        self.set_rng_state = self.random.setstate


class Drawing:
    """Draws an action from the generators of NumPy and Torch, and from its space if it explores."""

    action_space = gym.spaces.Discrete(1000)

    def predict(self, _obs: Any, _state: Any, _begins: Any, deterministic: Any) -> Any:  # noqa: ANN401
        assert deterministic is False
        action: list[float] = [np.random.random(), sys.modules["torch"].random.random()]  # noqa: NPY002
        if hasattr(self, "exploration_rate"):
            action.append(int(self.action_space.sample()))
        return action, None


class Exploring(Drawing):
    exploration_rate = 0.5


@pytest.fixture(autouse=True)
def torch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Torch]:
    """Install Torch; NumPy draws afterwards as before."""
    stand_in, state = Torch(), np.random.get_state()  # noqa: NPY002
    monkeypatch.setitem(sys.modules, "torch", stand_in)
    yield stand_in
    np.random.set_state(state)  # noqa: NPY002


def drawn(policy: Any, count: int = 4) -> list[Any]:  # noqa: ANN401
    return [policy(None) for _ in range(count)]


@pytest.mark.parametrize("kind", [Drawing, Exploring])
def test_an_episode_draws_by_its_seed_whatever_others_draw(kind: type[Drawing]) -> None:
    make = Model(kind(), deterministic=False)
    alone: Any = {seed: drawn(make(seed)) for seed in (1, 2)}
    assert alone[1] != alone[2]
    assert len({str(action) for action in alone[1]}) == 4
    policies: Any = {seed: make(seed) for seed in (1, 2)}
    turns = [(policies[1](None), policies[2](None), np.random.random()) for _ in range(4)]  # noqa: NPY002
    assert [turn[0] for turn in turns] == alone[1]
    assert [turn[1] for turn in turns] == alone[2]
    assert drawn(make(1 + 2**32))[0][0] == alone[1][0][0]  # NumPy has seeds of 32 bits


def test_the_global_generators_are_left_as_they_were(torch: Torch) -> None:
    def key() -> list[int]:
        result: Any = np.random.get_state()  # noqa: NPY002
        return [*map(int, result[1])]

    np.random.seed(3)  # noqa: NPY002
    before = torch.get_rng_state(), key()
    drawn(Model(Drawing(), deterministic=False)(1))
    assert (torch.get_rng_state(), key()) == before


def test_a_model_draws_without_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "torch")
    model = SimpleNamespace(predict=lambda *_, **__: (np.random.random(), None))  # noqa: NPY002
    make = Model(model, deterministic=False)
    assert drawn(make(5)) == drawn(make(5)) != drawn(make(6))


class Weights:
    """Stands for a tensor."""

    def __init__(self, *numbers: float) -> None:
        self.numpy = lambda: np.array(numbers)

    def detach(self) -> Weights:
        return self

    cpu = detach


def test_models_with_other_weights_are_told_apart() -> None:
    def fingerprint(**weights: Weights) -> str:
        network = SimpleNamespace(state_dict=lambda: weights)
        return Model(SimpleNamespace(name="PPO", policy=network)).fingerprint

    result = [
        fingerprint(),
        fingerprint(a=Weights(1, 2)),
        fingerprint(a=Weights(1, 3)),
        fingerprint(b=Weights(1, 2)),
        fingerprint(a=Weights(1), b=Weights(2)),
    ]
    assert result[0] == "PPO"
    assert len({*result}) == len(result)
    assert fingerprint(a=Weights(1, 2)) == result[1]


class Saving:
    """A model that saves its weights, but not its observations."""

    loaded: Any = None

    def __init__(self, gain: int) -> None:
        self.gain = gain
        self.seen = (step for step in range(9))  # a generator cannot be pickled

    def save(self, file: BytesIO) -> None:
        file.write(bytes([self.gain]))

    @classmethod
    def load(cls, file: BytesIO, **options: Any) -> Saving:  # noqa: ANN401
        cls.loaded = options
        return cls(file.read()[0])

    def predict(self, obs: Any, _state: Any, _begins: Any, deterministic: Any) -> Any:  # noqa: ANN401
        return self.gain * obs, deterministic


def test_a_model_goes_to_workers_as_the_file_that_it_saves() -> None:
    model = Model(Saving(3))
    there = pickle.loads(cloudpickle.dumps(model))
    assert Saving.loaded == {"device": "cpu", "custom_objects": WITHOUT_TRAINING}
    assert (there.name, there(0)(2), model(0)(2)) == ("Saving", 6, 6)
    assert pickle.loads(cloudpickle.dumps(there))(0)(2) == 6
