"""Constants that change between episodes: the wrappers report what new wrappers would report."""

from __future__ import annotations

import functools
import pickle
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from episode_oracle import mismatch
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st
from named_numbers import Named, with_names
from parallel_environments import Crew
from scripts import SIGNALS, Case, Script, Scripted, cases
from vector_environments import MODES, difference, make_pole, sync, trajectory

import rtamt
from rtamt import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt.language.grammar import reader
from rtamt_gym import (
    ParallelStlMonitor,
    StlMonitor,
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
    evaluate_policy,
)

pytestmark = [
    pytest.mark.filterwarnings(f"ignore:.*{word}:UserWarning")
    for word in ("at_termination", "is_success")
]
modes = pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
ENTRIES = 2


@st.composite
def changing(draw: st.DrawFn, costs: tuple[str | None, ...]) -> tuple[Case, dict[str, Named]]:
    """A case, and its specifications as texts with constants."""
    case = draw(cases(costs, ENTRIES))
    items = case.specs.items()
    return case, {name: draw(with_names(str(formula), f"{name}k")) for name, formula in items}


def arguments(case: Case, texts: dict[str, Named], which: str) -> dict[str, Any]:
    """Return the arguments of a wrapper, with the first values or the others."""
    values: dict[str, str] = {}
    for item in texts.values():
        values |= item.first | (item.then if which == "then" else {})
    specs = {name: item.text for name, item in texts.items()}
    options = {**vars(case.options), "signals": SIGNALS, "period": 1}
    return {"specs": specs, "constants": values, **options}


def others(texts: dict[str, Named]) -> dict[str, str]:
    return {name: value for item in texts.values() for name, value in item.then.items()}


def episode(env: gym.Env[Any, Any], **reset: Any) -> list[Any]:
    """Return the infos of an episode of at most nine samples, up to an error."""
    shown: list[Any] = []
    try:
        obs, info = env.reset(**reset)
        shown.append([obs.tolist(), info])
        for _ in range(8):
            obs, reward, terminated, truncated, info = env.step(0)
            shown.append([obs.tolist(), float(reward), bool(terminated), bool(truncated), info])
            if terminated or truncated:
                break
    except InputError as error:  # a term such as 1 / x may have no value
        shown.append(str(error))
    return shown


Way = Callable[[Any, dict[str, str]], dict[str, Any]]


def by_reset(env: Any, values: dict[str, str]) -> dict[str, Any]:  # noqa: ARG001
    return {"options": {"constants": values}}


def by_attribute(env: Any, values: dict[str, str]) -> dict[str, Any]:
    env.set_wrapper_attr("constants", values)
    return {}


ways = pytest.mark.parametrize("way", [by_reset, by_attribute])


@ways
@given(drawn=changing((None, "violation", "depth", "latched", "first")))
def test_other_constants_give_what_a_new_wrapper_gives(
    way: Way, drawn: tuple[Case, dict[str, Named]]
) -> None:
    case, texts = drawn
    make = functools.partial(Scripted, case.entries[0])
    try:
        env = StlMonitor(make(), **arguments(case, texts, "first"))
    except RtamtError:
        return  # a cost that the generated formula does not have
    plain = StlMonitor(make(), **arguments(case, texts, "first"))
    assert mismatch(episode(plain), episode(env)) == ""
    inner = make()
    inner.reset()
    try:
        fresh = StlMonitor(inner, **arguments(case, texts, "then"))
    except RtamtError as error:
        before = env.unwrapped.episode  # type: ignore[attr-defined]
        with pytest.raises(type(error)):
            env.reset(**way(env, others(texts)))
        assert env.unwrapped.episode == before  # type: ignore[attr-defined]
        assert mismatch(episode(plain), episode(env)) == ""
        return
    for how in (way(env, others(texts)), {}):  # and they stay
        assert mismatch(episode(fresh), episode(env, **how)) == ""
    assert env.constants == fresh.constants
    records = list(fresh.stl_episodes)
    assert mismatch(records, list(env.stl_episodes)[-len(records) or len(env.stl_episodes) :]) == ""


