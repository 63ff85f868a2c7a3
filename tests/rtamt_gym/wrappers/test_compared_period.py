"""The period of the samples is reported, and compared with the time of the simulation."""

from __future__ import annotations

import copy
import functools
import pickle
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import MaxAndSkipObservation
from parallel_environments import Crew
from road_environments import RoadEnv
from vector_environments import MODES, Make, both, difference, native, sync, trajectory

from rtamt import InputError, SpecificationError, StateError
from rtamt_gym import (
    ParallelStlMonitor,
    StlMonitor,
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
    evaluate_policy,
    simulate,
)
from rtamt_gym.judging.end_warnings import OpenEndWarning
from rtamt_gym.play.runner import Runner
from rtamt_gym.signals.periods import why_no_period

pytestmark = pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning")


TIMED, UNTIMED = "always(eventually[0:3](x < 1))", "always(x < 9)"
X = {"x": "obs[0]"}


class Repeat(gym.Wrapper[Any, Any, Any, Any]):
    """A user's own action repeat, without an attribute for it."""

    def __init__(self, env: gym.Env[Any, Any], times: int = 4) -> None:
        super().__init__(env)
        self.times = times

    def step(self, action: Any) -> Any:
        for _ in range(self.times):
            result = self.env.step(action)
            if result[2] or result[3]:
                break
        return result


def pole() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=30)


def reacher() -> gym.Env[Any, Any]:
    return gym.make("Reacher-v5")


def highway() -> gym.Env[Any, Any]:
    return gym.make("highway_env:parking-v0", disable_env_checker=True)


def repeated(make: Make) -> gym.Env[Any, Any]:
    return Repeat(make())


def actions(env: Any, steps: int = 14) -> None:
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(steps):
        ended = env.step(env.action_space.sample())
        if np.any(ended[2]) or np.any(ended[3]):
            env.reset()


def test_the_period_is_printed_described_and_in_the_info_of_a_reset() -> None:
    env = StlMonitor(pole(), TIMED, X)
    assert str(env) == repr(env) == f"<StlMonitor{env.env}, period 0.02 s>"
    assert str(StlReward(env, mode="add")) == f"<StlReward{env}>"
    for _ in range(2):
        _, info = env.reset(seed=1)
        assert info["stl_period"] == 0.02
        assert type(info["stl_period"]) is np.float64
    *_, info = env.step(0)
    assert "stl_period" not in info
    assert env.describe()["spec"]["period"] == 0.02
    counted = StlMonitor(pole(), TIMED, X, period=1)
    assert str(counted).endswith(", period 1 s>")
    assert counted.reset()[1]["stl_period"] == 1.0

    class Untold(gym.Env[Any, Any]):
        observation_space, action_space = spaces.Box(-1, 1, (1,)), spaces.Discrete(2)

        def reset(self, **_: Any) -> Any:
            return np.zeros(1, np.float32), {}

    untold = StlMonitor(Untold(), UNTIMED, X)
    assert str(untold).endswith(", no period>")
    assert "stl_period" not in untold.reset()[1]
    assert "period" not in untold.describe()["spec"]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_many_environments_tell_it_where_episodes_begin(mode: AutoresetMode) -> None:
    how: dict[str, Any] = {"on_violation": "report"}
    together, singles = both(StlMonitor, VectorStlMonitor, [pole] * 3, mode, TIMED, X, **how)
    shown = trajectory(together, 40)
    assert difference(shown, trajectory(singles, 40)) == ""
    told = [row[-1].get("_stl_period", np.zeros(3, bool)) for row in shown]
    assert told[0].all()
    assert 1 <= sum(bool(item.any()) for item in told[1:]) < 30
    assert str(together) == f"<VectorStlMonitor{together.env}, period 0.02 s>"
    assert together.describe()["spec"]["period"] == 0.02
    assert together.describe()["spec"]["robustness"].shape == (3,)


def test_agents_are_told_it_too() -> None:
    env = ParallelStlMonitor(Crew({"a": [0.0, 1.0]}, tau=0.25), TIMED, {"x": "a: obs[0]"})
    assert env.reset()[1]["a"]["stl_period"] == 0.25
    assert str(env).endswith(", period 0.25 s>")
    assert env.describe()["spec"]["period"] == 0.25


