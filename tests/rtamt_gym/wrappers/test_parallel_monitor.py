"""`ParallelStlMonitor` reports for several agents what `StlMonitor` reports for one environment."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parallel_environments import Crew, assert_as_one
from profiles import examples

from rtamt.errors import InputError, StateError
from rtamt_gym import ParallelStlMonitor, Step

AGENTS = ["lead", "wing_0", "wing_1"]
NUMBER = st.sampled_from([-2.0, -1.0, 0.0, 0.5, 1.0, 3.0])
NUMBERS = st.lists(NUMBER, min_size=2, max_size=8)
SPECS: dict[str, tuple[Any, dict[str, Any]]] = {
    "apart": ("always(x - y > -1.5)", {"x": "lead: obs[0]", "y": "wing_0: obs[0]"}),
    "several": (
        {
            "answer": "always(x > 2 implies eventually[0:2](y < 1))",
            "calm": "always(abs(u) < 0.9)",
            "goal": "eventually(x >= 3)",
        },
        {"x": "wing_0: obs[0]", "y": "lead: obs[0]", "u": ("lead: action[0]", 0.0)},
    ),
    "paid": (
        {"pay": "always[1:4](r >= -2)", "late": "always(n < 6)"},
        {"r": ("wing_0: reward", 0.0), "n": ("lead: info['own']", 0.0)},
    ),
}


@st.composite
def crews(draw: Any) -> Callable[[], Crew]:
    agents = AGENTS[: draw(st.integers(2, 3))]
    numbers = {agent: draw(NUMBERS) for agent in agents}
    ends = {agent: draw(st.sampled_from(["terminated", "truncated"])) for agent in agents}
    return lambda: Crew(numbers, ends)


@settings(deadline=None, max_examples=examples(50))
@pytest.mark.parametrize("name", SPECS)
@given(
    make=crews(),
    pushes=st.lists(st.sampled_from([-1.0, -0.5, 0.5]), min_size=24, max_size=24),
    on_violation=st.sampled_from(["terminate", "truncate", "report"]),
    at_termination=st.sampled_from(["complete", "cut", "failure"]),
    at_truncation=st.sampled_from(["cut", "complete", "open"]),
    view=st.sampled_from(["episode", "step"]),
    cost=st.sampled_from([None, "latched", "first"]),
    details=st.booleans(),
)
def test_agents_are_monitored_together_as_one(
    name: str, make: Callable[[], Crew], pushes: list[float], **options: Any
) -> None:
    def act(agent: str, step: int) -> Any:
        return np.array([pushes[(3 * step + AGENTS.index(agent)) % len(pushes)]])

    specs, signals = SPECS[name]
    assert_as_one(make, specs, signals, act, period=1.0, nan="hold", **options)


@settings(deadline=None, max_examples=examples(50))
@given(crews(), st.sampled_from(["violation", "depth"]), st.sampled_from(["report", "terminate"]))
def test_costs_are_those_of_one(make: Callable[[], Crew], cost: str, on_violation: str) -> None:
    specs = {"apart": "always(x - y > -1.5)", "soon": "always(eventually[0:1](x > 0))"}
    assert_as_one(
        make,
        specs,
        SPECS["apart"][1],
        lambda _agent, _step: np.array([0.5]),
        period=1.0,
        nan="hold",
        at_termination="cut",
        cost=cost,
        on_violation=on_violation,
    )


LINE = {"lead": [5.0, 5.0, 5.0, 5.0, 5.0], "wing_0": [1.0, 2.0, 4.0, 4.0, 4.0]}
GAP = {"x": "lead: obs[0]", "y": "wing_0: obs[0]"}


def near(crew: Crew | None = None, **options: Any) -> ParallelStlMonitor:
    """Return a monitor of a crew whose agents are too close at sample 2."""
    options = {"at_termination": "complete", **options}
    return ParallelStlMonitor(crew or Crew(LINE), "always(x - y >= 2)", GAP, **options)


def go(env: ParallelStlMonitor, steps: int = 1) -> tuple[Any, ...]:
    """Make steps; return the result of the last one."""
    result: tuple[Any, ...] = ()
    for _ in range(steps):
        result = env.step({agent: np.array([0.5]) for agent in env.agents})
    return result


@pytest.mark.parametrize("on_violation", ["terminate", "truncate"])
def test_a_violation_ends_the_episode_of_all_agents(on_violation: Any) -> None:
    env = near(on_violation=on_violation, history=True)
    env.reset()
    assert env.agents == ["lead", "wing_0"]
    _, _, terminated, truncated, infos = go(env, 2)
    ends = on_violation == "terminate"
    assert terminated == {"lead": ends, "wing_0": ends}
    assert truncated == {"lead": not ends, "wing_0": not ends}
    assert env.agents == []
    assert env.explain().causes == (("x", 2, 5.0), ("y", 2, 4.0))
    for info in infos.values():
        assert (info["stl_violated_by"], info["stl_violated_at"]) == ("spec", 2)
        assert (info["is_success"], info["stl_success"], info["stl_undecided"]) == (False,) * 3
    with pytest.raises(StateError) as caught:
        env.step({})
    assert str(caught.value) == (
        "expected a running episode, got step() before reset() or after the end of the episode; "
        "call reset()"
    )
    env.reset()
    assert env.agents == ["lead", "wing_0"]
    assert go(env, 2)[2] == terminated


def test_who_left_gets_no_verdict_and_the_last_ones_do() -> None:
    numbers = {"lead": [1.0, 1.0], "wing_0": [0.0, 0.0, 0.0]}
    env = near(Crew(numbers), nan="hold", on_violation="report")
    env.reset()
    _, _, terminated, _, infos = go(env)
    assert terminated == {"lead": True, "wing_0": False}
    assert env.agents == ["wing_0"]
    assert infos.keys() == {"lead", "wing_0"}
    assert "robustness" in infos["lead"]
    assert "is_success" not in infos["lead"]
    _, _, terminated, _, infos = go(env)
    assert terminated == {"wing_0": True}
    assert infos.keys() == {"wing_0"}
    assert infos["wing_0"]["is_success"] is False


def test_a_signal_of_an_agent_that_left_is_an_error_unless_it_is_held() -> None:
    numbers = {"lead": [5.0, 5.0, 5.0, 5.0], "wing_0": [1.0, 1.0]}
    env = near(Crew(numbers))
    env.reset()
    go(env)
    with pytest.raises(InputError) as caught:
        go(env)
    assert str(caught.value) == (
        "signal 'y': wing_0: obs[0] has no value, for the agents of this step are 'lead'; "
        "nan='hold' keeps the last value of an agent that left"
    )
    with pytest.raises(StateError):
        go(env)
    env = near(Crew(numbers), nan="hold")
    env.reset()
    assert go(env, 3)[4]["lead"]["is_success"] is True


def test_that_nobody_leaves_is_a_requirement_on_a_callable() -> None:
    def here(step: Step) -> float:
        return len(step.obs)

    env = ParallelStlMonitor(
        Crew({"lead": [0.0] * 4, "wing_0": [0.0] * 2}),
        "always(here >= 2)",
        {"here": here},
        at_termination="complete",
    )
    env.reset()
    assert go(env, 1)[4]["lead"]["stl_violated"] is False
    assert go(env, 1)[4]["lead"]["stl_violated_at"] == 2


def test_every_agent_has_an_info_of_its_own() -> None:
    env = near(details=True, on_violation="truncate", cost="first")
    _, infos = env.reset()
    assert infos["lead"] == {
        "own": -1.0,
        "robustness": 2.0,
        "stl_lower": -math.inf,
        "stl_upper": 2.0,
        "stl_violated": False,
        "stl": infos["wing_0"]["stl"],
    }
    infos = go(env, 2)[4]
    assert infos["lead"] == infos["wing_0"]
    for key in ("stl", "stl_episode"):
        assert infos["lead"][key] is not infos["wing_0"][key]
        assert infos["lead"][key]["spec"] is not infos["wing_0"][key]["spec"]
    assert infos["lead"]["cost"] == 1.0


def test_an_info_signal_reads_the_info_of_reset_where_it_has_the_key() -> None:
    signals = {"n": ("lead: info['own']", 5.0), "m": ("wing_0: info['other']", 5.0)}
    for text, robustness in (("always(n < 9)", 10.0), ("always(m < 9)", 4.0)):
        name = text[7]
        env = ParallelStlMonitor(Crew(LINE), text, {name: signals[name]})
        assert env.reset()[1]["lead"]["robustness"] == robustness


def test_an_end_that_counts_as_success_unasked_is_told_once() -> None:
    env = near(Crew({"lead": [5.0, 5.0], "wing_0": [0.0, 0.0]}), at_termination=None)
    env.reset()
    with pytest.warns(UserWarning, match="^the environment ended an episode while") as caught:
        assert go(env)[4]["lead"]["is_success"] is True
    assert len(caught) == 1
    assert caught[0].filename == __file__
    env.reset()
    assert go(env)[4]["lead"]["is_success"] is True


class Successful(Crew):
    """A crew whose first agent reports its own success."""

    def step(self, actions: dict[str, Any]) -> Any:
        result = super().step(actions)
        result[4][self.possible_agents[0]]["is_success"] = "mine"
        return result


def test_a_success_of_the_environments_own_is_kept_and_told_once() -> None:
    env = near(Successful(LINE))
    env.reset()
    with pytest.warns(UserWarning, match="reports an is_success of its own") as caught:
        infos = go(env, 2)[4]
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert (infos["lead"]["is_success"], infos["wing_0"]["is_success"]) == ("mine", False)
    assert infos["lead"]["stl_success"] is False
    env.reset()
    go(env, 2)


class Vanishing(Crew):
    """A crew that is gone after one step, without a reason."""

    def step(self, actions: dict[str, Any]) -> Any:
        result = super().step(actions)
        self.agents = []
        return result


def test_agents_that_are_gone_without_a_word_end_an_episode_as_a_time_limit_does() -> None:
    env = near(Vanishing(LINE))
    env.reset()
    _, _, terminated, truncated, infos = go(env)
    assert {*terminated.values(), *truncated.values()} == {False}
    assert infos["lead"]["stl_success"] is True
    assert env.stl_episodes[0]["truncated"] is True


def test_an_episode_left_before_its_end_is_recorded_as_truncated() -> None:
    env = near(buffer_length=2)
    for _ in range(2):
        env.reset()
        go(env)
    env.close()
    assert env.env.closed
    cut = {"samples": 2, "terminated": False, "truncated": True}
    for episode in env.stl_episodes:
        assert {key: episode[key] for key in cut} == cut
        assert episode["specs"]["spec"]["satisfied"] is True
    assert len(env.stl_episodes) == 2


def test_everything_else_is_that_of_the_environment() -> None:
    crew = Crew(LINE, tau=0.25)
    env = near(crew)
    assert env.possible_agents is crew.possible_agents
    assert env.metadata is crew.metadata
    assert env.unwrapped is crew
    assert env.observation_space("lead") is crew.observation_space("lead")
    assert env.action_space("lead") is crew.action_space("lead")
    assert env.period == 0.25
    env.reset(seed=9, options={})
    go(env)
    assert crew.seeds == [9]
    assert env.state() == [1.0]
    assert env.render() == "sample 1"
    for name in ("nothing", "_at"):
        with pytest.raises(AttributeError, match=f"has no attribute '{name}'"):
            getattr(env, name)


@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_continues_as_the_original(clone: Callable[[Any], Any]) -> None:
    env = near(on_violation="report", cost="violation")
    env.reset()
    for steps in range(4):
        copy = clone(env)
        assert copy.samples == steps + 1
        assert repr(go(copy, 4 - steps)) == repr(go(deepcopy(env), 4 - steps))
        go(env)


def test_named_stages_have_a_progress_of_all_agents() -> None:
    ends = {"lead": "truncated", "wing_0": "truncated"}
    env = ParallelStlMonitor(
        Crew({"lead": [0.0, 1.0, -1.0, 3.0], "wing_0": [0.0, 1.0, 1.0, 1.0]}, ends),
        "always(x + y > -9)",
        {"x": "lead: obs[0]", "y": "wing_0: obs[0]"},
        stages=["x >= 1", "y >= 1 and x >= 3"],
        at_truncation="open",
    )
    _, infos = env.reset()
    found = [infos["lead"]["stl_progress"]]
    while env.agents:
        _, _, _, _, infos = env.step({agent: np.zeros(1) for agent in env.agents})
        found.append(infos["lead"]["stl_progress"])
        assert all(info["stl_progress"] == found[-1] for info in infos.values())
    assert found == sorted(found)
    assert found[1] >= 0.5
    assert found[-1] == math.nextafter(1.0, 0.0)