@pytest.mark.slow(keep=1)
@modes
@given(drawn=changing((None, "violation", "latched")))
def test_other_constants_of_vectors_give_what_new_ones_give(
    mode: AutoresetMode, drawn: tuple[Case, dict[str, Named]]
) -> None:
    case, texts = drawn
    makes = [functools.partial(Scripted, scripts) for scripts in case.entries]

    def made(which: str) -> VectorStlMonitor:
        given = {**arguments(case, texts, which), "on_violation": "report"}
        return VectorStlMonitor(sync(makes, mode), **given)

    def shown(envs: VectorStlMonitor, **reset: Any) -> list[Any]:
        rows: list[Any] = []
        try:
            rows.append(envs.reset(**reset))
            for _ in range(6):
                rows.append(envs.step(np.zeros(ENTRIES, np.int64)))
                ended = np.logical_or(rows[-1][2], rows[-1][3])
                if mode is AutoresetMode.DISABLED and ended.any():
                    rows.append(envs.reset(options={"reset_mask": ended}))
        except InputError as error:
            rows.append(str(error))
        return rows

    try:
        envs, plain = made("first"), made("first")
    except RtamtError:
        return
    try:
        fresh = made("then")
    except RtamtError as error:
        with pytest.raises(type(error)):
            envs.reset(options={"constants": others(texts)})
        assert difference(shown(plain), shown(envs)) == ""
        return
    assert difference(shown(fresh), shown(envs, options={"constants": others(texts)})) == ""


TEXT = "const float w = 0.2; always(abs(theta) > a implies eventually[0:w](abs(theta) < 0.05))"
ANGLE = {"theta": "obs[2]"}


def make_constant_pole(**constants: float) -> gym.Env[Any, Any]:
    values = {"a": 0.1, **constants}
    env = StlMonitor(make_pole(), TEXT, ANGLE, constants=values, on_violation="report")
    return StlReward(env, mode="add", observe="state")


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("way", ["reset", "set_attr"])
def test_processes_say_what_one_process_says(mode: AutoresetMode, way: str) -> None:
    values = {"a": 0.02, "w": 0.1}

    def shown(envs: Any, *, change: bool) -> list[Any]:
        try:
            rows: list[Any] = trajectory(envs, 12)
            options = {"constants": values} if change and way == "reset" else None
            if change and way == "set_attr":
                envs.set_attr("constants", values)
            rows.append(envs.reset(seed=3, options=options))
            rows += [envs.step(np.array([k % 2, 1])) for k in range(20)]
        finally:
            envs.close()
        return rows[13:]

    first, then = make_constant_pole, functools.partial(make_constant_pole, **values)
    expected = shown(SyncVectorEnv([then] * 2, autoreset_mode=mode), change=False)
    plain = shown(SyncVectorEnv([first] * 2, autoreset_mode=mode), change=False)
    assert difference(expected, plain) != ""
    for kind in (SyncVectorEnv, AsyncVectorEnv):
        assert (
            difference(expected, shown(kind([first] * 2, autoreset_mode=mode), change=True)) == ""
        )


