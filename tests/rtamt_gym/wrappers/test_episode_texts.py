"""The texts of the wrappers about ends of episodes and about errors."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st
from replay import Replay, X, run
from vector_environments import Envs, sync

import rtamt
from rtamt import SpecificationError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.judging.costs import Cost
from rtamt_gym.options.evaluation import View

INVARIANT = "always(x > 1)"
HOLD = "eventually(always[0:2](x > 2))"
ASSUMED = (
    "the environment ended an episode while specification 'spec' was open, which counts as "
    'satisfied. Set at_termination="complete" to confirm this, "failure" if the environment ends '
    'failed episodes, such as a fall, or "cut" if the episode could have gone on'
)


CUT = (
    "the environment ended an episode inside a bounded window of specification 'spec', which "
    "counts as satisfied without the rest of the window. Set "
    'at_termination="cut" to leave it open, "failure" to violate it, or "complete" to confirm '
    "this. An environment that goes on after a success records the rest of the window"
)


def own_success() -> Replay:
    env = Replay([3, 3])
    env.info = {"is_success": False}
    return env


def lead(envs: Envs, steps: int) -> None:
    envs.reset()
    for _ in range(steps):
        envs.step(np.zeros((envs.num_envs, 1)))


def bare() -> Envs:
    return sync([lambda: Replay([3, 3])], AutoresetMode.DISABLED)


def warned(act: Any) -> list[str]:
    """Return the texts of the warnings, each of which points here."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        act()
    assert {warning.filename for warning in caught} <= {__file__, run.__code__.co_filename}
    assert all(issubclass(warning.category, UserWarning) for warning in caught)
    return [str(warning.message) for warning in caught]


# ---- warnings ----


def test_a_success_that_only_the_default_makes_is_said_once() -> None:
    env = StlMonitor(Replay([3, 3]), INVARIANT, X)
    assert warned(lambda: [run(env) for _ in range(3)]) == [ASSUMED]
    envs = VectorStlMonitor(
        sync([lambda: Replay([3, 3])] * 2, AutoresetMode.SAME_STEP), INVARIANT, X
    )
    assert warned(lambda: lead(envs, 6)) == [ASSUMED]


def test_a_warning_points_at_the_line_that_steps_whatever_wrappers_are_between() -> None:
    shaping: Any = {"mode": "add", "clip": 5}
    reward = StlReward(Replay([3, 3]), INVARIANT, X, **shaping)
    around = gym.wrappers.FlattenObservation(reward)
    assert warned(lambda: run(around)) == [ASSUMED]
    makes = [lambda: Replay([3, 3])] * 2
    envs = VectorStlReward(sync(makes, AutoresetMode.SAME_STEP), INVARIANT, X, **shaping)
    assert warned(lambda: lead(envs, 6)) == [ASSUMED]
    item = sync([monitored], AutoresetMode.NEXT_STEP)
    assert warned(lambda: lead(item, 6)) == [ASSUMED]