@pytest.mark.parametrize(
    ("make", "period", "time"),
    [
        (pole, 0.02, "the steps that its TimeLimit counts"),
        (reacher, 0.02, "data.time"),
        (highway, 0.2, "its physics steps"),
    ],
    ids=["counted", "mujoco", "highway"],
)
def test_an_action_repeat_of_ones_own_is_noticed(make: Make, period: float, time: str) -> None:
    signals = {"x": "vehicle.speed"} if make is highway else X
    actions(StlMonitor(make(), TIMED, signals, align="outward"))
    env = repeated(make)
    monitor = StlMonitor(env, TIMED, signals, align="outward")
    monitor.reset(seed=1)
    with pytest.raises(StateError) as caught:
        monitor.step(monitor.action_space.sample())
    says = (
        f"expected samples {period:g} s apart, as {env.unwrapped} states, got {4 * period:g} s by "
        f"{time}: bounds last 4 times as long as specified; if an inner wrapper makes several "
        f"steps in one, pass period={4 * period:g}, or put the monitor inside of it"
    )
    assert str(caught.value) == says
    with pytest.raises(StateError, match="call reset"):
        monitor.step(monitor.action_space.sample())
    monitor.reset(seed=1)
    with pytest.raises(StateError, match="bounds last 4 times"):
        monitor.step(monitor.action_space.sample())
    actions(StlMonitor(env, TIMED, signals, period=4 * period, align="outward"), 1)
    actions(Repeat(StlMonitor(make(), TIMED, signals, align="outward")), 2)
    with pytest.raises(StateError) as caught:
        simulate(
            env, TIMED, signals, policy=lambda _: env.action_space.sample(), seed=1, align="outward"
        )
    assert str(caught.value) == says


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("make", [pole, reacher], ids=["counted", "mujoco"])
def test_each_of_many_environments_is_compared(make: Make, mode: AutoresetMode) -> None:
    envs = VectorStlMonitor(sync([make, make], mode), TIMED, X)
    trajectory(envs, 25)
    makes: list[Make] = [make, functools.partial(repeated, make)]
    envs = VectorStlMonitor(sync(makes, mode), TIMED, X)
    envs.reset(seed=1)
    with pytest.raises(StateError, match="bounds last 4 times as long as specified"):
        envs.step(envs.action_space.sample())
    with pytest.raises(StateError, match="bounds last 4 times as long as specified"):
        trajectory(VectorStlReward(sync(makes, mode), TIMED, X, mode="add"), 1)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_short_episode_is_compared_from_its_own_reset_on(mode: AutoresetMode) -> None:
    def lasting(steps: int) -> Make:
        return lambda: gym.make("CartPole-v1", max_episode_steps=steps)

    envs = VectorStlMonitor(sync([lasting(2), lasting(5)], mode), TIMED, X)
    trajectory(envs, 12)
    assert len(envs.stl_episodes) > 3


def test_a_given_period_that_the_time_contradicts_is_told_once() -> None:
    env = StlMonitor(reacher(), TIMED, X, period=0.1)
    env.reset(seed=1)
    with pytest.warns(UserWarning, match=r"as period= states, got 0\.02 s by data\.time"):
        env.step(env.action_space.sample())
    env.step(env.action_space.sample())
    envs = VectorStlMonitor(sync([reacher] * 2, AutoresetMode.NEXT_STEP), TIMED, X, period=0.1)
    envs.reset(seed=1)
    with pytest.warns(UserWarning, match="as period= states") as told:
        envs.step(envs.action_space.sample())
    assert len(told) == 1
    envs.step(envs.action_space.sample())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        actions(StlMonitor(reacher(), TIMED, X, period=1))  # bounds count steps
        actions(StlMonitor(repeated(pole), "eventually[0:0.8](x > 1)", X, period=0.08))


def test_without_bounds_a_wrong_period_is_told_and_nothing_ends() -> None:
    env = StlMonitor(repeated(pole), UNTIMED, X)
    env.reset(seed=1)
    with pytest.warns(UserWarning, match="bounds last 4 times as long as specified"):
        env.step(0)
    env.step(1)


def test_what_is_no_time_is_not_compared() -> None:
    class Still(gym.Env[Any, Any]):
        observation_space, action_space = spaces.Box(-1, 1, (1,)), spaces.Discrete(2)
        dt, time, config = 0.5, 0.0, {"policy_frequency": 2}

        def reset(self, **_: Any) -> Any:
            return np.zeros(1, np.float32), {}

        def step(self, _: Any) -> Any:
            return np.zeros(1, np.float32), 0.0, False, False, {}

    actions(StlMonitor(Still(), TIMED, X))
    actions(VectorStlMonitor(native(2), TIMED, X))