@pytest.mark.slow
def test_each_environment_of_processes_has_its_own() -> None:
    envs = AsyncVectorEnv([make_constant_pole] * 3)
    try:
        envs.set_attr("constants", [{"a": 0.1}, {"a": 0.2}, {"w": 0.4}])
        assert envs.get_attr("constants") == (
            {"a": 0.1, "w": 0.2},
            {"a": 0.2, "w": 0.2},
            {"a": 0.1, "w": 0.4},
        )
    finally:
        envs.close()


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("observe", [None, "state", "obligations"])
@pytest.mark.parametrize("mode", ["add", "progress", "terminal", "potential"])
def test_rewards_and_observations_follow(observe: Any, mode: Any) -> None:
    values = {"a": 0.02, "w": 0.1}

    def made(constants: dict[str, float]) -> StlReward[Any, Any]:
        return StlReward(
            make_pole(),
            TEXT,
            ANGLE,
            constants=constants,
            on_violation="report",
            mode=mode,
            observe=observe,
        )

    env, fresh = made({"a": 0.1}), made(values)
    episode(env, seed=1)
    env.constants = values
    assert mismatch(episode(fresh, seed=2), episode(env, seed=2)) == ""
    assert env.observed == fresh.observed
    envs, fresh_envs = (
        VectorStlReward(
            gym.make_vec("CartPole-v1", 3, vectorization_mode="vector_entry_point"),
            TEXT,
            ANGLE,
            constants=constants,
            mode=mode,
            observe=observe,
        )
        for constants in ({"a": 0.1}, values)
    )
    trajectory(envs, 5)
    envs.constants = values
    assert difference(trajectory(fresh_envs, 30), trajectory(envs, 30)) == ""
    assert envs.observed == fresh_envs.observed


def test_obligations_asked_for_after_a_change_are_those_of_the_next_episode() -> None:
    values = {"a": 0.02, "w": 0.1}

    def monitored(constants: dict[str, float]) -> StlMonitor[Any, Any]:
        return StlMonitor(make_pole(), TEXT, ANGLE, constants=constants, on_violation="report")

    def observing(env: StlMonitor[Any, Any]) -> StlReward[Any, Any]:
        return StlReward(env, mode="add", observe="obligations")

    changed, fresh = monitored({"a": 0.1}), observing(monitored(values))
    changed.reset(seed=1)
    changed.constants = values
    env = observing(changed)
    assert mismatch(episode(fresh, seed=2), episode(env, seed=2)) == ""
    assert env.observed == fresh.observed


def test_agents_follow() -> None:
    numbers = {"a": [3.0, 2.0, 1.0, 0.0], "b": [1.0, 1.0, 1.0, 1.0]}
    given: dict[str, Any] = {"signals": {"x": "a: obs[0]"}, "period": 1, "on_violation": "report"}
    text = "always(x > low)"
    env = ParallelStlMonitor(Crew(numbers), text, constants={"low": -1}, **given)
    fresh = ParallelStlMonitor(Crew(numbers), text, constants={"low": 2}, **given)
    assert env.reset()[1]["a"]["robustness"] == 4.0
    for item, options in ((env, {"constants": {"low": 2}}), (fresh, None)):
        assert item.reset(options=options)[1]["a"]["robustness"] == 1.0
    actions = {name: np.zeros(1) for name in numbers}
    while fresh.agents:
        assert difference(fresh.step(actions), env.step(actions)) == ""
    env.constants = {"low": 0.5}
    assert env.reset()[1]["b"]["robustness"] == 2.5


