"""The period of a simulation is found; without one, the error lists the places of the search."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import MaxAndSkipObservation, TransformReward
from road_environments import SPEED, RoadEnv
from vector_environments import ANGLE, TEXT, make_pole

from rtamt import InputError, SpecificationError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, evaluate_policy, simulate
from rtamt_gym.signals.periods import ask_another, find_period, read_period, why_no_period

BOUNDED = "always[0:1](x < 1)"
X = {"x": "obs[0]"}


class Bare(gym.Env[Any, Any]):
    """An environment without a period."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space: spaces.Space[Any] = spaces.Box(-1.0, 1.0, (2,))

    def reset(self, **_: Any) -> Any:
        return np.zeros(1), {}

    def __str__(self) -> str:
        return "<Bare>"


class Maze(Bare):
    """An environment that holds another one, like the mazes of gymnasium-robotics."""

    def __init__(self, **inside: gym.Env[Any, Any]) -> None:
        vars(self).update(inside)
        self.itself = self


class Point(Bare):
    """The environment inside a maze."""

    dt = 0.125


class Other(Point):
    """An environment with other actions: its holder may step it several times."""

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
        ("highway_env:lane-keeping-v0", 0.1),
        ("MountainCar-v0", None),
    ],
)
def test_period_is_not_the_frame_rate(env_id: str, period: float | None) -> None:
    env = gym.make(env_id)
    assert read_period(env) == pytest.approx(period)
    env.close()


@pytest.mark.parametrize("value", [0.0, -0.1, math.nan, math.inf, True, "0.1", None])
def test_invalid_dt_is_ignored(value: object) -> None:
    env: Any = Bare()
    env.dt = value
    assert read_period(env) is None
    env.tau = 0.5
    assert read_period(env) == 0.5


def test_period_of_inner_environment() -> None:
    assert find_period(Maze(point=Point())) == (0.125, "point.dt")
    pole = gym.make("CartPole-v1")
    held = Maze(game=pole)
    held.action_space = pole.action_space
    assert find_period(held) == (0.02, "game.unwrapped.tau")
    with pytest.warns(UserWarning, match=r"taken to last 0\.125 s, its point\.dt, which nothing"):
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
def test_inner_period_is_not_guessed(inside: Any) -> None:
    message = (
        "specification 'spec' has bounds in time, but <Bare> does not state the duration of a "
        "step: there is no dt, tau or config['policy_frequency'] in it, or in an environment "
        "inside it; give period= in seconds, or period=1 if every bound counts steps"
    )
    with pytest.raises(SpecificationError) as caught:
        StlMonitor(Maze(**inside), BOUNDED, X)
    assert str(caught.value) == message
    with pytest.raises(SpecificationError) as caught:
        simulate(Maze(**inside), BOUNDED, X, policy=lambda _: np.zeros(2))
    assert str(caught.value) == message.replace("<Bare>", "Maze")


class Made:
    """Counts the environments that are created and closed in this process."""

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

    def __reduce__(self) -> Any:
        return type(self), (self.make,)


def test_async_period_from_another_environment() -> None:
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


def test_async_without_period_error() -> None:
    made = Made(Bare)
    envs = AsyncVectorEnv([made], context="forkserver")
    with pytest.raises(SpecificationError) as caught:
        VectorStlMonitor(envs, BOUNDED, X)
    assert str(caught.value) == (
        "specification 'spec' has bounds in time, but AsyncVectorEnv(num_envs=1) does not state "
        "the duration of a step: there is no dt, tau or config['policy_frequency'] in its "
        "environments, or in an environment inside these; give period= in seconds, or period=1 if "
        "every bound counts steps"
    )
    assert (len(made.made), made.closed) == (2, 2)
    _, infos = VectorStlMonitor(envs, BOUNDED, X, period=1).reset()
    assert infos["robustness"].tolist() == [1.0]
    envs.close()


def test_async_cannot_make_another_error() -> None:
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


def test_only_async_makes_another() -> None:
    made = Made(make_pole)
    assert ask_another(made()) is None
    assert ask_another(SyncVectorEnv([made])) is None
    assert len(made.made) == 2


# ---- highway-env: a step is a whole number of physics steps ----

PAIRS = {  # physics steps of an action, by policy_frequency and simulation_frequency
    (1, 15): 15,
    (5, 15): 3,
    (2, 15): 7,
    (4, 15): 3,
    (10, 15): 1,
    (15, 15): 1,
    (0.4, 15): 37,
    (7, 20.0): 2,
}


