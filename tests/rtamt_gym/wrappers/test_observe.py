"""`observe="state"` and `observe="obligations"`: the appended numbers."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Case, Env, equal, rollout
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit
from replay import Replay, X
from vector_environments import MODES, Make, both, difference, native, trajectory

from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

pytestmark = pytest.mark.filterwarnings(
    "ignore:clip=.* flattens the values of"
)  # it is narrow here

# Except the one that shows a picture, to which nothing can be appended.
cases = pytest.mark.parametrize(
    "case", [*CASES[:3], CASES[-1]], ids=lambda case: case.env_id.split(":")[-1]
)

SPECS = {"dry": "always(x > 1)", "there": "eventually[0:4](x > 5)", "once": "eventually(x > 8)"}
HORIZONS = {"dry": None, "there": 4, "once": None}
SERIES = [3.0, 1.5, 4.0, 0.5, 9.0, 2.0, 2.0]


def observing(case: Case, **options: Any) -> Env:
    return case.monitored(**{"observe": "state", "clip": 0.5, **options})


def by_hand(states: Mapping[str, Any], sample: int, clip: float) -> list[float]:
    """Return the appended numbers, from ``info["stl"]`` and the horizons in samples."""
    numbers: list[float] = []
    for name, horizon in HORIZONS.items():
        values = [states[name][key] for key in ("robustness", "lower", "upper")]
        numbers += [min(max(value, -clip), clip) for value in values]
        numbers.append(1.0 if horizon is None else max(0.0, 1 - sample / horizon))
        numbers.append({"SATISFIED": 1.0, "VIOLATED": -1.0}.get(states[name]["verdict"], 0.0))
    return numbers


@pytest.mark.parametrize("clip", [1.0, 3.0])
@pytest.mark.parametrize("end", ["terminated", "truncated"])
def test_five_numbers_of_every_specification_are_appended(end: str, clip: float) -> None:
    options: Any = {"details": True, "period": 1, "on_violation": "report"}
    plain = StlMonitor(Replay(SERIES, end), SPECS, X, **options)
    env = StlMonitor(Replay(SERIES, end), SPECS, X, observe="state", clip=clip, **options)
    low, high = [-clip, -clip, -clip, 0.0, -1.0], [clip, clip, clip, 1.0, 1.0]
    assert env.observation_space == spaces.Box(
        np.array([-np.inf, *low * 3]), np.array([np.inf, *high * 3]), dtype=np.float64
    )
    for _ in range(2):
        (obs, info), (own, same) = env.reset(seed=1), plain.reset(seed=1)
        samples = [(obs, own, info)]
        assert equal(info, same)
        for _ in SERIES[1:]:
            step, expected = env.step(np.array([0.5])), plain.step(np.array([0.5]))
            assert equal(step[1:], expected[1:])
            samples.append((step[0], expected[0], step[4]))
        for sample, (obs, own, info) in enumerate(samples):
            assert env.observation_space.contains(obs)
            shown = np.array(by_hand(info["stl"], sample, clip), np.float32)
            assert obs.tolist() == [*own, *shown]


@pytest.mark.slow(keep=4)
@cases
@pytest.mark.parametrize("observe", ["state", "obligations"])
def test_a_reward_around_shows_the_same(case: Case, observe: Any) -> None:
    env = observing(case, observe=observe)
    rewarded = StlReward(
        TimeLimit(observing(case, observe=None), 99), mode="add", observe=observe, clip=0.5
    )
    assert env.observation_space == rewarded.observation_space
    shown, other = rollout(env), rollout(rewarded)
    assert equal([step[0] for step in shown], [step[0] for step in other])
    own = rollout(observing(case, observe=None))
    assert equal([step[1:] for step in shown], [step[1:] for step in own])


class Placed(gym.ObservationWrapper[Any, Any, Any]):
    """Has the observation in a dictionary."""

    def __init__(self, env: Env) -> None:
        super().__init__(env)
        self.observation_space = spaces.Dict({"z": env.observation_space})

    def observation(self, observation: Any) -> Any:
        return {"z": observation}


def make_placed(values: list[float], end: str) -> Env:
    return Placed(Replay(values, end))


@pytest.mark.slow(keep=8)
@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("end", ["terminated", "truncated"])
@pytest.mark.parametrize("ending", ["complete", "failure"])
@pytest.mark.parametrize("view", ["episode", "step"])
def test_vector_dictionaries_match_single_environments(
    view: str, end: str, ending: str, autoreset: AutoresetMode
) -> None:
    makes: list[Make] = [
        functools.partial(make_placed, SERIES[:n], end) for n in (2, 4, len(SERIES))
    ]
    specs = SPECS if view == "episode" else {"a": "x > 2 implies eventually[0:2](x < 1)"}
    same(makes, autoreset, specs, {"x": "obs['z'][0]"}, period=1, view=view, at_termination=ending)


def same(
    makes: list[Make], autoreset: AutoresetMode, specs: Any, signals: dict[str, Any], **options: Any
) -> None:
    """Check that environments monitored together show the same as alone."""
    options |= {"observe": "state", "clip": 2.0, "on_violation": "report"}
    together, singles = both(
        StlMonitor, VectorStlMonitor, makes, autoreset, specs, signals, **options
    )
    assert together.observation_space == singles.observation_space
    assert together.single_observation_space == singles.single_observation_space
    assert difference(trajectory(together, 16), trajectory(singles, 16)) == ""


@pytest.mark.parametrize(
    ("observe", "spec"),
    [
        ("state", "always(abs(a) < 0.2)"),
        ("obligations", "always(eventually[0:0.1](a > 0.01))"),
    ],
)
def test_native_vector_environments_show_it_too(observe: Any, spec: str) -> None:
    envs = VectorStlMonitor(native(3), spec, {"a": "obs[2]"}, observe=observe, clip=0.1)
    obs, infos = envs.reset(seed=3)
    assert envs.observation_space.contains(obs)
    assert obs[:, 4].tolist() == np.minimum(infos["robustness"], 0.1).astype(np.float32).tolist()
    copy = pickle.loads(pickle.dumps(envs))
    actions = np.ones(3, np.int64)
    ahead = [envs.step(actions) for _ in range(12)]
    assert difference([copy.step(actions) for _ in range(12)], ahead) == ""


def test_samples_inside_of_a_step_show_the_state_after_it() -> None:
    env = StlMonitor(
        gym.make("HalfCheetah-v5"),
        "always[0:1](abs(pitch) < 1)",
        {"pitch": "qpos[2]"},
        substeps=True,
        observe="state",
    )
    env.reset(seed=1)
    obs, _, _, _, info = env.step(np.zeros(6))
    # Five steps of 0.01 s of a window of 1 s.
    assert obs[-5] == np.float32(info["robustness"])
    assert obs[-2] == np.float32(0.95)


def test_an_end_that_is_a_failure_shows_the_bound_that_it_sets() -> None:
    env = StlMonitor(
        Replay([3.0, 3.0]), "always(x > 1)", X, observe="state", at_termination="failure", clip=4.0
    )
    env.reset()
    obs, _, _, _, info = env.step(np.array([0.5]))
    assert info["stl_violated"] is True
    assert obs.tolist() == [3.0, 2.0, -4.0, 0.0, 1.0, -1.0]
    assert np.signbit(obs[3])


# ---- beside rewards ----


def test_a_reward_around_it_shapes_what_it_would_without() -> None:
    options: Any = {"mode": "potential", "clip": 3.0}

    def monitored(**more: Any) -> StlMonitor[Any, Any]:
        return StlMonitor(Replay(SERIES), SPECS, X, period=1, on_violation="report", **more)

    env = StlReward(TimeLimit(monitored(observe="state"), 99), **options)
    alone = StlReward(monitored(), **options)
    assert env.observation_space.shape == (16,)
    (seen, *_), *steps = rollout(env)
    assert len(seen) == 16
    assert equal([step[1:] for step in steps], [step[1:] for step in rollout(alone)[1:]])


# ---- pending obligations ----


obligation_cases = pytest.mark.parametrize("case", CASES[:3], ids=lambda case: case.env_id)


def with_obligations(case: Case, **options: Any) -> Env:
    return case.monitored(**{"observe": "obligations", "clip": 0.5, **options})


def shown(text: str, series: list[float], **options: Any) -> list[list[float]]:
    """Return, for each sample, the numbers after the five numbers of the state."""
    arguments: Any = {"period": 1, "on_violation": "report", "clip": 9.0}
    env = StlMonitor(Replay(series, "none"), text, X, observe="obligations", **arguments | options)
    obs, _ = env.reset()
    result = [obs[6:].tolist()]
    for _ in series[1:]:
        obs, *_ = env.step(np.array([0.5]))
        assert env.observation_space.contains(obs)
        result.append(obs[6:].tolist())
    return result


def clocks(text: str, series: list[float], **options: Any) -> list[float]:
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


@obligation_cases
def test_the_first_five_numbers_are_those_of_the_state(case: Case) -> None:
    env, state = with_obligations(case), with_obligations(case, observe="state")
    places = [
        place
        for place, what in enumerate(env.get_wrapper_attr("observed"))
        if what.split(": ", 1)[1] in {"robustness", "lower", "upper", "time left", "verdict"}
    ]
    width = state.observation_space.shape[0] - len(places)  # type: ignore[index]
    for (obs, *_), (expected, *_) in zip(rollout(env), rollout(state), strict=True):
        assert obs[:width].tolist() == expected[:width].tolist()
        assert obs[width:][places].tolist() == expected[width:].tolist()


TEXTS = {
    "patrol": "always(eventually[0:3](x > 2))",
    "answer": "always(x > 3 implies eventually[1:4](x < 0))",
    "dwell": "eventually(x < 9 and always[0:2](x > 0))",
    "deep": "always(eventually[0:4](always[0:2](x > 0)))",
    "wait": "always(x > 3 implies (x > 0 until[0:4] x > 5))",
    "past": "always(x > 3 implies once[0:2](x < 0)) and eventually(x > 7)",
}
OWED_SERIES = [1.0, 4.0, -1.0, 2.0, 5.0, 6.0, 1.0, 1.0, 4.0, 1.0, -2.0, 3.0, 3.0, 3.0]


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("end", ["terminated", "truncated"])
@pytest.mark.parametrize("reward", [False, True])
def test_vector_obligations_match_single_environments(
    end: str, autoreset: AutoresetMode, *, reward: bool
) -> None:
    makes: list[Make] = [
        functools.partial(Replay, values, end)
        for values in (OWED_SERIES, OWED_SERIES[3:9], OWED_SERIES[5:8], OWED_SERIES[::-1])
    ]
    options: Any = {"observe": "obligations", "clip": 5.0, "on_violation": "report", "period": 1}
    options |= {"at_termination": "complete"}
    options |= {"mode": "potential"} if reward else {}
    one, many = (StlReward, VectorStlReward) if reward else (StlMonitor, VectorStlMonitor)
    together, singles = both(one, many, makes, autoreset, TEXTS, X, **options)
    assert together.observation_space == singles.observation_space
    assert difference(trajectory(together, 40), trajectory(singles, 40)) == ""


def test_sub_steps_count_for_clocks() -> None:
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
    plain = StlMonitor(Replay(OWED_SERIES), TEXTS["answer"], X, **options)
    env = StlMonitor(Replay(OWED_SERIES), TEXTS["answer"], X, observe="obligations", **options)
    assert equal([step[1:] for step in rollout(env)], [step[1:] for step in rollout(plain)])


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
