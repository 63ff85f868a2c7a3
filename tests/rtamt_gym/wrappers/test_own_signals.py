"""Variables without a signal read the environment's own signals."""

import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from parallel_environments import Crew
from vector_environments import difference, trajectory

from rtamt import InputError
from rtamt_gym import (
    ParallelStlMonitor,
    StlMonitor,
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
    simulate,
)

OWN = {"position": "obs[0]", "speed": "obs[1]"}
TEXT = "always(position < 2 and speed < 1)"


class Drift(gym.Env[Any, Any]):
    """A random walk that names its observations."""

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    signals = OWN
    control_timestep = 0.5

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - it has none
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.at = self.np_random.normal(size=2)
        return self.at.copy(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at = self.at + 0.1 * self.np_random.normal(size=2) + action[0]
        return self.at.copy(), 0.0, False, False, {}


def make() -> gym.Env[Any, Any]:
    return gym.wrappers.TimeLimit(Drift(), 20)


def many() -> Any:
    envs = gym.vector.SyncVectorEnv([make, make])
    envs.signals = OWN  # type: ignore[attr-defined]  # as a native vector environment has it
    return envs


MAKES: list[Callable[..., Any]] = [
    lambda *signals: StlMonitor(make(), TEXT, *signals),
    lambda *signals: StlReward(make(), TEXT, *signals, mode="add"),
    lambda *signals: VectorStlMonitor(many(), TEXT, *signals),
    lambda *signals: VectorStlReward(many(), TEXT, *signals, mode="add"),
]


@pytest.mark.parametrize("wrap", MAKES)
def test_what_is_not_given_is_read_as_the_environment_says(wrap: Callable[..., Any]) -> None:
    given = trajectory_of(wrap(OWN))
    assert not difference(trajectory_of(wrap()), given)
    assert not difference(trajectory_of(wrap({"speed": "obs[1]"})), given)
    # Explicit signals have precedence.
    assert difference(trajectory_of(wrap({"speed": "obs[0]"})), given)
    assert not difference(trajectory_of(pickle.loads(pickle.dumps(wrap()))), given)


def trajectory_of(env: Any) -> list[Any]:
    if isinstance(env, gym.vector.VectorEnv):
        return list(trajectory(env, 8))
    shown: list[Any] = [env.reset(seed=7)]
    return shown + [env.step(np.array([0.1])) for _ in range(8)]


def test_an_environment_is_made_again_with_its_own_signals() -> None:
    gym.register("Drift-v0", lambda **_: Drift())
    try:
        env = StlMonitor(gym.make("Drift-v0"), TEXT)
        assert env.spec is not None
        again = gym.make(env.spec)
        assert not difference(again.reset(seed=7), env.reset(seed=7))
    finally:
        del gym.registry["Drift-v0"]


def speed(step: Any) -> float:
    return float(step.obs[1])


class Heard(Drift):
    """An environment that names a function."""

    signals: Any = {**OWN, "speed": speed}  # noqa: RUF012 - as an environment has it


def test_json_needs_no_function_that_the_environment_names_itself() -> None:
    gym.register("Drift-v0", f"{__name__}:Heard")
    try:
        env = StlMonitor(gym.make("Drift-v0"), TEXT)
        assert env.spec is not None
        again = gym.make(EnvSpec.from_json(env.spec.to_json()))
        assert not difference(trajectory_of(again), trajectory_of(env))
        given = StlMonitor(gym.make("Drift-v0"), TEXT, {"speed": speed})
        assert given.spec is not None
        with pytest.raises(InputError, match="signal 'speed' is a callable, which JSON cannot"):
            given.spec.to_json()
    finally:
        del gym.registry["Drift-v0"]


def test_simulate_reads_them_and_records_those_that_are_read() -> None:
    run = simulate(make(), TEXT, policy=lambda _: [0.1], seed=7, stop="end")
    assert run == simulate(make(), TEXT, OWN, policy=lambda _: [0.1], seed=7, stop="end")
    assert list(run.signals) == ["position", "speed"]
    one = simulate(make(), "always(speed < 1)", {"twice": "obs[0]"}, policy=lambda _: [0.1], seed=7)
    assert list(one.signals) == ["speed", "twice"]


def test_agents_are_read_as_their_environment_says() -> None:
    def said(env: Crew, *signals: Any) -> object:
        return ParallelStlMonitor(env, "always(x < 2)", *signals, period=1).reset(seed=0)

    crew = {"a": [1.0, 3.0], "b": [0.0, 0.0]}
    own = Crew(crew)
    own.signals = {"x": "a: obs[0]"}  # type: ignore[attr-defined]  # as an environment has it
    assert not difference(said(own), said(Crew(crew), {"x": "a: obs[0]"}))


@pytest.mark.parametrize(
    ("text", "signals", "message"),
    [
        (
            "always(sped < 1)",
            None,
            (
                "variable 'sped' has no signal; the signals are 'position', 'speed'; "
                "did you mean 'speed'?"
            ),
        ),
        (
            "always(height < 1)",
            {"level": "obs[0]"},
            (
                "variable 'height' has no signal; the signals are 'position', 'speed', 'level'; "
                'pass signals={"height": "obs[INDEX]"}'
                ", or declare a constant: const float height = VALUE"
            ),
        ),
        (
            "always(speed < 1)",
            {"sped": "obs[0]"},
            (
                "signal 'sped' is read by no specification; the variables are 'speed'; "
                "did you mean 'speed'?"
            ),
        ),
    ],
)
def test_a_variable_without_signal_names_the_nearest_of_all(
    text: str, signals: dict[str, Any] | None, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        StlMonitor(make(), text, signals)
    assert str(caught.value) == message


def test_an_attribute_that_is_no_mapping_is_none_of_theirs() -> None:
    env = make()
    env.unwrapped.signals = ["position"]  # type: ignore[attr-defined]
    with pytest.raises(InputError) as caught:
        StlMonitor(env, "always(position < 1)")
    assert str(caught.value) == (
        'variable \'position\' has no signal; pass signals={"position": "obs[INDEX]"}'
        ", or declare a constant: const float position = VALUE"
    )
    with pytest.raises(InputError) as caught:
        StlReward(env, "always(position < 1)", mode="add")
    assert str(caught.value) == (
        "expected signals=, or an environment with an StlMonitor, got neither; such as "
        'specs="always(x > 0)", signals={"x": "obs[0]"}'
    )
