"""`observe="obligations"` of the wrappers: what it appends, in every kind of environment."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Case, Env, continued, equal, restored, rollout
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit
from replay import Replay, X
from vector_environments import MODES, Make, difference, native, sync, trajectory

from rtamt.errors import InputError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

pytestmark = [
    pytest.mark.filterwarnings("ignore:clip=.* flattens what"),  # it is narrow here
]

cases = pytest.mark.parametrize("case", CASES[:3], ids=lambda case: case.env_id)
ACTION = np.array([0.5])


def observing(case: Case, **options: Any) -> Env:  # noqa: ANN401
    return case.monitored(**{"observe": "obligations", "clip": 0.5, **options})


def shown(text: str, series: list[float], **options: Any) -> list[list[float]]:  # noqa: ANN401
    """Of each sample what is appended behind the five numbers of the state."""
    arguments: Any = {"period": 1, "on_violation": "report", "clip": 9.0}
    env = StlMonitor(Replay(series, "none"), text, X, observe="obligations", **arguments | options)
    obs, _ = env.reset()
    found = [obs[6:].tolist()]
    for _ in series[1:]:
        obs, *_ = env.step(ACTION)
        assert env.observation_space.contains(obs)
        found.append(obs[6:].tolist())
    return found


def clocks(text: str, series: list[float], **options: Any) -> list[float]:  # noqa: ANN401
    return [round(numbers[0], 3) for numbers in shown(text, series, **options)]


@pytest.mark.parametrize("arguments", [{}, {"view": "step"}])
def test_a_patrol_counts_from_the_reset_and_from_every_visit(arguments: dict[str, Any]) -> None:
    text = "eventually[0:4](x > 0)" if arguments else "always(eventually[0:4](x > 0))"
    series = [-1.0, -2.0, -1.0, 3.0, 2.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 1.0]
    assert clocks(text, series, **arguments) == [
        *(0.2, 0.4, 0.6),
        *(0.0, 0.0),
        *(0.2, 0.4, 0.6, 0.8, 1.0, 1.0),
        0.0,
    ]
    assert [margin for _, margin in shown(text, series, **arguments)] == series


def test_an_answer_is_owed_from_the_oldest_request_on() -> None:
    text = "always(x > 3 implies eventually[0:3](x < 0))"
    series = [1.0, 4.0, 1.0, 4.0, -1.0, 1.0, 4.0, 1.0, 1.0, 1.0]
    assert clocks(text, series) == [0.0, 0.25, 0.5, 0.75, 0.0, 0.0, 0.25, 0.5, 0.75, 1.0]


def test_a_duty_lasts_from_the_newest_request_on() -> None:
    text = "always(x > 3 implies always[0:4](x > 0))"
    series = [1.0, 4.0, 1.0, 4.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert clocks(text, series) == [0.0, 1.0, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0]


def test_what_must_be_held_is_counted_while_it_is() -> None:
    text = "eventually(always[0:3](x > 0))"
    series = [1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert clocks(text, series) == [0.25, 0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.0]


@cases
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
def test_gymnasium_finds_no_fault(case: Case) -> None:
    check_env(observing(case), skip_render_check=True)


@cases
def test_nothing_but_the_observation_changes(case: Case) -> None:
    env, own = observing(case), observing(case, observe=None)
    assert equal([step[1:] for step in rollout(env)], [step[1:] for step in rollout(own)])


@cases
def test_the_first_five_numbers_are_those_of_the_state(case: Case) -> None:
    env, state = observing(case), observing(case, observe="state")
    places = [
        place
        for place, what in enumerate(env.get_wrapper_attr("observed"))
        if what.split(": ", 1)[1] in {"robustness", "lower", "upper", "time left", "verdict"}
    ]
    width = state.observation_space.shape[0] - len(places)  # type: ignore[index]
    for (obs, *_), (expected, *_) in zip(rollout(env), rollout(state), strict=True):
        assert obs[:width].tolist() == expected[:width].tolist()
        assert obs[width:][places].tolist() == expected[width:].tolist()


@cases
def test_a_reward_around_shows_the_same(case: Case) -> None:
    inside = rollout(observing(case))
    rewarded = StlReward(
        TimeLimit(observing(case, observe=None), 99), mode="add", observe="obligations", clip=0.5
    )
    assert equal([step[0] for step in rollout(rewarded)], [step[0] for step in inside])


@cases
def test_the_environment_is_made_again_from_its_specification_and_from_json(case: Case) -> None:
    env = observing(case)
    expected = rollout(env)
    assert env.spec is not None
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec)
        assert again.observation_space == env.observation_space
        assert equal(rollout(again), expected)
        again.close()


@cases
@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_in_mid_episode_continues_as_the_original(
    case: Case, clone: Callable[[Env], Env]
) -> None:
    env = observing(case)
    rollout(env, steps=4)
    copy = restored(clone(env), env)
    assert equal(continued(copy, 11, 6), continued(env, 11, 6))


@cases
def test_a_reset_shows_what_the_first_one_did(case: Case) -> None:
    env = observing(case)
    first = rollout(env)
    assert equal(rollout(env), first)


TEXTS = {
    "patrol": "always(eventually[0:3](x > 2))",
    "answer": "always(x > 3 implies eventually[1:4](x < 0))",
    "dwell": "eventually(x < 9 and always[0:2](x > 0))",
    "deep": "always(eventually[0:4](always[0:2](x > 0)))",
    "wait": "always(x > 3 implies (x > 0 until[0:4] x > 5))",
    "past": "always(x > 3 implies once[0:2](x < 0)) and eventually(x > 7)",
}
SERIES = [1.0, 4.0, -1.0, 2.0, 5.0, 6.0, 1.0, 1.0, 4.0, 1.0, -2.0, 3.0, 3.0, 3.0]


def series_env(values: list[float], end: str) -> Env:
    return Replay(values, end)


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("end", ["terminated", "truncated"])
@pytest.mark.parametrize("reward", [False, True])
def test_many_environments_show_what_each_does(
    end: str, autoreset: AutoresetMode, *, reward: bool
) -> None:
    makes: list[Make] = [
        functools.partial(series_env, values, end)
        for values in (SERIES, SERIES[3:9], SERIES[5:8], SERIES[::-1])
    ]
    options: Any = {"observe": "obligations", "clip": 5.0, "on_violation": "report", "period": 1}
    options |= {"at_termination": "complete"}
    one: Any = functools.partial(StlReward, mode="potential") if reward else StlMonitor
    many: Any = functools.partial(VectorStlReward, mode="potential") if reward else VectorStlMonitor

    def wrapped(make: Make) -> Env:
        made: Env = one(make(), TEXTS, X, **options)
        return made

    singles = sync([functools.partial(wrapped, make) for make in makes], autoreset)
    together = many(sync(makes, autoreset), TEXTS, X, **options)
    assert together.observation_space == singles.observation_space
    assert difference(trajectory(together, 40), trajectory(singles, 40)) == ""


def test_vector_environments_that_are_one_show_obligations_too() -> None:
    envs = VectorStlMonitor(
        native(3), "always(eventually[0:0.1](a > 0.01))", {"a": "obs[2]"}, observe="obligations"
    )
    obs, _ = envs.reset(seed=3)
    assert envs.observation_space.contains(obs)
    copy = pickle.loads(pickle.dumps(envs))
    actions = np.ones(3, np.int64)
    ahead = [envs.step(actions) for _ in range(12)]
    assert difference([copy.step(actions) for _ in range(12)], ahead) == ""


def test_samples_inside_of_a_step_count() -> None:
    env = StlMonitor(
        gym.make("HalfCheetah-v5"),
        "always(eventually[0:1](pitch > 9))",
        {"pitch": "qpos[2]"},
        substeps=True,
        observe="obligations",
    )
    env.reset(seed=1)
    obs, *_ = env.step(np.zeros(6))
    assert obs[-2] == np.float32(6 / 101)  # the sample of the reset and five of the step


def test_costs_are_charged_beside_them() -> None:
    options: Any = {"cost": "violation", "period": 1, "on_violation": "report"}
    plain = StlMonitor(Replay(SERIES), TEXTS["answer"], X, **options)
    env = StlMonitor(Replay(SERIES), TEXTS["answer"], X, observe="obligations", **options)
    assert equal([step[1:] for step in rollout(env)], [step[1:] for step in rollout(plain)])


def test_what_is_appended_twice_is_refused() -> None:
    env = StlMonitor(Replay([1.0]), "always(x > 1)", X, observe="state")
    with pytest.raises(InputError) as caught:
        StlReward(env, mode="add", observe="obligations")
    assert str(caught.value) == (
        "observe='obligations' of StlReward would append what observe='state' of the StlMonitor "
        "inside of it has appended already; give observe= to one of them"
    )


def test_the_numbers_have_names() -> None:
    env = StlMonitor(Replay([1.0]), TEXTS, X, period=1, observe="obligations")
    assert env.observed[:8] == [
        "patrol: robustness",
        "patrol: lower",
        "patrol: upper",
        "patrol: time left",
        "patrol: verdict",
        "patrol: clock of eventually[0:3](x > 2)",
        "patrol: margin of x > 2",
        "answer: robustness",
    ]
    assert len(env.observed) == env.observation_space.shape[0] - 1  # type: ignore[index]
    assert StlMonitor(Replay([1.0]), TEXTS, X, period=1).observed == []