@pytest.mark.parametrize(("policy", "simulation"), PAIRS)
def test_highway_period_is_distance_over_speed(policy: float, simulation: float) -> None:
    env = RoadEnv(policy, simulation)
    frames = PAIRS[policy, simulation]
    monitor = StlMonitor(env, "always[0:60](d < 1e9)", {"d": "obs[0]"}, align="outward")
    assert float(monitor.period or 0) == pytest.approx(frames / simulation)
    monitor.reset()
    for step in range(1, 2 if policy < 1 else 4):
        obs, *_ = monitor.step(0)
        assert obs[0] == pytest.approx(SPEED * step * float(monitor.period or 0))


def test_real_highway_period_is_distance_over_speed() -> None:
    action = {"type": "ContinuousAction"}
    config = {"policy_frequency": 4, "vehicles_count": 1, "action": action}
    env: Any = gym.make("highway_env:highway-v0", config=config, disable_env_checker=True)
    env.reset(seed=0)
    begin = env.unwrapped.vehicle.position[0]
    for _ in range(2):
        env.step(np.zeros(2, np.float32))
    moved = env.unwrapped.vehicle.position[0] - begin
    assert moved / env.unwrapped.vehicle.speed == pytest.approx(2 * (read_period(env) or 0))
    env.close()


def test_highway_verdicts_count_the_time_of_the_physics() -> None:
    # 75 m in 3 s: "within 3 s, more than 70 m" holds, and "more than 80 m" does not.
    signals = {"d": "obs[0]"}
    for far, verdict in ((70, "SATISFIED"), (80, "VIOLATED")):
        text = f"eventually[0:3](d > {far})"
        for policy in (1, 5, 10, 15):  # 2 and 4 Hz make steps that do not divide 3 s
            env = StlMonitor(RoadEnv(policy), text, signals, on_violation="report")
            env.reset()
            ended = False
            while not ended:
                *_, ended, info = env.step(0)
            assert info["stl_episode"]["spec"]["verdict"] == verdict
        run = simulate(RoadEnv(10), text, signals, policy=lambda _: 0)
        assert run.outcomes["spec"].verdict.name == verdict
    found = evaluate_policy("zero", RoadEnv(10), "eventually[0:3](d > 70)", signals, episodes=1)
    assert found.record[0].outcomes["spec"].verdict.name == "SATISFIED"


@pytest.mark.parametrize("wrap", [StlMonitor, StlReward])
@pytest.mark.parametrize("period", [None, 1, 0.1])
def test_highway_action_without_physics_error(wrap: Any, period: float | None) -> None:
    how = {"mode": "add"} if wrap is StlReward else {}
    for text in ("always[0:1](d < 9)", "always(d < 9)"):
        with pytest.raises(InputError) as caught:
            wrap(RoadEnv(20), text, {"d": "obs[0]"}, period=period, **how)
        assert str(caught.value) == (
            "config['policy_frequency'] is 20 Hz and config['simulation_frequency'] is 15 Hz, so "
            "an action makes no physics step and nothing moves. Set simulation_frequency to 20 or "
            "more"
        )


def test_highway_action_without_physics_error_elsewhere() -> None:
    text, signals = "always[0:1](d < 9)", {"d": "obs[0]"}
    many = SyncVectorEnv([lambda: RoadEnv(20)] * 2)
    message = "an action makes no physics step"
    with pytest.raises(InputError, match=message):
        VectorStlMonitor(many, text, signals)
    with pytest.raises(InputError, match=message):
        VectorStlMonitor(many, text, signals, period=0.1)
    with pytest.raises(InputError, match=message):
        simulate(RoadEnv(20), text, signals, policy=lambda _: 0, period=0.1)
    env = StlMonitor(RoadEnv(5), text, signals)
    with pytest.raises(InputError, match=message):
        env.reset(options={"config": {"policy_frequency": 16}})


# ---- control rates ----


def stating(**times: Any) -> Any:
    env = Bare()
    vars(env).update(times)
    return env