def test_sub_steps_are_compared_with_the_time_of_the_simulation() -> None:
    signals = {"x": "qpos[0]"}
    actions(StlMonitor(reacher(), TIMED, signals, substeps=True))

    class Faster(gym.Wrapper[Any, Any, Any, Any]):
        """Steps the simulation once more, unseen."""

        def step(self, action: Any) -> Any:
            import mujoco  # type: ignore[import-untyped]

            result = self.env.step(action)
            inside: Any = self.env.unwrapped
            mujoco.mj_step(inside.model, inside.data)
            return result

    env = StlMonitor(Faster(reacher()), TIMED, signals, substeps=True)
    env.reset(seed=1)
    with pytest.raises(StateError, match=r"expected samples 0\.01 s apart, .* got 0\.015 s by"):
        env.step(env.action_space.sample())


def test_first_steps_of_each_episode_are_compared() -> None:
    env = StlMonitor(pole(), TIMED, X)
    plain = env._feed
    for compared in (10, 2, 2):
        env.reset(seed=1)
        for step in range(compared):
            assert env._feed is not plain
            env.step(step % 2)
        assert env._feed is plain


def test_copies_go_on() -> None:
    early = StlMonitor(pole(), TIMED, X)
    early.reset(seed=1)
    early.step(0)
    for again in (copy.deepcopy(early), pickle.loads(pickle.dumps(early))):
        assert difference(again.step(1), copy.deepcopy(early).step(1)) == ""
        actions(again, 20)


def test_an_evaluation_fails_on_a_wrong_period() -> None:
    with pytest.raises(Exception, match="bounds last 4 times as long as specified"):
        evaluate_policy("zero", repeated(pole), TIMED, X, episodes=2)


def test_a_repeat_action_of_gymnasium_has_no_period() -> None:
    # Gymnasium 1.3 added RepeatAction.
    repeat: Any = getattr(gym.wrappers, "RepeatAction", MaxAndSkipObservation)
    env = repeat(pole(), 4)
    reason = f"a {repeat.__name__} makes several steps in one"
    assert why_no_period(env) == reason
    with pytest.raises(SpecificationError, match=reason):
        StlMonitor(env, TIMED, X)
    actions(StlMonitor(env, "eventually[0:0.8](x > 1)", X, period=0.08))
    assert issubclass(InputError, Exception)


# ---- a period that changes at a reset ----


def slower(env: Any) -> None:
    """Doubles the time of a step."""
    simulation = env.unwrapped
    if hasattr(simulation, "model"):
        simulation.model.opt.timestep *= 2
    else:
        simulation.tau *= 2


