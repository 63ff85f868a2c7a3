"""The period is what a simulation says; where none does, the error says where it was sought."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from gymnasium.wrappers import MaxAndSkipObservation, TransformReward
from vector_environments import ANGLE, TEXT, make_pole

from rtamt import SpecificationError
from rtamt_gym import StlMonitor, VectorStlMonitor, simulate
from rtamt_gym.judging.specs import ask_another, find_period, read_period

BOUNDED = "always[0:1](x < 1)"
X = {"x": "obs[0]"}


class Bare(gym.Env[Any, Any]):
    """Says no period."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space: spaces.Space[Any] = spaces.Box(-1.0, 1.0, (2,))

    def reset(self, **_: Any) -> Any:  # noqa: ANN401
        return np.zeros(1), {}

    def __str__(self) -> str:
        return "<Bare>"


class Maze(Bare):
    """Holds the environment that it steps, as the mazes of gymnasium-robotics do."""

    def __init__(self, **inside: gym.Env[Any, Any]) -> None:
        vars(self).update(inside)
        self.itself = self


class Point(Bare):
    """What a maze holds."""

    dt = 0.125


class Other(Point):
    """Takes other actions: what holds it may step it several times."""

    action_space = spaces.Discrete(2)


@pytest.mark.parametrize(
    ("env_id", "period"),
    [
        ("CartPole-v1", 0.02),
        ("Pendulum-v1", 0.05),
        ("Acrobot-v1", 0.2),
        ("HalfCheetah-v5", 0.05),
        ("InvertedPendulum-v5", 0.04),
        ("highway_env:highway-fast-v0", 1.0),
        ("highway_env:parking-v0", 0.2),
        ("MountainCar-v0", None),
    ],
)
def test_the_period_is_what_the_simulation_says_not_the_frame_rate(
    env_id: str, period: float | None
) -> None:
    env = gym.make(env_id)
    assert read_period(env) == pytest.approx(period)
    env.close()


@pytest.mark.parametrize("value", [0.0, -0.1, math.nan, math.inf, True, "0.1", None])
def test_a_dt_that_is_no_time_is_no_period(value: object) -> None:
    env: Any = Bare()
    env.dt = value
    assert read_period(env) is None
    env.tau = 0.5
    assert read_period(env) == 0.5


def test_an_environment_that_holds_one_has_its_period() -> None:
    assert find_period(Maze(point=Point())) == (0.125, "point.dt")
    pole = gym.make("CartPole-v1")
    held = Maze(game=pole)
    held.action_space = pole.action_space
    assert find_period(held) == (0.02, "game.unwrapped.tau")
    monitor = StlMonitor(TransformReward(Maze(point=Point()), float), BOUNDED, X)
    assert float(monitor.period or 0) == 0.125
    own: Any = Maze(point=Point())
    own.tau = 0.5
    assert read_period(own) == 0.5


@pytest.mark.parametrize(
    "inside",
    [
        {},
        {"point": Bare()},
        {"left": Point(), "right": Point()},
        {"point": Other()},
        {"maze": Maze(point=Point())},
        {"point": MaxAndSkipObservation(Point())},
    ],
    ids=["nothing", "without", "two", "other actions", "deeper", "skips"],
)
def test_the_period_of_what_an_environment_holds_is_not_guessed(inside: Any) -> None:  # noqa: ANN401
    message = (
        "specification 'spec' has bounds in time, but <Bare> does not say how long a step lasts: "
        "there is no dt, tau or config['policy_frequency'] in it, or in an environment inside it; "
        "give period= in seconds, or period=1 to count steps"
    )
    with pytest.raises(SpecificationError) as caught:
        StlMonitor(Maze(**inside), BOUNDED, X)
    assert str(caught.value) == message
    with pytest.raises(SpecificationError) as caught:
        simulate(Maze(**inside), BOUNDED, X, policy=lambda _: np.zeros(2))
    assert str(caught.value) == message.replace("<Bare>", "Maze")


class Made:
    """Counts the environments that are made and closed in this process."""

    def __init__(self, make: Callable[[], gym.Env[Any, Any]]) -> None:
        self.make = make
        self.made: list[gym.Env[Any, Any]] = []
        self.closed = 0

    def __call__(self) -> gym.Env[Any, Any]:
        made = self

        class Closing(gym.Wrapper[Any, Any, Any, Any]):
            def close(self) -> None:
                made.closed += 1
                super().close()

        self.made.append(Closing(self.make()))
        return self.made[-1]

    def __reduce__(self) -> Any:  # noqa: ANN401
        return type(self), (self.make,)


def test_an_asynchronous_environment_makes_another_where_a_period_is_needed() -> None:
    made = Made(make_pole)
    envs = AsyncVectorEnv([made, make_pole], context="forkserver")
    assert (len(made.made), made.closed) == (1, 1)  # as AsyncVectorEnv itself does
    assert VectorStlMonitor(envs, "always(theta < 1)", ANGLE).period is None
    assert VectorStlMonitor(envs, TEXT, ANGLE, period=0.1).period is not None
    assert (len(made.made), made.closed) == (1, 1)
    monitor = VectorStlMonitor(envs, TEXT, ANGLE)
    assert float(monitor.period or 0) == 0.02
    assert (len(made.made), made.closed) == (2, 2)
    for _ in range(2):
        _, infos = monitor.reset()
    assert infos["robustness"].shape == (2,)
    assert (len(made.made), made.closed) == (2, 2)
    monitor.close()


def test_an_asynchronous_environment_without_a_period_says_so_and_lives_on() -> None:
    made = Made(Bare)
    envs = AsyncVectorEnv([made], context="forkserver")
    with pytest.raises(SpecificationError) as caught:
        VectorStlMonitor(envs, BOUNDED, X)
    assert str(caught.value) == (
        "specification 'spec' has bounds in time, but AsyncVectorEnv(num_envs=1) does not say how "
        "long a step lasts: there is no dt, tau or config['policy_frequency'] in its environments, "
        "or in an environment inside these; give period= in seconds, or period=1 to count steps"
    )
    assert (len(made.made), made.closed) == (2, 2)
    _, infos = VectorStlMonitor(envs, BOUNDED, X, period=1).reset()
    assert infos["robustness"].tolist() == [1.0]
    envs.close()


def test_an_environment_that_cannot_be_made_twice_names_the_way_out() -> None:
    made = Made(Bare)
    envs = AsyncVectorEnv([made], context="forkserver")
    failure = OSError("the port is taken")

    def refuse() -> gym.Env[Any, Any]:
        raise failure

    made.make = refuse
    with pytest.raises(OSError, match="the port is taken") as caught:
        VectorStlMonitor(envs, BOUNDED, X)
    assert caught.value is failure
    assert failure.__notes__ == [
        "when another environment of AsyncVectorEnv(num_envs=1) was made, to read its period;",
        "give period=, which needs none",
    ]
    envs.close()


def test_only_an_asynchronous_environment_makes_another() -> None:
    made = Made(make_pole)
    assert ask_another(made()) is None
    assert ask_another(SyncVectorEnv([made])) is None
    assert len(made.made) == 2
