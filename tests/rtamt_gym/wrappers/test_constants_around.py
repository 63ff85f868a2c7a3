"""Constants set on a wrapper around a monitor, where they have no effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorWrapper
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit
from parallel_environments import Crew
from replay import Replay, X
from vector_environments import sync

from rtamt import InputError
from rtamt_gym import ParallelStlMonitor, StlMonitor, StlReward, VectorStlMonitor
from rtamt_gym.wrappers.parallel import ParallelWrapper

SPEC = "always(x > limit)"
OPTIONS: dict[str, Any] = {"constants": {"limit": 1.0}, "on_violation": "report"}
SERIES = [3.0, 3.0, 3.0, 3.0]


class Monitor(gym.Wrapper[Any, Any, Any, Any]):
    """Stands for the wrapper of Stable-Baselines3, which `make_vec_env` puts around others."""


def monitored() -> StlMonitor[Any, Any]:
    return StlMonitor(Replay(SERIES), SPEC, X, **OPTIONS)


def rewarded() -> StlReward[Any, Any]:
    return StlReward(Replay(SERIES), SPEC, X, mode="add", **OPTIONS)


class Crowd(ParallelWrapper):
    """A wrapper around an environment of several agents."""

    def __init__(self, env: Any) -> None:
        self.env = env

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return self.env.reset(seed, options)


def crowd() -> Any:
    return Crowd(ParallelStlMonitor(Crew({"one": SERIES}), SPEC, {"x": "one: obs[0]"}, **OPTIONS))


def around_all() -> Any:
    envs = sync([lambda: Replay(SERIES)] * 2, AutoresetMode.NEXT_STEP)
    return VectorWrapper(VectorStlMonitor(envs, SPEC, X, **OPTIONS))


AROUND: list[Callable[[], Any]] = [
    lambda: Monitor(monitored()),
    lambda: Monitor(rewarded()),
    lambda: TimeLimit(RecordEpisodeStatistics(Monitor(monitored())), 2),
    crowd,
    around_all,
]


@pytest.mark.parametrize("make", AROUND)
def test_constants_of_a_wrapper_around_are_an_error_at_the_next_reset(
    make: Callable[[], Any],
) -> None:
    env = make()
    env.constants = {"limit": 0.5}
    with pytest.raises(InputError) as error:
        env.reset(seed=1)
    inside = "ParallelStlMonitor" if make is crowd else "StlMonitor"
    inside = "VectorStlMonitor" if make is around_all else inside
    assert str(error.value) == (
        f"{type(env).__name__} around {inside} has an attribute constants={{'limit': 0.5}}, which "
        'changes no specification. Delete it and call env.set_wrapper_attr("constants", {...}); '
        'with Stable-Baselines3 write vec_env.env_method("set_wrapper_attr", "constants", {...}) '
        'in place of vec_env.set_attr("constants", {...})'
    )
    del env.constants
    env.reset(seed=1)


@pytest.mark.parametrize("make", AROUND[:3])
def test_the_call_that_the_error_names_changes_the_constants(make: Callable[[], Any]) -> None:
    env = make()
    env.set_wrapper_attr("constants", {"limit": 0.5})
    assert env.reset()[1]["robustness"] == 2.5
    assert env.get_wrapper_attr("constants") == {"limit": 0.5}


@pytest.mark.parametrize("value", [{"limti": 0.5}, {"limit": "half"}, {"limit": 0.5, "g": 9.81}])
def test_misspelt_names_and_wrong_values_are_errors_too(value: dict[str, Any]) -> None:
    env: Any = Monitor(monitored())
    env.constants = value
    with pytest.raises(InputError, match="which changes no specification"):
        env.reset()


@pytest.mark.parametrize("value", [{"g": 9.81}, {"limit": 1.0}, {"limit": "1"}, [0.5], None])
def test_other_attributes_of_this_name_are_left_alone(value: Any) -> None:
    env: Any = Monitor(monitored())
    env.constants = value
    assert env.reset()[1]["robustness"] == 2.0


def test_wrapper_may_keep_the_constants_that_it_passes_on() -> None:
    class Curriculum(gym.Wrapper[Any, Any, Any, Any]):
        constants: dict[str, float]

        def reset(self, **_: Any) -> Any:
            return self.env.reset(options={"constants": self.constants})

    env = Curriculum(Monitor(monitored()))
    env.constants = {"limit": 0.5}
    assert env.reset()[1]["robustness"] == 2.5


def test_wrapper_that_is_outermost_takes_the_constants() -> None:
    for make in (monitored, rewarded):
        env = make()
        env.constants = {"limit": 0.5}
        assert env.reset()[1]["robustness"] == 2.5


def make_inside() -> gym.Env[Any, Any]:
    return TimeLimit(Monitor(monitored()), 9)


@pytest.mark.parametrize("kind", [SyncVectorEnv, AsyncVectorEnv])
def test_set_attr_of_vector_environments_reaches_monitors_inside(kind: Any) -> None:
    envs = kind([make_inside] * 2)
    envs.set_attr("constants", {"limit": 0.5})
    assert envs.reset()[1]["robustness"].tolist() == [2.5, 2.5]
    envs.close()
