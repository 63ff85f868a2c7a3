"""Episodes of generated specifications and scripts: infos, ends, costs, rewards, records, copies.

One environment is compared with the definition in `episode_oracle`, a vector environment with
single environments, and a copy with its original.
"""

from __future__ import annotations

import copy
import functools
import pickle
import warnings
from typing import Any, NamedTuple, get_args

import gymnasium as gym
import numpy as np
import pytest
from episode_oracle import Flags, Options, charge, chargeable, mismatch, report
from gymnasium.vector import AutoresetMode
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from replay import Replay, X
from scripts import Case, Script, Scripted, cases, variables
from vector_environments import MODES, Envs, both, difference, sync

import rtamt
from rtamt import SpecificationError
from rtamt_gym import Step, StlMonitor, StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.judging.costs import Cost
from rtamt_gym.shaping import Priority

ENTRIES = 3
RUNNING = (False, False)
COSTS = (None, *get_args(Cost))
SHAPES = ("add", "replace", "potential", "terminal", "hierarchical")
LEVELS: tuple[Priority, ...] = ("safety", "target", "comfort")

modes = pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
shapes = st.sampled_from(SHAPES)
quiet = [
    pytest.mark.filterwarnings(f"ignore:.*{word}:UserWarning")
    for word in ("at_termination", "is_success", "clip")
]


def silently(test: Any) -> Any:
    """Ignore the warnings about ends and clips."""
    return functools.reduce(lambda marked, mark: mark(marked), quiet, test)


def arguments(case: Case, **options: Any) -> dict[str, Any]:
    """Return the arguments of a wrapper; drop cases with a cost that their formulas do not have."""
    charged = case.options.cost in ("violation", "depth")
    assume(not charged or chargeable(case.specs, case.options.view))
    return {**vars(case.options), "signals": variables(case.specs), "period": 1, **options}


def shaped(case: Case, shape: str, **options: Any) -> dict[str, Any]:
    """Return the arguments of a reward."""
    if shape == "hierarchical":
        options["priorities"] = dict(zip(case.specs, LEVELS, strict=False))
    return arguments(case, on_violation="report", mode=shape, **options)


# ---- one environment against the definition ----


def check(case: Case) -> None:
    """Play the scripts one after the other; the next reset leaves episodes without an end."""
    options: dict[str, Any] = vars(case.options)
    env = StlMonitor(
        Scripted(case.entries[0]), case.specs, variables(case.specs), period=1, **options
    )
    records: list[dict[str, Any]] = []
    subjects: set[str] = set()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for script in case.entries[0]:
            infos, flags = [env.reset()[1]], [RUNNING]
            while len(infos) < len(script) and flags[-1] == RUNNING:
                *_, terminated, truncated, info = env.step(0)
                infos.append(info)
                flags.append((terminated, truncated))
            expected = report(
                case.specs, script.trace, script.flags, case.options, own=script.infos, left=True
            )
            assert mismatch(expected.infos, infos) == ""
            assert flags == expected.flags
            assert expected.record is not None
            records.append(expected.record)
            own_success = any(flags[-1]) and "is_success" in script.infos[len(infos) - 1]
            subjects |= {"at_termination"} if expected.assumed else set()
            subjects |= {"is_success"} if own_success else set()
        env.close()
    assert mismatch(records, list(env.stl_episodes)) == ""
    texts = [str(warning.message) for warning in caught]
    warned = [word for text in texts for word in ("at_termination", "is_success") if word in text]
    assert len(warned) == len(texts)
    assert sorted(warned) == sorted(subjects)


@given(cases((None, "latched", "first")))
def test_infos_ends_and_records_by_definition(case: Case) -> None:
    check(case)


@given(cases(("violation", "depth")))
def test_costs_of_instants_by_definition(case: Case) -> None:
    if chargeable(case.specs, case.options.view):
        check(case)
    else:
        with pytest.raises(SpecificationError, match='cost="latched"'):
            check(case)


# ---- many environments against single environments ----


class Row(NamedTuple):
    """A reset of some environments or a step of all: the infos, and the ends of episodes."""

    resets: NDArray[np.bool_] | None
    flags: list[Flags]
    infos: dict[str, Any]


def lead(envs: Envs) -> list[Row]:
    """Reset and step; with `DISABLED` reset ended episodes, and sometimes a running one."""
    shown = [Row(np.ones(ENTRIES, np.bool_), [RUNNING] * ENTRIES, envs.reset()[1])]
    for step in range(18):
        *_, terminated, truncated, infos = envs.step(np.zeros(ENTRIES, np.int64))
        flags = list(zip(terminated.tolist(), truncated.tolist(), strict=True))
        shown.append(Row(None, flags, infos))
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            mask = np.logical_or(terminated, truncated)
            mask[step % ENTRIES] |= step % 7 == 3
            if mask.any():
                reset = envs.reset(options={"reset_mask": mask.copy()})
                shown.append(Row(mask, [RUNNING] * ENTRIES, reset[1]))
    return shown