@pytest.mark.parametrize(
    ("make", "at_termination", "text"),
    [
        (lambda: Replay([3, 3]), None, "was open, which counts as satisfied"),
        (own_success, "cut", "reports an is_success of its own"),
    ],
)
def test_a_warning_that_is_an_error_leaves_the_episode_recorded(
    make: Any, at_termination: str | None, text: str
) -> None:
    options: Any = {"at_termination": at_termination}
    env = StlMonitor(make(), INVARIANT, X, **options)
    envs = VectorStlMonitor(sync([make] * 2, AutoresetMode.NEXT_STEP), INVARIANT, X, **options)
    for act in (lambda: run(env), lambda: lead(envs, 1)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(UserWarning, match=text):
                act()
            act()
    assert [record["samples"] for record in env.stl_episodes] == [2, 2]
    assert [record["samples"] for record in envs.stl_episodes] == [2] * 4


def test_the_specification_that_was_open_is_named() -> None:
    specs = {"peak": "eventually(x > 2)", "calm": INVARIANT, "goal": "eventually(x > 5)"}
    env = StlMonitor(Replay([3, 3]), specs, X)
    assert warned(lambda: run(env)) == [ASSUMED.replace("'spec'", "'calm'")]


@pytest.mark.parametrize("view", ["episode", "step"])
@pytest.mark.parametrize("history", [False, True])
def test_an_end_inside_a_bounded_window_is_said_once(view: View, *, history: bool) -> None:
    options: Any = {"view": view, "period": 1}
    specs, replayed = {"calm": INVARIANT, "spec": HOLD}, [2.0, 2.0, 3.0]
    if view == "step":
        specs, replayed = {"calm": "x > 1", "spec": "always[0:2](x > 2)"}, [3.0, 3.0]
    infos: list[dict[str, Any]] = []
    env = StlMonitor(Replay(replayed), specs, X, history=history, **options)
    assert warned(lambda: infos.extend(run(env)[-1] for _ in range(3))) == [CUT]
    assert all(item["stl_success"] for item in infos)
    envs = VectorStlMonitor(
        sync([lambda: Replay(replayed)] * 2, AutoresetMode.SAME_STEP), specs, X, **options
    )
    assert warned(lambda: lead(envs, 9)) == [CUT]
    complete = StlMonitor(Replay(replayed), specs, X, at_termination="complete", **options)
    infos.append(run(complete)[-1])
    assert repr(infos[0]) == repr(infos[3])  # reading it changes nothing


@given(
    trace=st.lists(st.sampled_from([0.0, 3.0]), min_size=2, max_size=9),
    text=st.sampled_from(
        [
            HOLD,
            INVARIANT,
            "always(x > 2 implies eventually[0:3](x < 2))",
            "always[0:4](x > 2)",
            "eventually[2:3](x > 2)",
            "eventually(x > 2 since[2:2] x > 2)",
            "once[0:2](x > 2)",
        ]
    ),
)
def test_a_window_is_told_where_complete_satisfies_what_cut_leaves_open(
    trace: list[float], text: str
) -> None:
    verdicts = {
        end: judged.verdict
        for end in ("complete", "cut", "open")
        for judged in [rtamt.judge(text, {"x": trace}, period=1, end=end)]
    }
    spec = {"spec": f"({text}) and eventually(x > -1)"}  # it reads more than the first sample
    env = StlMonitor(Replay(trace), spec, X, period=1, on_violation="report")
    told = warned(lambda: run(env))
    satisfied = verdicts["complete"] > 0 and not verdicts["open"]
    assert (told == [CUT]) == (satisfied and not verdicts["cut"])
    assert bool(told) == satisfied


@pytest.mark.parametrize(
    ("values", "end", "text", "options"),
    [
        ([3, 3], "terminated", HOLD, {"at_termination": "cut", "period": 1}),
        ([3, 3], "terminated", HOLD, {"at_termination": "complete", "period": 1}),
        ([3, 3], "truncated", HOLD, {"period": 1}),
        ([3, 3, 3], "terminated", HOLD, {"period": 1}),
        ([3, 3, 0], "terminated", HOLD, {"period": 1}),
        ([3, 3], "terminated", "eventually(x > 2 since[2:2] x > 2)", {"period": 1}),
        ([3, 3], "terminated", INVARIANT, {"at_termination": "complete"}),
        ([3, 3], "terminated", INVARIANT, {"at_termination": "cut"}),
        ([3, 3], "terminated", INVARIANT, {"at_termination": "failure"}),
        ([3, 3], "truncated", INVARIANT, {}),
        ([3, 0], "terminated", INVARIANT, {}),
        ([3, 3], "terminated", "eventually(x > 2)", {}),
        ([3, 3], "terminated", "eventually(x > 5)", {}),
    ],
)
def test_nothing_is_said_where_nothing_was_assumed(
    values: list[float], end: str, text: str, options: dict[str, Any]
) -> None:
    env = StlMonitor(Replay(values, end), text, X, **options)
    assert warned(lambda: run(env)) == []


def test_a_success_that_the_environment_reports_is_kept_and_said_once() -> None:
    env = StlMonitor(own_success(), INVARIANT, X, at_termination="complete")
    text = (
        f"{env.unwrapped} reports an is_success of its own, which is kept; "
        'info["stl_success"] is true if the specifications are satisfied'
    )
    infos: list[dict[str, Any]] = []
    assert warned(lambda: infos.extend(run(env)[-1] for _ in range(3))) == [text]
    assert [(info["is_success"], info["stl_success"]) for info in infos] == [(False, True)] * 3
    envs = VectorStlMonitor(
        sync([own_success] * 2, AutoresetMode.SAME_STEP), INVARIANT, X, at_termination="complete"
    )
    text = text.replace(str(env.unwrapped), str(envs.unwrapped))
    assert warned(lambda: lead(envs, 6)) == [text]


# ---- errors ----


@pytest.mark.parametrize("cost", ["violation", "depth"])
@pytest.mark.parametrize(
    ("text", "demand", "view"),
    [
        ("eventually(x > 5)", "eventually(x > 5)", "episode"),
        ("always(x < 0 implies eventually(x > 5))", "x < 0 implies eventually(x > 5)", "episode"),
        ("always(x > 1) and (x > 0) until (x > 5)", "x > 0 until x > 5", "episode"),
        ("eventually(x > 1)", "eventually(x > 1)", "step"),
    ],
)
def test_a_demand_that_only_the_end_settles_has_no_cost_of_an_instant(
    text: str, demand: str, view: View, cost: Cost
) -> None:
    with pytest.raises(SpecificationError) as caught:
        StlMonitor(Replay([3, 3]), text, X, cost=cost, view=view)
    assert str(caught.value) == (
        f"specification 'spec': whether an instant violates {demand} is known only at the end, "
        "because its future has no end; give it bounds, such as eventually[0:5], or use "
        'cost="latched"'
    )


def monitored() -> gym.Env[Any, Any]:
    return StlMonitor(Replay([3, 3]), INVARIANT, X)


# ---- time limits outside ----


@pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.UnseenEndWarning")
def test_a_time_limit_outside_is_seen_at_the_next_reset_and_at_the_close() -> None:
    inner = StlMonitor(Replay([3, 3, 3, 3, 0]), INVARIANT, X)
    env = gym.wrappers.TimeLimit(inner, 2)
    for _ in range(2):
        assert "stl_episode" not in run(env)[-1]
    assert len(inner.stl_episodes) == 1
    env.close()
    env.close()
    outcome = {"robustness": 2.0, "verdict": "SATISFIED", "satisfied": True, "ended_at": 2}
    record = {"samples": 3, "terminated": False, "truncated": True, "specs": {"spec": outcome}}
    assert list(inner.stl_episodes) == [record] * 2
