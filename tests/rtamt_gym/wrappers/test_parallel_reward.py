"""`ParallelStlReward` pays every agent the reward that `StlReward` would make of its own."""

from __future__ import annotations

import pickle
from copy import deepcopy
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parallel_environments import Crew, OneOf, selector_of_one

from rtamt.errors import InputError, InputTypeError
from rtamt_gym import ParallelStlMonitor, ParallelStlReward, StlReward
from rtamt_gym.shaping import Mode

NUMBERS = st.lists(st.sampled_from([-2.0, -1.0, 0.0, 0.5, 1.0, 3.0]), min_size=2, max_size=7)
SPECS = {"apart": "always(x - y > -1.5)", "goal": "eventually[0:4](x >= 3)"}
SIGNALS = {"x": "lead: obs[0]", "y": "wing: obs[0]"}
PRIORITIES = {"apart": "safety", "goal": "target"}
MODES = get_args(Mode)
GIVEN: dict[str, Any] = {"period": 1, "nan": "hold", "at_termination": "complete"}
pytestmark = pytest.mark.filterwarnings("ignore:.*clip:UserWarning")


class Paid(OneOf):
    """A crew as one, paid the reward of one of its agents, until it leaves."""

    def __init__(self, crew: Crew, whose: str) -> None:
        super().__init__(crew)
        self.whose = whose

    def step(self, action: dict[str, Any]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        seen, _, terminated, truncated, info = super().step(action)
        return seen, info["rewards"][self.whose], terminated, truncated, info


def options(mode: str, **others: Any) -> dict[str, Any]:
    result: dict[str, Any] = {
        "mode": mode,
        "clip": 2.0,
        "weights": {"goal": 0.5},
        **GIVEN,
        **others,
    }
    if mode == "verdict" and not (result.get("bonus") or result.get("penalty")):
        result["bonus"] = 2.0
    return {**result, **({"priorities": PRIORITIES} if mode == "hierarchical" else {})}


@pytest.mark.slow(keep=2)
@settings(deadline=None)
@pytest.mark.parametrize("mode", MODES)
@given(
    numbers=st.integers(2, 7).flatmap(
        lambda n: st.fixed_dictionaries(
            {
                name: st.lists(
                    st.sampled_from([-2.0, -1.0, 0.0, 0.5, 1.0, 3.0]), min_size=n, max_size=n
                )
                for name in ("lead", "wing")
            }
        )
    ),
    end=st.sampled_from(["terminated", "truncated"]),
    on_violation=st.sampled_from(["terminate", "truncate", "report"]),
    view=st.sampled_from(["episode", "step"]),
    temperature=st.sampled_from([None, 0.5]),
    amounts=st.sampled_from([(0.0, 0.0), (3.0, 2.0)]),
)
def test_agents_that_stay_are_paid_as_each_alone(
    mode: str,
    numbers: dict[str, list[float]],
    end: str,
    on_violation: str,
    view: str,
    temperature: float | None,
    amounts: tuple[float, float],
) -> None:
    given = options(
        mode,
        on_violation=on_violation,
        view=view,
        temperature=temperature,
        bonus=amounts[0],
        penalty=amounts[1],
    )
    specs = SPECS if view == "episode" else {"apart": "x - y > -1.5", "goal": SPECS["goal"]}

    def crew() -> Crew:
        return Crew(numbers, dict.fromkeys(numbers, end))

    env = ParallelStlReward(crew(), specs, SIGNALS, **given)
    of_one = {name: selector_of_one(value) for name, value in SIGNALS.items()}
    alone = {name: StlReward(Paid(crew(), name), specs, of_one, **given) for name in numbers}
    for _ in range(2):
        env.reset(seed=3)
        for item in alone.values():
            item.reset(seed=3)
        while env.agents:
            actions = {name: np.array([0.5]) for name in numbers}
            _, rewards, _, _, infos = env.step(actions)
            for name, item in alone.items():
                _, expected, *_, info = item.step(actions)
                assert repr(rewards[name]) == repr(expected)
                assert repr(infos[name]["reward"]) == repr(info["reward"])
                assert infos[name]["robustness"] == info["robustness"]


@settings(deadline=None)
@given(first=NUMBERS, last=NUMBERS, end=st.sampled_from(["terminated", "truncated"]))
@pytest.mark.parametrize("mode", ["add", "replace", "potential", "terminal"])
def test_an_agent_that_leaves_is_paid_as_at_an_end(
    mode: Mode, first: list[float], last: list[float], end: str
) -> None:
    numbers, ends = {"lead": first, "wing": last}, {"lead": end, "wing": "truncated"}
    given: dict[str, Any] = {"clip": 2.0, "weight": 3.0, "gamma": 0.9, "on_violation": "report"}
    env = ParallelStlReward(
        Crew(numbers, ends), "always(x - y > -1.5)", SIGNALS, mode=mode, **given, **GIVEN
    )
    bare = Crew(numbers, ends)
    bare.reset()
    _, infos = env.reset()
    x = float(np.clip(next(iter(infos.values()))["robustness"], -2, 2))
    while env.agents:
        actions = {name: np.array([0.25]) for name in env.agents}
        _, own, terminated, truncated, _ = bare.step(actions)
        _, rewards, *_, infos = env.step(actions)
        before, x = x, float(np.clip(next(iter(infos.values()))["robustness"], -2, 2))
        for name, r in own.items():
            over = terminated[name] or truncated[name]
            expected = {
                "add": r + 3 * x,
                "replace": x,
                "potential": r + 3 * (0.9 * (0.0 if terminated[name] else x) - before),
                "terminal": r + 3 * x * over,
            }[mode]
            assert rewards[name] == pytest.approx(expected, abs=1e-12)
            assert infos[name]["reward"] == r
        assert rewards.keys() == own.keys()


def made(**given: Any) -> ParallelStlReward:
    crew = Crew({"lead": [3.0, 2.0, 1.0, 0.0], "wing": [0.0, 1.0, 1.0, 1.0]})
    return ParallelStlReward(crew, "always(x > low)", SIGNALS, mode="add", clip=9.0, **given)


def test_a_monitor_that_is_there_is_used() -> None:
    inner = ParallelStlMonitor(
        Crew({"lead": [1.0, 2.0], "wing": [0.0, 0.0]}), SPECS, SIGNALS, period=1
    )
    env = ParallelStlReward(inner, mode="replace")
    env.reset()
    assert env.possible_agents == ["lead", "wing"]
    assert (env.samples, env.unwrapped) == (1, inner.unwrapped)
    with pytest.raises(InputError, match="describe a second monitor"):
        ParallelStlReward(inner, SPECS, SIGNALS, mode="replace")
    with pytest.raises(InputError, match="expected specs="):
        ParallelStlReward(Crew({"lead": [1.0, 2.0]}), mode="replace")
    with pytest.raises(InputTypeError, match="PettingZoo"):
        ParallelStlReward(OneOf(Crew({"lead": [1.0]})), SPECS, SIGNALS, mode="replace")


def test_a_close_closes_what_is_inside_and_ends_the_episode_in_the_records() -> None:
    crew = Crew({"lead": [0.0, 1.0, 2.0], "wing": [1.0, 1.0, 1.0]})
    env = ParallelStlReward(crew, SPECS, SIGNALS, **options("add"))
    env.reset()
    env.step({agent: np.zeros(1) for agent in env.agents})
    env.close()
    assert crew.closed
    assert [(item["samples"], item["truncated"]) for item in env.stl_episodes] == [(2, True)]


def test_constants_change_what_is_paid() -> None:
    env = made(constants={"low": 0})
    for low in (0.0, 0.5):
        _, infos = env.reset(options={"constants": {"low": low}})
        _, rewards, *_ = env.step({name: np.zeros(1) for name in env.agents})
        assert infos["lead"]["robustness"] == 3.0 - low
        assert rewards == {"lead": 2.0 + 2.0 - low, "wing": 1.0 + 2.0 - low}
    env.constants = {"low": 1.0}
    assert env.reset()[1]["wing"]["robustness"] == 2.0


def test_copies_go_on_alike() -> None:
    env = made(constants={"low": 0}, history=True)
    env.reset()
    actions = {name: np.zeros(1) for name in env.agents}
    env.step(actions)
    for copy in (deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert repr(copy.step(actions)) == repr(deepcopy(env).step(actions))
        assert "robustness" in str(copy.explain())
