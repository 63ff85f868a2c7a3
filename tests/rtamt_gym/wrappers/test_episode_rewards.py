"""Shaped episodes: many as one, and how an end is read changes no reward."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from episode_oracle import chargeable
from gymnasium.vector import AutoresetMode
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from profiles import examples
from scripts import Case, Script, Scripted, cases, variables
from vector_environments import MODES, Envs, difference, sync

from rtamt_gym import StlReward, VectorStlReward
from rtamt_gym.shaping import Priority

LANES = 3
SHAPES = ("add", "replace", "potential", "terminal", "hierarchical")
LEVELS: tuple[Priority, ...] = ("safety", "target", "comfort")
shaped_cases = cases((None, "violation", "depth", "latched", "first"), LANES)
shapes = st.sampled_from(SHAPES)
pytestmark = [
    pytest.mark.filterwarnings(f"ignore:.*{word}:UserWarning")
    for word in ("at_termination", "is_success", "clip")
]


def arguments(case: Case, mode: str) -> dict[str, Any]:
    assume(case.options.cost not in ("violation", "depth") or costs(case))
    options = {**vars(case.options), "on_violation": "report", "period": 1, "mode": mode}
    if mode == "hierarchical":
        options["priorities"] = dict(zip(case.specs, LEVELS, strict=False))
    return {**options, "signals": variables(case.specs)}


def costs(case: Case) -> bool:
    return chargeable(case.specs, case.options.view)


def lead(envs: Envs, steps: int) -> list[tuple[Any, ...]]:
    """What resets and steps show, the observations from before a reset too."""
    shown: list[tuple[Any, ...]] = [envs.reset()]
    for _ in range(steps):
        shown.append(envs.step(np.zeros(LANES, np.int64)))
        ended = np.logical_or(shown[-1][2], shown[-1][3])
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
            shown.append(envs.reset(options={"reset_mask": ended}))
    return shown


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@given(shaped_cases, shapes, st.sampled_from((None, "state")))
@settings(max_examples=examples(40))
def test_one_wrapper_around_all_pays_and_says_what_a_wrapper_around_each_does(
    autoreset: AutoresetMode, case: Case, mode: str, observe: str | None
) -> None:
    options = {**arguments(case, mode), "observe": observe}
    bare = [functools.partial(Scripted, scripts) for scripts in case.lanes]
    each = [
        functools.partial(lambda make: StlReward(make(), case.specs, **options), make)
        for make in bare
    ]
    together = lead(VectorStlReward(sync(bare, autoreset), case.specs, **options), 16)
    singly = lead(sync(each, autoreset), 16)
    assert difference(together, singly) == ""


@given(shaped_cases, shapes)
def test_how_an_end_is_read_changes_rewards_only_with_the_robustness_of_what_was_cut(
    case: Case, mode: str
) -> None:
    options = arguments(case, mode)

    def paid(scripts: list[Script], **readings: str) -> list[tuple[float, float]]:
        env = StlReward(Scripted(scripts), case.specs, **{**options, **readings})
        found = []
        for script in scripts:
            env.reset()
            for _ in range(len(script) - 1):
                _, reward, _, _, info = env.step(0)
                found.append((float(reward), info["robustness"]))
        return found

    for scripts in case.lanes:
        complete = paid(scripts, at_termination="complete", at_truncation="complete")
        assert paid(scripts, at_termination="failure", at_truncation="open") == complete
        cut = paid(scripts, at_termination="cut", at_truncation="cut")
        for (reward, robustness), (whole, value) in zip(cut, complete, strict=True):
            assert reward == whole or robustness != value
