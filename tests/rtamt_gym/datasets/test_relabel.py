"""`relabel` equals the wrappers on recorded episodes, bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES
from hypothesis import given
from hypothesis import strategies as st
from recordings import difference, monitored, record
from replay import INF, Replay, X, shaping_options

from rtamt import InputError
from rtamt.typing import End
from rtamt_gym import relabel
from rtamt_gym.datasets import relabel as module
from rtamt_gym.judging.costs import Cost
from rtamt_gym.options.evaluation import AtTermination, names_for
from rtamt_gym.shaping import Mode
from rtamt_gym.wrappers.monitoring import MonitorOptions
from rtamt_gym.wrappers.reward import ShapingOptions

SPECS = {"high": "always(x > 1)", "calm": "eventually[0:3](x + u > 3.5)"}
SIGNALS = {**X, "u": ("action[0]", 0.25)}

VALUES = st.lists(
    st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0, 4.0, INF]), min_size=2, max_size=9),
    min_size=1,
    max_size=6,
)
MODES = st.one_of(st.none(), st.sampled_from(get_args(Mode)))


@given(
    values=VALUES,
    end=st.sampled_from(["terminated", "truncated", "cut"]),
    mode=MODES,
    cost=st.sampled_from([None, *get_args(Cost)]),
    view=st.sampled_from(["episode", "step"]),
    at_termination=st.sampled_from(get_args(AtTermination)),
    at_truncation=st.sampled_from(get_args(End)),
    bonus=st.sampled_from([0.0, 0.5]),
    penalty=st.sampled_from([0.0, 2.0]),
    entries=st.integers(1, 4),
    samples=st.integers(1, 30),
)
def test_relabel_equals_wrappers(
    values: list[list[float]],
    end: str,
    mode: Mode | None,
    cost: Cost | None,
    view: Any,  # noqa: ANN401
    at_termination: AtTermination,
    at_truncation: End,
    bonus: float,
    penalty: float,
    entries: int,
    samples: int,
) -> None:
    options: dict[str, Any] = {
        "period": 1,
        "cost": cost,
        "view": view,
        "at_termination": at_termination,
        "at_truncation": at_truncation,
    }
    if mode is not None:
        options |= {**shaping_options(mode, *SPECS), "weights": {"calm": 0.25}, "clip": 2.0}
        options |= {"bonus": bonus + (mode == "verdict"), "penalty": penalty}
    rng = np.random.default_rng(len(values))
    # A record without an end is read as cut by a time limit.
    shown = "truncated" if end == "cut" else end
    pairs = [
        record(
            monitored(Replay(series, shown), SPECS, SIGNALS, **options),
            k,
            lambda _: rng.uniform(-1, 1, 1),
        )
        for k, series in enumerate(values)
    ]
    raw = [item for item, _ in pairs]
    if end == "cut":
        for item in raw:
            item["truncations"] = np.zeros_like(item["truncations"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "ENTRIES", entries)
        patch.setattr(module, "SAMPLES", samples)
        result = relabel(raw, SPECS, SIGNALS, **options)
    assert difference(result, [message for _, message in pairs]) == ""
    assert [item.seed for item in result] == list(range(len(values)))


def sampling(env: gym.Env[Any, Any]) -> Callable[[Any], Any]:
    return lambda _: env.action_space.sample()


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.env_id[-12:])
@pytest.mark.parametrize("mode", ["add", "potential"])
def test_relabel_equals_shaped_rewards(case: Any, mode: Mode) -> None:  # noqa: ANN401
    signals = dict(case.signals)
    specs = case.specs
    if "HalfCheetah" in case.env_id:  # a dataset has no simulation to read
        signals |= {"pitch": "obs[1]", "vz": "obs[9]"}
    options: dict[str, Any] = {"mode": mode, "at_termination": "complete", "cost": "latched"}
    pairs = []
    for seed, steps in enumerate((2, 7, 4)):
        env = gym.make(case.env_id, max_episode_steps=steps)
        env.action_space.seed(seed)
        shaped = monitored(env, specs, signals, **options)
        period = shaped.get_wrapper_attr("period")
        pairs.append(record(shaped, seed, sampling(env)))
        env.close()
    raw = [item for item, _ in pairs]
    result = relabel(raw, specs, signals, period=float(period), **options)
    assert difference(result, [message for _, message in pairs]) == ""
    for item, episode in zip(result, raw, strict=True):
        assert np.array_equal(item.actions, episode["actions"])
        assert set(item.infos) >= set(episode["infos"])


def test_callable_signal_gets_equal_steps() -> None:
    def signal(step: Any) -> float:  # noqa: ANN401
        if step.action is None:
            return float(step.obs[0])
        return float(step.obs[0] + step.action[0] * step.reward)

    specs, signals = "always(y < 6)", {"y": signal}
    pairs = [
        record(monitored(Replay(values), specs, signals), 0, lambda _: np.array([0.5]))
        for values in ([1.0, 2.0, 3.0], [5.0, 5.0, 5.0, 5.0])
    ]
    result = relabel([raw for raw, _ in pairs], specs, signals)
    assert difference(result, [message for _, message in pairs]) == ""
    assert [item.satisfied for item in result] == [True, False]


STEPS = 3
OF_PARTS: Any = {
    "observations": ({"x": np.arange(STEPS + 1.0)}, np.array([False, True, False, True])),
    "actions": (np.zeros((STEPS, 1)), np.arange(STEPS)),
    "rewards": np.zeros(STEPS),
    "terminations": np.zeros(STEPS, bool),
    "truncations": np.arange(STEPS) == STEPS - 1,
    "infos": {
        "car": {"speed": np.array([1.0, 2.0, 3.0, 4.0])},
        "late": np.array([np.nan, 1.0, 2.0, 3.0]),
    },
}


@pytest.mark.parametrize(
    ("signal", "nan", "robustness"),
    [
        (lambda step: float(step.obs[0]["x"]) + 10 * float(step.obs[1]), "raise", [3, -8, -8, -10]),
        ((lambda step: float(step.action[1]), 7.0), "raise", [-4] * 4),
        ("info['car']['speed']", "raise", [2, 1, 0, -1]),
        (("info['late']", None), "unknown", [-np.inf] * 4),
    ],
)
def test_nested_observations_and_infos(
    signal: Any,  # noqa: ANN401
    nan: Any,  # noqa: ANN401
    robustness: list[float],
) -> None:
    (result,) = relabel(
        [OF_PARTS], "always(y < 3)", {"y": signal}, nan=nan, details=True, at_truncation="cut"
    )
    assert result.infos["robustness"].tolist() == robustness
    assert result.observations[1].tolist() == [False, True, False, True]
    assert result.actions[1].tolist() == [0, 1, 2]


def test_nan_is_held_as_online() -> None:
    values = [[2.0, np.nan, 0.5, np.nan], [3.0, np.nan, np.nan]]
    pairs = [
        record(monitored(Replay(value), "always(x > 1)", X, nan="hold"), 0, lambda _: np.zeros(1))
        for value in values
    ]
    result = relabel([raw for raw, _ in pairs], "always(x > 1)", X, nan="hold")
    assert difference(result, [message for _, message in pairs]) == ""


def test_the_infos_of_a_reset_are_read_where_they_are() -> None:
    raw, _ = record(monitored(Replay([1.0, 2.0, 3.0]), "always(x > 0)", X), 0, lambda _: [0.0])
    signals = {"s": ("info['s']", 7.0)}
    for entries, first in (([5.0, 1.0, 1.0], 5.0), ([np.nan, 1.0, 1.0], 7.0), ([1.0, 1.0], 7.0)):
        raw["infos"] = {"s": np.array(entries)}
        (result,) = relabel([raw], "always(s > 0)", signals)
        assert result.infos["robustness"].tolist() == [first, 1.0, 1.0]
        if first == 5.0:  # the reset has it
            (result,) = relabel([raw], "always(s > 0)", {"s": "info['s']"})
            assert result.infos["robustness"].tolist() == [first, 1.0, 1.0]
            continue
        with pytest.raises(InputError, match=r"is nan at sample 0|give a first value, "):
            relabel([raw], "always(s > 0)", {"s": "info['s']"})


def test_details_are_those_of_every_specification() -> None:
    env = monitored(Replay([3.0, 2.0, 0.5, 4.0]), SPECS, SIGNALS, period=1, details=True)
    states = [env.reset(seed=0)[1]["stl"]]
    states += [env.step(np.zeros(1))[4]["stl"] for _ in range(3)]
    raw, _ = record(env, 0, lambda _: np.zeros(1))
    (result,) = relabel([raw], SPECS, SIGNALS, period=1, details=True)
    for name in SPECS:
        for key in ("robustness", "lower", "upper"):
            assert result.infos["stl"][name][key].tolist() == [state[name][key] for state in states]


def test_keep_filters_episodes() -> None:
    series = [[3.0, 2.0, 4.0], [3.0, 0.5, 4.0], [4.0, 4.0, 4.0], [2.0, 2.0, 1.5]]
    raw = [record(monitored(Replay(v), "always(x > 1)", X), 0, lambda _: [0.0])[0] for v in series]
    cases: list[tuple[Any, list[int]]] = [
        ("all", [0, 1, 2, 3]),
        ("satisfied", [0, 2, 3]),
        (lambda episode: episode.robustness >= 1, [0, 2]),
        (lambda episode: episode.violated_at == 1, [1]),
        (lambda _: False, []),
    ]
    for keep, numbers in cases:
        result = relabel(iter(raw), "always(x > 1)", X, keep=keep)
        assert [item.number for item in result] == numbers


def test_second_relabelling_uses_own_rewards() -> None:
    series = [[3.0, 2.0, 4.0, 0.5], [3.0, 2.0]]
    raw = [record(monitored(Replay(v), "always(x > 1)", X), 0, lambda _: [0.0])[0] for v in series]
    once = relabel(raw, "always(x > 1)", X, mode="add", weight=3)
    again = relabel(once, "always(x > 1)", X, mode="potential", clip=2)
    direct = relabel(raw, "always(x > 1)", X, mode="potential", clip=2)
    for left, right in zip(again, direct, strict=True):
        assert left.rewards.tolist() == right.rewards.tolist()
        assert left.infos.keys() == right.infos.keys()
        assert all(np.array_equal(left.infos[key], right.infos[key]) for key in left.infos)
    plain = relabel(raw, "always(x > 1)", X)
    assert all(
        np.array_equal(left.rewards, right["rewards"])
        for left, right in zip(plain, raw, strict=True)
    )


def test_the_episodes_given_are_not_changed() -> None:
    raw, _ = record(monitored(Replay([3.0, 0.5, 2.0]), "always(x > 1)", X), 0, lambda _: [0.0])
    before = {key: np.array(value) for key, value in raw.items() if key != "infos"}
    result = relabel([raw], "always(x > 1)", X, mode="add")
    result[0].rewards[:] = 9.0
    result[0].infos["robustness"][:] = 9.0
    assert raw["infos"] == {}
    assert all(np.array_equal(raw[key], value) for key, value in before.items())


def test_relabel_has_every_recorded_option() -> None:
    """A new option of a wrapper is an option here, or is listed as left out."""
    others = {"on_violation", "on_satisfaction", "buffer_length", "mode", "live"}
    others |= {*names_for("runs")} - {*names_for("recorded")}
    others |= {"constants"}  # they change between episodes; a template gives each its specification
    wrappers = {*MonitorOptions.__annotations__, *ShapingOptions.__annotations__}
    assert set(module.OPTIONS) == wrappers - others