@pytest.mark.parametrize(
    ("times", "period", "name"),
    [
        ({"control_hz": 10, "dt": 0.01}, 0.1, "control_hz"),
        ({"control_freq": 20, "dt": 0.002}, 0.05, "control_freq"),
        ({"control_frequency": 50.0, "dt": 0.01}, 0.02, "control_frequency"),
        ({"control_timestep": 0.04, "dt": 0.02}, 0.04, "control_timestep"),
        ({"control_timestep": lambda: 0.04, "dt": 0.02}, 0.04, "control_timestep"),
        ({"control_dt": 0.04, "tau": 0.02}, 0.04, "control_dt"),
        ({"ctrl_dt": np.float32(0.02), "sim_dt": np.float32(0.004)}, 0.02, "ctrl_dt"),
        ({"step_dt": 0.02, "physics_dt": 0.005}, 0.02, "step_dt"),
        ({"CTRL_FREQ": 30, "sim_freq": 240}, 1 / 30, "CTRL_FREQ"),
        ({"config": {"control_hz": 10}, "dt": 0.01}, 0.1, "config['control_hz']"),
        ({"control_hz": 10, "control_timestep": 0.1, "dt": 0.1}, 0.1, "control_timestep"),
        ({"control_hz": None, "dt": 0.01}, 0.01, "dt"),
        ({"config": {"policy_frequency": 4}}, 0.25, "config['policy_frequency']"),
    ],
    ids=lambda value: re.sub(r" at 0x\w+", "", str(value)),
)
def test_control_rate_precedes_physics_step(times: Any, period: float, name: str) -> None:
    found: Any = find_period(stating(**times))
    assert found == (pytest.approx(period), name)


@pytest.mark.parametrize(
    ("times", "reason"),
    [
        (
            {"control_hz": 30, "dt": 0.01},
            "control_hz (0.0333333 s) is not a multiple of dt (0.01 s)",
        ),
        ({"control_freq": 100, "dt": 0.1}, "control_freq (0.01 s) is not a multiple of dt (0.1 s)"),
        (
            {"control_freq": 30, "sim_freq": 100},
            "control_freq (0.0333333 s) is not a multiple of sim_freq (0.01 s)",
        ),
        (
            {"control_hz": 10, "control_timestep": 0.05},
            "control_timestep (0.05 s) and control_hz (0.1 s) are different times of a step",
        ),
        ({"dt": 0.1, "tau": 0.02}, "dt (0.1 s) and tau (0.02 s) are different times of a step"),
    ],
    ids=str,
)
def test_contradicting_times_error(times: Any, reason: str) -> None:
    env = stating(**times)
    assert read_period(env) is None
    assert why_no_period(env).startswith(reason)
    assert why_no_period(stating(point=env)).startswith(f"in point, {reason}")
    for system in (env, SyncVectorEnv([lambda: stating(**times)])):
        wrap: Any = StlMonitor if system is env else VectorStlMonitor
        with pytest.raises(SpecificationError) as caught:
            wrap(system, BOUNDED, X)
        assert reason in str(caught.value)
        assert "give period= in seconds" in str(caught.value)
        wrap(system, "always(x < 1)", X)
        wrap(system, BOUNDED, X, period=0.1)


def test_unverified_dt_warns() -> None:
    says = (
        "a step of Counted is taken to last 0.125 s, its dt, which nothing verifies: in some "
        "simulators dt is the time of a physics step, and an action takes several. Set "
        "period= (--period) to the seconds between two actions"
    )

    class Counted(Point):
        def step(self, _: Any) -> Any:
            return np.zeros(1), 0.0, False, True, {}

    def run() -> object:
        return simulate(Counted(), BOUNDED, X, policy=lambda _: np.zeros(2))

    def judge() -> object:
        return evaluate_policy("zero", Counted(), BOUNDED, X, episodes=1)

    def judge_many() -> object:
        many: Any = SyncVectorEnv([Counted] * 2, autoreset_mode=AutoresetMode.DISABLED)
        return evaluate_policy(lambda _: np.zeros(2), many, BOUNDED, X, episodes=2)

    with pytest.warns(UserWarning, match="nothing verifies") as told:
        StlMonitor(Counted(), BOUNDED, X)
    assert [str(each.message) for each in told] == [says]
    assert told[0].filename == __file__
    for call in (
        lambda: StlMonitor(stating(tau=0.5), BOUNDED, X),
        lambda: StlReward(Point(), BOUNDED, X, mode="add"),
        lambda: VectorStlMonitor(SyncVectorEnv([Point] * 3), BOUNDED, X),
        run,
        judge,
        judge_many,
    ):
        with pytest.warns(UserWarning, match="which nothing verifies") as told:
            call()
        assert len(told) == 1


def test_verified_periods_do_not_warn() -> None:
    # Warnings are errors in this suite.
    StlMonitor(Point(), "always(x < 1)", X)
    StlMonitor(Point(), BOUNDED, X, period=0.125)
    StlMonitor(stating(control_timestep=0.5), BOUNDED, X)
    StlMonitor(RoadEnv(5), BOUNDED, X, align="outward")
    for env_id in ("CartPole-v1", "Pendulum-v1", "InvertedPendulum-v5"):
        StlMonitor(gym.make(env_id), BOUNDED, X)
    held: Any = Maze(game=gym.make("InvertedPendulum-v5"))
    held.action_space = held.game.action_space
    StlMonitor(held, BOUNDED, X)