class Asked(gym.Wrapper[Any, Any, Any, Any]):
    """Keeps the options of resets."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.asked: list[Any] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        self.asked.append(options)
        return self.env.reset(seed=seed, options=options)


def test_the_environment_does_not_see_constants() -> None:
    inner = Asked(make_pole())
    env = StlMonitor(inner, "always(abs(theta) < a)", ANGLE, constants={"a": 0.1})
    options = {"constants": {"a": 0.2}, "low": -0.01, "high": 0.01}
    env.reset(options=options)
    env.reset(options={"constants": {"a": 0.3}})
    env.reset()
    assert inner.asked == [{"low": -0.01, "high": 0.01}, None, None]
    assert options == {"constants": {"a": 0.2}, "low": -0.01, "high": 0.01}
    assert env.constants == {"a": 0.3}


def test_no_text_is_read_after_the_first_change(monkeypatch: pytest.MonkeyPatch) -> None:
    env = make_constant_pole()
    env.reset(seed=1)
    env.reset(options={"constants": {"a": 0.2}})
    reads: list[str] = []
    monkeypatch.setattr(reader, "read", reads.append)
    for k in range(1, 20):
        env.reset(options={"constants": {"a": k / 100, "w": k / 50}})
    assert reads == []


def test_a_copy_in_the_middle_goes_its_own_way() -> None:
    env: Any = make_constant_pole()
    env.reset(seed=1)
    env.step(1)
    env.constants = {"a": 0.05}
    copies = [deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = [env.step(1), env.reset(seed=4), env.step(0)]
    for item in copies:
        got = [item.step(1), item.reset(seed=4), item.step(0)]
        assert difference(expected, got) == ""
        item.reset(options={"constants": {"a": 1.0}})
        assert (env.constants["a"], item.constants["a"]) == (0.05, 1.0)


def test_evaluation_is_under_the_constants_that_hold() -> None:
    def made(a: float) -> Any:
        return StlMonitor(
            make_pole(), "always(abs(theta) < a)", ANGLE, constants={"a": a}, on_violation="report"
        )

    env = made(0.01)
    env.constants = {"a": 0.1}

    def found(of: Any) -> str:
        return str(evaluate_policy(lambda _: 1, of, episodes=8))

    expected = found(made(0.1))
    assert found(env) == expected
    assert found(made(0.01)) != expected


def test_constants_of_files_and_of_what_was_parsed(tmp_path: Path) -> None:
    path = tmp_path / "near.stl"
    path.write_text("const float a = 0.5\nalways(abs(theta) < a)", encoding="utf-8")
    specs: dict[str, Any] = {
        "file": path,
        "parsed": rtamt.parse("const float a = 2; always(abs(theta) < a + b)", constants={"b": 1}),
        "formula": rtamt.parse("always(abs(theta) < 9)").formula,
    }
    env = StlMonitor(make_pole(), specs, ANGLE, constants={"a": 0.25})
    formulas = {name: str(spec.formula) for name, spec in env.judging.specs.items()}
    assert formulas == {
        "file": "always(abs(theta) < 0.25)",
        "parsed": "always(abs(theta) < 0.25 + 1)",
        "formula": "always(abs(theta) < 9)",
    }
    env.reset(options={"constants": {"a": 3}})
    assert str(env.judging.specs["parsed"].formula) == "always(abs(theta) < 3 + 1)"
    assert env.constants == {"a": 3.0, "b": 1.0}


PLACE = f"  {TEXT[1:]}\n{'^':>63}\n"


@pytest.mark.parametrize(
    ("values", "kind", "said"),
    [
        (
            {"b": 0.2},
            InputError,
            "constants: no specification uses the constant 'b'; their constants are a, w",
        ),
        (
            {"theta": 0.2},
            InputError,
            "constants: no specification uses the constant 'theta'; their constants are a, w",
        ),
        (
            {"w": 0.13},
            SpecificationError,
            (
                "STL:1:62: bound 0.13 s is not a multiple of the period 0.02 s (6.5 steps)\n"
                f"{PLACE}"
                "  hint: use 0.12 s or 0.14 s, take samples 0.01 s apart, or let align= round it"
            ),
        ),
        (
            {"w": -1},
            SpecificationError,
            f"STL:1:62: expected a bound of at least 0, got -1\n{PLACE}  hint: with w = -1",
        ),
        (
            {"a": float("nan")},
            SpecificationError,
            "expected a finite number for the constant 'a', got nan",
        ),
        ({"a": True}, InputTypeError, "expected a number for the constant 'a', got bool True"),
        (
            [0.2],
            InputTypeError,
            "expected values of constants by name, such as constants={'limit': 0.3}, got [0.2]",
        ),
    ],
)
@ways
def test_what_cannot_be_leaves_all_as_it_was(
    way: Way, values: Any, kind: type[Exception], said: str
) -> None:
    env, plain = make_constant_pole(), make_constant_pole()
    for item in (env, plain):
        item.reset(seed=1)
        item.step(1)
    with pytest.raises(kind) as caught:
        env.reset(**way(env, values))
    assert str(caught.value) == said
    assert difference(plain.step(0), env.step(0)) == ""
    assert mismatch(episode(plain, seed=2), episode(env, seed=2)) == ""
    assert env.get_wrapper_attr("constants") == {"a": 0.1, "w": 0.2}
    if "theta" not in values:  # in a text that was not read yet, any name may be a constant
        given = {"a": 0.1, **values} if isinstance(values, dict) else values
        first = said.partition(";")[0].partition("\n")[0].rpartition(": ")[2]  # without a place
        with pytest.raises(kind, match=re.escape(first)):
            StlMonitor(make_pole(), TEXT, ANGLE, constants=given)


@pytest.mark.parametrize("around", [False, True])
def test_a_bound_that_would_change_what_is_observed_is_refused(around: bool) -> None:  # noqa: FBT001
    text = "const float w = 0.2; always(eventually[0:w](theta > 0) or eventually[0:0.1](theta > 0))"
    how: dict[str, Any] = {"observe": "obligations"}
    env: Any = StlMonitor(make_pole(), text, ANGLE, **({} if around else how))
    if around:
        env = StlReward(env, mode="add", **how)
    env.reset(seed=1)
    env.reset(options={"constants": {"w": 0.4}})
    space = env.observation_space
    with pytest.raises(InputError) as caught:
        env.reset(options={"constants": {"w": 0.1}})
    assert str(caught.value) == (
        "expected constants that leave the observation space as it is, got {'w': 0.1}, which "
        "change the temporal operators that observe='obligations' shows: from "
        "eventually[0:0.4](theta > 0), eventually[0:0.1](theta > 0) to "
        "eventually[0:0.1](theta > 0); make another environment"
    )
    obs, _ = env.reset()
    assert env.observation_space is space
    assert obs in space
    assert env.constants == {"w": 0.4}


def test_some_of_many_keep_the_constants_of_all() -> None:
    envs = VectorStlMonitor(
        sync([make_pole] * 3, AutoresetMode.DISABLED),
        "always(abs(theta) < a)",
        ANGLE,
        constants={"a": 0.1},
    )
    envs.reset(seed=1)
    mask = np.array([True, False, True])
    with pytest.raises(InputError) as caught:
        envs.reset(options={"reset_mask": mask, "constants": {"a": 0.2}})
    assert str(caught.value) == (
        "expected a reset of all environments, because new constants apply to all, got a reset of "
        "some: reset all, or wrap each environment with StlMonitor, which changes constants when "
        "its episode ends"
    )
    envs.constants = {"a": 0.3}
    before = envs.samples
    envs.reset(options={"reset_mask": mask})
    assert "0.1" in str(envs.monitors["spec"][1].specification)
    envs.reset(options={"reset_mask": np.ones(3, np.bool_)})
    assert "0.3" in str(envs.monitors["spec"][1].specification)
    assert before.tolist() == envs.samples.tolist() == [1, 1, 1]


def test_the_arguments_are_recorded() -> None:
    env = StlMonitor(make_pole(), "always(abs(theta) < a)", ANGLE, constants={"a": 0.1})
    spec = env.spec
    assert spec is not None
    again = gym.make(gym.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert again.get_wrapper_attr("constants") == {"a": 0.1}


def test_a_bound_that_appears_needs_a_period() -> None:
    script = Script({"a": [1.0, 2.0], "b": [0.0, 0.0], "c": [0.0, 0.0]}, "truncated")
    env = StlMonitor(
        Scripted([script]), "const float w = 0; always[w:inf](a > -9)", {"a": "obs[0]"}
    )
    env.reset()
    with pytest.raises(SpecificationError, match="does not state the duration of a step"):
        env.reset(options={"constants": {"w": 1}})
    assert env.reset()[1]["robustness"] == 10.0