def follow(env: StlMonitor[Any, Any], shown: list[Row], entry: int, mode: AutoresetMode) -> None:
    """Repeat the calls of one environment alone, and compare its infos."""
    ended = False
    for row in shown:
        infos = row.infos
        if row.resets is not None and not row.resets[entry]:
            assert of_entry(infos, entry) == {}
            continue
        if row.resets is not None or (ended and mode is AutoresetMode.NEXT_STEP):
            expected, flags = env.reset()[1], RUNNING
        else:
            *_, terminated, truncated, expected = env.step(0)
            flags = terminated, truncated
        ended = any(flags)
        assert row.flags[entry] == flags
        if mode is AutoresetMode.SAME_STEP:
            final = of_entry(infos.get("final_info", {}), entry)
            assert mismatch(expected if ended else {}, final) == ""
            expected = env.reset()[1] if ended else expected
        assert mismatch(expected, of_entry(infos, entry)) == ""


def of_entry(infos: dict[str, Any], entry: int) -> dict[str, Any]:
    """Return the info of one environment as if alone, without final entries."""
    single: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_") or key in ("final_info", "final_obs") or not infos[f"_{key}"][entry]:
            continue
        if isinstance(value, dict):
            single[key] = of_entry(value, entry)
        else:
            assert value.dtype in (np.float64, np.bool_, np.int64, object)
            single[key] = value[entry] if value.dtype == np.float64 else value.item(entry)
    return single


@pytest.mark.slow(keep=1)
@silently
@modes
@given(cases(COSTS, ENTRIES))
def test_vector_infos_ends_and_records_match_single_monitors(
    mode: AutoresetMode, case: Case
) -> None:
    makes = [functools.partial(Scripted, scripts) for scripts in case.entries]
    # Episodes end early only where the caller resets.
    report_only = {} if mode is AutoresetMode.DISABLED else {"on_violation": "report"}
    options = arguments(case, **report_only)
    envs = VectorStlMonitor(sync(makes, mode), case.specs, **options)
    shown = lead(envs)
    envs.close()
    for entry, make in enumerate(makes):
        env = StlMonitor(make(), case.specs, **options)
        follow(env, shown, entry, mode)
        env.close()
        records = [record for record in envs.stl_episodes if record.pop("env") == entry]
        assert mismatch(list(env.stl_episodes), records) == ""


@pytest.mark.slow(keep=1)
@silently
@modes
@given(cases(COSTS, ENTRIES), shapes, st.sampled_from((None, "state")))
@settings(max_examples=examples(40))
def test_vector_rewards_and_infos_match_single_rewards(
    mode: AutoresetMode, case: Case, shape: str, observe: str | None
) -> None:
    options = shaped(case, shape, observe=observe)
    makes = [functools.partial(Scripted, scripts) for scripts in case.entries]

    def play(envs: Envs) -> list[tuple[Any, ...]]:
        shown: list[tuple[Any, ...]] = [envs.reset()]
        for _ in range(16):
            shown.append(envs.step(np.zeros(ENTRIES, np.int64)))
            ended = np.logical_or(shown[-1][2], shown[-1][3])
            if mode is AutoresetMode.DISABLED and ended.any():
                shown.append(envs.reset(options={"reset_mask": ended}))
        return shown

    together, singles = both(StlReward, VectorStlReward, makes, mode, case.specs, **options)
    assert difference(play(together), play(singles)) == ""


@silently
@given(cases(COSTS, ENTRIES), shapes)
def test_end_modes_change_rewards_only_with_the_robustness(case: Case, shape: str) -> None:
    options = shaped(case, shape)

    def paid(scripts: list[Script], **ends: str) -> list[tuple[float, float]]:
        env = StlReward(Scripted(scripts), case.specs, **{**options, **ends})
        pairs = []
        for script in scripts:
            env.reset()
            for _ in range(len(script) - 1):
                _, reward, _, _, info = env.step(0)
                pairs.append((float(reward), info["robustness"]))
        return pairs

    for scripts in case.entries:
        complete = paid(scripts, at_termination="complete", at_truncation="complete")
        assert paid(scripts, at_termination="failure", at_truncation="open") == complete
        cut = paid(scripts, at_termination="cut", at_truncation="cut")
        for (reward, robustness), (whole, value) in zip(cut, complete, strict=True):
            assert reward == whole or robustness != value


# ---- copies ----


@silently
@given(cases(COSTS), st.integers(0, 5))
def test_copy_of_a_monitor_continues(case: Case, before: int) -> None:
    env = StlMonitor(Scripted(case.entries[0]), case.specs, **arguments(case))
    env.reset()
    over = False
    for _ in range(before):
        over = over or any(env.step(0)[2:4])
        if over:
            break

    def rest(env: StlMonitor[Any, Any]) -> list[dict[str, Any]]:
        infos, ended = [], over
        for _ in range(12):
            if ended:
                infos.append(env.reset()[1])
                ended = False
            else:
                *_, terminated, truncated, info = env.step(0)
                infos.append(info)
                ended = terminated or truncated
        env.close()
        return [*infos, *env.stl_episodes]

    twins = pickle.loads(pickle.dumps(env)), copy.deepcopy(env)
    expected = rest(env)
    for twin in twins:
        assert mismatch(expected, rest(twin)) == ""


