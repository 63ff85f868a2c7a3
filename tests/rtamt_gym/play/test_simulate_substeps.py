"""`simulate(substeps=True)`: every step of an environment's simulation is a sample of the run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import pytest
from environments import equal

from rtamt import InputError
from rtamt_gym import StlMonitor, simulate

CASES = [  # simulation steps per environment step, and their duration
    ("Hopper-v5", 4, 0.002, "body:torso.xpos[2]"),
    ("InvertedPendulum-v5", 2, 0.02, "qpos[1]"),
    ("highway_env:parking-v0", 3, 1 / 15, "vehicle.position[1]"),
]
cases = pytest.mark.parametrize(("env_id", "frames", "period", "read"), CASES)

SPEC = "always(abs(x) < 1e6) and eventually(x > 0.1)"


def random_actions(env: gym.Env[Any, Any], seed: int) -> Callable[[object], Any]:
    space = env.action_space  # highway-env makes a new one at every reset
    space.seed(seed)
    return lambda _obs: space.sample()


@pytest.mark.slow(keep=1)
@cases
def test_a_run_has_the_samples_of_the_wrapper(
    env_id: str, frames: int, period: float, read: str
) -> None:
    env = gym.make(env_id)
    ran = simulate(
        env,
        SPEC,
        {"x": read, "u": ("action[0]", 0.0)},
        policy=random_actions(env, 5),
        seed=3,
        duration=30.5 * frames * period,  # ends inside a step
        stop="end",
        substeps=True,
    )
    assert float(ran.period or 0) == pytest.approx(period)
    wrapped = StlMonitor(gym.make(env_id), SPEC, {"x": read}, substeps=True, on_violation="report")
    _, info = wrapped.reset(seed=3)
    act = random_actions(wrapped, 5)
    (course,) = ran.histories.values()
    assert (course.robustness[0], course.upper[0]) == (info["robustness"], info["stl_upper"])
    for step in range(1, ran.steps // frames + 1):
        action = act(None)
        assert (ran.signals["u"][1 + (step - 1) * frames : 1 + step * frames] == action[0]).all()
        _, _, terminated, _, info = wrapped.step(action)
        samples = step * frames
        assert (wrapped.samples, course.robustness[samples]) == (samples + 1, info["robustness"])
        assert (course.lower[samples], course.upper[samples]) == (
            info["stl_lower"],
            info["stl_upper"],
        )
    if terminated:
        assert (ran.ended, ran.steps % frames) == ("terminated", 0)
    else:
        assert (ran.ended, ran.steps) == ("duration", 30 * frames + frames // 2)


@cases
def test_a_time_limit_counts_the_steps_of_the_simulation(
    env_id: str, frames: int, period: float, read: str
) -> None:
    env = gym.make(env_id, max_episode_steps=2)
    ran = simulate(
        env, "always(x > -1e6)", {"x": read}, policy=random_actions(env, 0), seed=0, substeps=True
    )
    assert (ran.ended, ran.steps, ran.limit) == ("truncated", 2 * frames, 2 * frames)
    assert ran.duration == pytest.approx(2 * frames * period)


class Twice(gym.Wrapper[Any, Any, Any, Any]):
    """An environment that makes two steps in one."""

    def step(self, action: Any) -> Any:  # noqa: ANN401
        self.env.step(action)
        return self.env.step(action)


@pytest.mark.slow(keep=1)
@cases
def test_a_monitor_in_the_environment_follows_beside_the_run(
    env_id: str, frames: int, period: float, read: str
) -> None:
    def monitored() -> Any:  # noqa: ANN401
        bare = gym.make(env_id, disable_env_checker=True)
        return StlMonitor(bare, SPEC, {"x": read}, substeps=True, details=True)

    def gentle(env: Any) -> Callable[[object], Any]:  # noqa: ANN401
        """Return actions under which no episode ends."""
        act = random_actions(env, 5)
        return lambda obs: 0.01 * act(obs)

    inside, alone = monitored(), monitored()
    ran = simulate(
        Twice(inside),
        SPEC,
        {"x": read},
        policy=gentle(inside),
        seed=3,
        duration=4 * frames * period,
        stop="end",
        substeps=True,
    )
    assert ran.steps == 4 * frames
    alone.reset(seed=3)
    act = gentle(alone)
    for _ in range(2):
        Twice(alone).step(act(None))
    (course,) = ran.histories.values()
    assert inside.samples == alone.samples == 4 * frames + 1
    assert inside.describe() == alone.describe()
    assert course.robustness[-1] == alone.describe()["spec"]["robustness"]
    following = act(None)  # after the run it continues by itself
    assert equal(inside.step(following), alone.step(following))


def test_a_violation_between_two_observations_stops_the_run_at_its_sample() -> None:
    def run(*, substeps: bool) -> Any:  # noqa: ANN401
        env = gym.make("InvertedPendulum-v5")
        return simulate(
            env,
            "always(speed < 1)",
            {"speed": "qvel[0]"},
            policy=lambda _obs: [3.0],
            seed=0,
            substeps=substeps,
        )

    inside, outside = run(substeps=True), run(substeps=False)
    assert inside.violated_at == inside.steps == 3
    assert (outside.violated_at, outside.steps) == (2, 2)
    assert inside.signals["speed"][2] == outside.signals["speed"][1]


def test_what_only_a_whole_step_gives_is_refused() -> None:
    env = gym.make("InvertedPendulum-v5")
    with pytest.raises(InputError, match=r"^signal 'x': obs\[0\] is unknown during a step"):
        simulate(env, "always(x < 1)", {"x": "obs[0]"}, policy=lambda _: [0.0], substeps=True)


def test_a_system_that_is_no_environment_has_no_steps_inside_of_its_own() -> None:
    with pytest.raises(InputError) as refused:
        simulate([{"x": 1.0}], "always(x < 2)", substeps=True)
    assert str(refused.value) == (
        "substeps=True is for environments with several physics steps per step, got [{'x': 1.0}]; "
        "give a smaller period= if the system takes a period"
    )