def later_warnings(env: Any, change: Callable[[], object], episodes: int = 2) -> list[str]:
    """Return the warnings of an episode before a change and of some after it."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", OpenEndWarning)
        actions(env, 12)
        assert not told
        change()
        for _ in range(episodes):
            actions(env, 12)
    return [str(item.message) for item in told]


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (reacher, "as period= states, got 0.04 s by data.time: bounds last 2 times as long"),
        (pole, "which lasted 0.02 s, lasts 0.04 s since this reset; make the monitor again with"),
    ],
    ids=["mujoco", "stated"],
)
def test_set_period_is_compared_after_every_reset(make: Make, says: str) -> None:
    wraps: list[Any] = [StlMonitor, functools.partial(StlReward, mode="add")]
    for wrap in wraps:
        env = wrap(make(), TIMED, X, period=0.02)
        told = later_warnings(env, functools.partial(slower, env), episodes=3)
        assert len(told) == 1
        assert says in told[0]
    for mode in MODES:
        envs: Any = VectorStlMonitor(sync([make] * 2, mode), TIMED, X, period=0.02)
        second = envs.env.unwrapped.envs[1]
        told = later_warnings(envs, lambda: slower(second))  # noqa: B023 - called here
        assert len(told) == 1
        assert says in told[0]


def test_each_change_of_a_set_period_warns() -> None:
    env = StlMonitor(reacher(), TIMED, X, period=0.02)
    assert len(later_warnings(env, lambda: slower(env))) == 1
    slower(env)
    with pytest.warns(UserWarning, match=r"got 0\.08 s by data\.time"):
        actions(env, 1)
    simulation: Any = env.unwrapped
    simulation.model.opt.timestep, simulation.frame_skip = 0.01, 3
    with pytest.warns(UserWarning, match=r"got 0\.03 s by data\.time"):
        actions(env, 1)


def test_counted_steps_are_never_compared() -> None:
    for make in (reacher, pole):
        env = StlMonitor(make(), TIMED, X, period=1)
        assert later_warnings(env, lambda: slower(env)) == []  # noqa: B023 - called here


def test_configuration_of_a_reset_changes_the_period() -> None:
    signals = {"x": "obs[0]"}
    faster = {"config": {"policy_frequency": 5}}
    env = StlMonitor(RoadEnv(3), "always[0:2](x < 999)", signals, period=1 / 3)
    env.reset()
    env.step(0)
    env.reset(options=faster)
    with pytest.warns(UserWarning, match=r"got 0\.2 s by its physics steps"):
        env.step(0)
    env = StlMonitor(RoadEnv(3), "always[0:2](x < 999)", signals)
    env.reset()
    with pytest.raises(StateError, match=r"had at construction, got 0\.2 s"):
        env.reset(options=faster)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_repeat_of_a_later_episode_is_noticed(mode: AutoresetMode) -> None:
    env = Repeat(reacher(), times=1)
    monitor = StlMonitor(env, TIMED, X)
    actions(monitor, 12)
    env.times = 3
    with pytest.raises(StateError, match="bounds last 3 times"):
        actions(monitor, 1)
    entries = [Repeat(pole(), times=1) for _ in range(2)]
    makes: list[Make] = [lambda: entries[0], lambda: entries[1]]
    envs: Any = VectorStlMonitor(sync(makes, mode), TIMED, X)
    trajectory(envs, 40)
    entries[1].times = 3
    with pytest.raises(StateError, match="bounds last 3 times"):
        trajectory(envs, 40)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_one_of_many_environments_changes_its_period(mode: AutoresetMode) -> None:
    envs: Any = VectorStlMonitor(sync([pole] * 3, mode), TIMED, X)
    trajectory(envs, 12)
    slower(envs.env.unwrapped.envs[2])
    with pytest.raises(StateError, match=r"had at construction, got 0\.04 s"):
        trajectory(envs, 60)


def test_native_environments_change_their_period() -> None:
    def go_on(envs: Any) -> None:
        for _ in range(60):  # it resets each of them
            envs.step(envs.action_space.sample())

    bare: Any = native(3)
    envs = VectorStlMonitor(bare, TIMED, X, period=0.02)
    envs.reset(seed=1)
    bare.tau = 0.04
    with pytest.warns(UserWarning, match=r"lasts 0\.04 s since this reset") as told:
        go_on(envs)
    assert len([item for item in told if "since this reset" in str(item.message)]) == 1
    bare.tau = 0.02
    read = VectorStlMonitor(bare, TIMED, X)
    read.reset(seed=1)
    bare.tau = 0.04
    with pytest.raises(StateError, match=r"had at construction, got 0\.04 s"):
        go_on(read)


def test_agents_change_their_period() -> None:
    def wrapped(**how: Any) -> Any:
        crew = Crew({"a": [0.0, 1.0, 2.0]}, tau=0.5)
        return ParallelStlMonitor(crew, "always[0:1](x < 9)", {"x": "a: obs[0]"}, **how)

    read, given = wrapped(), wrapped(period=0.5)
    for env in (read, given):
        env.reset()
        env.unwrapped.control_timestep = 0.25
    with pytest.raises(StateError, match=r"had at construction, got 0\.25 s"):
        read.reset()
    with pytest.warns(UserWarning, match=r"which lasted 0\.5 s, lasts 0\.25 s since this reset"):
        given.reset()


@pytest.mark.parametrize(("period", "raises"), [(None, True), (0.02, True), (0.04, False)])
def test_simulations_change_their_period(period: float | None, raises: bool) -> None:  # noqa: FBT001 - of a table
    env = pole()
    runner = Runner(env, TIMED, signals=X, policy=lambda _: 0, period=period)
    assert [trial.error for _, trial in runner.run([{}] * 2, [1, 2])] == ["", ""]
    slower(env)
    slower(env)
    if raises:
        ((_, trial),) = runner.run([{}], [3])
        assert "had at construction, got 0.08 s" in trial.error
    else:
        with pytest.warns(UserWarning, match=r"which lasted 0\.02 s, lasts 0\.08 s since"):
            assert [trial.error for _, trial in runner.run([{}] * 2, [3, 4])] == ["", ""]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_evaluations_of_many_environments_compare_the_period(mode: AutoresetMode) -> None:
    makes: list[Make] = [pole, functools.partial(repeated, pole)]

    def play(makes: list[Make], **how: Any) -> Any:
        return evaluate_policy(lambda _: 0, sync(makes, mode), TIMED, X, episodes=4, **how)

    with pytest.raises(Exception, match="bounds last 4 times as long as specified"):
        play(makes)
    assert play([pole] * 2).episodes == 4
    with pytest.warns(UserWarning, match=r"as period= states, got 0\.02 s by data\.time"):
        evaluate_policy(
            lambda _: np.zeros(2), sync([reacher], mode), TIMED, X, episodes=2, period=0.1
        )