@pytest.mark.slow(keep=1)
@silently
@modes
@given(cases(COSTS, ENTRIES), st.integers(0, 9))
@settings(max_examples=examples(30))
def test_copy_of_a_vector_monitor_continues(mode: AutoresetMode, case: Case, before: int) -> None:
    def go(
        envs: VectorStlMonitor, steps: int, ended: NDArray[np.bool_]
    ) -> tuple[list[dict[str, Any]], NDArray[np.bool_]]:
        infos = []
        for _ in range(steps):
            if mode is AutoresetMode.DISABLED and ended.any():
                infos.append(envs.reset(options={"reset_mask": ended.copy()})[1])
            *_, terminated, truncated, info = envs.step(np.zeros(ENTRIES, np.int64))
            infos.append(info)
            ended = np.logical_or(terminated, truncated)
        return infos, ended

    makes = [functools.partial(Scripted, scripts) for scripts in case.entries]
    options = arguments(case, on_violation="report")
    envs = VectorStlMonitor(sync(makes, mode), case.specs, **options)
    envs.reset()
    _, ended = go(envs, before, np.zeros(ENTRIES, np.bool_))
    twins = pickle.loads(pickle.dumps(envs)), copy.deepcopy(envs)
    expected = go(envs, 14, ended)
    for twin in twins:
        assert difference(go(twin, 14, ended), expected) == ""
        assert list(twin.stl_episodes) == list(envs.stl_episodes)


# ---- costs of ends, of resets and of sub-steps ----


def costs(text: str, values: list[float], cost: Cost, **options: Any) -> list[float]:
    """Return the costs of the steps, equal for one environment and for many."""
    options = {"period": 1, "cost": cost, "on_violation": "report", **options}
    env = StlMonitor(Replay(values), text, X, **options)
    make = functools.partial(Replay, values)
    envs = VectorStlMonitor(sync([make], AutoresetMode.NEXT_STEP), text, X, **options)
    env.reset()
    envs.reset()
    charged = []
    for _ in values[1:]:
        charged.append(float(env.step(np.zeros(1))[4]["cost"]))
        assert envs.step(np.zeros((1, 1)))[4]["cost"].tolist() == [charged[-1]]
    return charged


@pytest.mark.parametrize("cost", get_args(Cost))
@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("always(x > 0 implies eventually[0:5](x < 0))", "complete"),  # no answer before the end
        ("always(x > 0)", "failure"),
    ],
)
def test_latched_and_first_charge_violations_by_the_end(text: str, end: str, cost: Cost) -> None:
    charged = cost in {"latched", "first"}
    assert costs(text, [1.0, 2.0, 3.0], cost, at_termination=end) == [0.0, float(charged)]


def test_latched_and_first_charge_the_reset_at_the_first_step() -> None:
    charged = {
        cost: costs("always(x > 0)", [-1.0, 2.0, 3.0], cost, at_termination="complete")
        for cost in get_args(Cost)
    }
    assert charged == {
        "violation": [0.0, 0.0],
        "depth": [0.0, 0.0],
        "latched": [1.0, 1.0],
        "first": [1.0, 0.0],
    }


@pytest.mark.parametrize(
    "text",
    [
        "always(v < 0.5)",
        "always(v < 0.5) and always[2:9](v > -0.2)",
        "always(v > 0.2 implies eventually[0:3](v < 0))",
    ],
)
@pytest.mark.parametrize("cost", ["violation", "depth"])
def test_cost_of_a_step_is_the_maximum_over_its_samples(text: str, cost: Cost) -> None:
    seen: list[float] = []

    def speed(step: Step) -> float:
        seen.append(float(step.env.unwrapped.data.qvel[1]))
        return seen[-1]

    env = StlMonitor(
        gym.make("HalfCheetah-v5"),
        text,
        {"v": speed},
        period=1,
        substeps=True,
        cost=cost,
        on_violation="report",
    )
    _, info = env.reset(seed=3)
    env.action_space.seed(3)
    assert "cost" not in info
    formula, charges = rtamt.parse(text).formula, []
    for _ in range(12):
        begin = env.samples
        info = env.step(env.action_space.sample())[4]
        charged = [
            charge(formula, {"v": seen}, t, Options(cost=cost)) for t in range(begin, env.samples)
        ]
        assert len(charged) == 5
        assert info["cost"] == max(charged)
        charges.append(info["cost"])
    assert 0 < sum(charge > 0 for charge in charges) < 12
    env.close()
