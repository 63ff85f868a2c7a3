"""Laws of the pure functions from robustness to reward, on floats and on arrays."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtamt.errors import InputError
from rtamt_gym import shaping
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.shaping import Mode, Priority, Shaping
from rtamt_gym.wrappers.observing import StateFeatures, time_left

MODES: tuple[Mode, ...] = get_args(Mode)

unit = st.floats(-1.0, 1.0)
several = st.lists(unit, min_size=1, max_size=4)
temperatures = st.sampled_from([0.01, 0.1, 1.0, 10.0])


@given(several, temperatures)
def test_the_smooth_minimum_is_below_the_minimum_by_a_known_margin(
    values: list[float], temperature: float
) -> None:
    smooth = shaping.least(values, temperature)
    margin = temperature * math.log(len(values))
    assert min(values) - margin - 1e-12 <= smooth <= min(values)


@given(unit, temperatures)
def test_the_smooth_minimum_of_one_value_is_the_value(value: float, temperature: float) -> None:
    assert shaping.least([value], temperature) == value


@given(st.lists(st.sampled_from([-0.5, -0.0, 0.0, 0.5, 2.0]), min_size=1, max_size=4))
def test_the_minimum_tells_the_zeros_apart(values: list[float]) -> None:
    lowest = min(values, key=lambda value: (value, math.copysign(1.0, value)))
    entries = shaping.least([np.array([value, 3.0]) for value in values])
    for result in (shaping.least(values), entries[0]):
        assert (result, math.copysign(1.0, result)) == (lowest, math.copysign(1.0, lowest))
    assert entries[1] == 3.0


class Traced:
    """An array without numbers, as in JAX while it compiles a function."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __array_namespace__(self) -> Any:
        def function(name: str) -> Callable[..., Traced]:
            return lambda *args: Traced(f"{name}({', '.join(str(a) for a in args)})")

        names = ("minimum", "logical_or", "signbit", "where")
        return SimpleNamespace(**{name: function(name) for name in names})

    def __str__(self) -> str:
        return self.text

    def __eq__(self, other: object) -> Any:
        return Traced(f"({self} == {other})")

    __hash__ = None  # type: ignore[assignment] # as arrays have none

    def __and__(self, other: Traced) -> Traced:
        return Traced(f"({self} & {other})")

    def all(self) -> Traced:
        return Traced(f"all({self})")

    def __bool__(self) -> bool:
        raise TypeError(f"{self} is not known yet")


def test_the_minimum_of_arrays_without_numbers_looks_at_none_of_them() -> None:
    result: Any = shaping.least([cast("Any", Traced(name)) for name in "ab"])
    assert str(result) == (
        "where(((minimum(a, b) == 0.0) & logical_or(signbit(a), signbit(b))), -0.0, minimum(a, b))"
    )


def test_arrays_are_computed_by_their_own_library(monkeypatch: pytest.MonkeyPatch) -> None:
    def library(name: str) -> Any:
        return SimpleNamespace(clip=lambda array, low, high: (name, array, low, high))

    standard: Any = SimpleNamespace(__array_namespace__=lambda: library("of the array"))
    assert shaping.clip(standard, 2.0) == ("of the array", standard, -2.0, 2.0)
    monkeypatch.setitem(sys.modules, "torch", library("torch"))
    tensor: Any = SimpleNamespace()  # torch has no __array_namespace__
    assert shaping.clip(tensor, 2.0) == ("torch", tensor, -2.0, 2.0)


def test_the_smooth_minimum_neither_overflows_nor_underflows() -> None:
    assert shaping.least([-1e300, 1e300], 1e-3) == -1e300
    assert shaping.least([np.array([-1e300]), np.array([1e300])], 1e-3) == -1e300


def test_every_value_moves_the_smooth_minimum() -> None:
    low, high = shaping.least([0.0, 1.0], 0.5), shaping.least([0.0, 2.0], 0.5)
    assert low < high < 0.0


@given(st.lists(unit, min_size=2, max_size=2), st.lists(unit, min_size=2, max_size=2), unit, unit)
def test_who_violates_a_level_is_below_all_who_violate_only_later_ones(
    left: list[float], right: list[float], bad: float, good: float
) -> None:
    bad, good = -abs(bad) - 1e-9, abs(good)
    for rank in range(3):
        # Both satisfy the levels before; then one violates this level, the other does not.
        before = [abs(x) for x in left][:rank]
        after = 2 - rank
        worse = shaping.hierarchical([*before, max(bad, -1.0), *left[:after]], 1.0)
        better = shaping.hierarchical([*before, good, *right[:after]], 1.0)
        assert worse < better


@given(several, st.integers(0, 3), unit)
def test_the_hierarchy_never_falls_when_a_level_rises(
    levels: list[float], index: int, other: float
) -> None:
    index %= len(levels)
    low, high = (
        shaping.hierarchical([*levels[:index], x, *levels[index + 1 :]], 1.0)
        for x in sorted((levels[index], other))
    )
    assert low <= high


@given(several)
def test_the_hierarchy_is_negative_where_safety_is(levels: list[float]) -> None:
    assert (shaping.hierarchical(levels, 1.0) < 0.0) == (levels[0] < 0.0)


def test_the_hierarchy_of_one_level_is_the_level() -> None:
    assert [shaping.hierarchical([x], 1.0) for x in (-0.5, 0.0, 0.5)] == [-0.5, 0.0, 0.5]


@pytest.mark.parametrize("many", [False, True])
def test_combinations_keep_the_sign_of_a_zero(many: bool) -> None:  # noqa: FBT001
    def value(number: float) -> Any:
        return np.array([number]) if many else number

    def sign(number: Any) -> bool:
        return bool(np.signbit(number).all())

    for zeros in ([0.0, -0.0], [-0.0, 0.0], [1.0, -0.0], [-0.0, math.inf]):
        assert sign(shaping.least([value(z) for z in zeros]))
    for zeros in ([0.0, 0.0], [0.0, 1.0], [0.0]):
        assert not sign(shaping.least([value(z) for z in zeros]))
    assert sign(shaping.hierarchical([value(-0.0), value(1.0)], 1.0))
    assert shaping.hierarchical([value(-0.0), value(1.0)], 1.0) == 0.0
    assert shaping.hierarchical([value(0.0), value(-0.0), value(1.0)], 1.0) == 1.0
    assert shaping.hierarchical([value(0.0), value(0.0), value(0.5)], 1.0) == 2.5
    assert sign(shaping.hierarchical([value(-0.0)], 1.0))
    assert not sign(shaping.hierarchical([value(0.0)], 1.0))


def test_a_potential_pays_the_discounted_ends_alone() -> None:
    x, gamma = [0.5, -0.25, 1.0, 0.75], 0.5
    shape = Shaping.of("a", mode="potential", weight=2.0, gamma=gamma)

    def paid(*, terminated: bool) -> float:
        return sum(
            gamma**t * shape.reward(0.0, a, b, terminated=terminated and t == 2, ended=t == 2)
            for t, (a, b) in enumerate(pairwise(x))
        )

    assert paid(terminated=True) == -2.0 * x[0]
    assert paid(terminated=False) == 2.0 * (gamma**3 * x[-1] - x[0])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("temperature", [None, 0.5])
def test_arrays_are_floats_environment_by_environment(
    mode: Mode, temperature: float | None
) -> None:
    rng = np.random.default_rng(1)
    names = ["a", "b", "c"]
    priorities: dict[str, Priority] = {"a": "comfort", "b": "safety", "c": "safety"}
    shape = Shaping.of(
        names,
        mode=mode,
        weight=3.0,
        clip=2.0,
        gamma=0.9,
        temperature=temperature,
        weights={"b": 0.5},
        priorities=priorities if mode == "hierarchical" else None,
        bonus=1.0,
    )
    entries = 64
    before, after = rng.normal(scale=3.0, size=(2, 3, entries))
    after[rng.random(after.shape) < 0.2] = math.inf
    before[rng.random(before.shape) < 0.2] = -math.inf
    reward = rng.normal(size=entries)
    terminated = rng.random(entries) < 0.3
    ended = terminated | (rng.random(entries) < 0.3)
    x, x_after = shape.robustness(list(before)), shape.robustness(list(after))
    result = shape.reward(
        reward, x, x_after, terminated.astype(np.float64), ended.astype(np.float64)
    )
    for i in range(entries):
        one = shape.robustness(before[:, i].tolist()), shape.robustness(after[:, i].tolist())
        # exp and log of NumPy may differ from math in the last digit.
        assert (x[i], x_after[i]) == pytest.approx(one, rel=1e-12)
        expected = shape.reward(float(reward[i]), *one, bool(terminated[i]), bool(ended[i]))
        assert result[i] == pytest.approx(expected, rel=1e-12)
        assert np.isfinite(expected)


@given(st.lists(st.floats(allow_nan=False), min_size=3, max_size=3), temperatures)
def test_the_robustness_of_a_reward_is_within_the_clip(
    values: list[float], temperature: float
) -> None:
    shape = Shaping.of("abc", mode="add", clip=0.5, temperature=temperature)
    assert -0.5 <= shape.robustness(values) <= 0.5


def test_specifications_of_one_priority_count_as_their_minimum() -> None:
    shape = Shaping.of(
        ["gentle", "near", "wall", "speed"],
        mode="hierarchical",
        priorities={"wall": "safety", "near": "target", "gentle": "comfort", "speed": "safety"},
    )
    assert shape.levels == ((2, 3), (1,), (0,))
    assert shape.robustness([1.0, 1.0, 0.5, -0.25]) == -0.25
    assert shape.robustness([1.0, -1.0, 0.5, 0.25]) == 0.0
    assert shape.robustness([0.5, 1.0, 0.5, 0.25]) == 2.5


def test_a_level_that_no_specification_has_is_no_level() -> None:
    shape = Shaping.of("ab", mode="hierarchical", priorities={"a": "comfort", "b": "safety"})
    assert shape.levels == ((1,), (0,))


def test_what_is_not_told_weighs_1() -> None:
    shape = Shaping.of("ab", mode="add")
    assert (shape.weight, shape.clip, shape.weights) == (1.0, 1.0, (1.0, 1.0))


def test_a_bonus_or_a_penalty_settles() -> None:
    assert not Shaping.of("a", mode="add").settles
    assert Shaping.of("a", mode="add", bonus=0.5).settles
    assert Shaping.of("a", mode="add", penalty=0.5).settles


def test_every_specification_has_one_value() -> None:
    shape = Shaping.of("ab", mode="add")
    for combined in (shape.robustness, shape.deciding):
        for values in ([1.0], [1.0, 2.0, 3.0]):
            with pytest.raises(ValueError, match=r"zip\(\) argument 2 is"):
                combined(values)


def test_weights_make_units_comparable() -> None:
    shape = Shaping.of(["angle", "place"], mode="add", weights={"angle": 10.0})
    assert shape.robustness([0.05, 0.6]) == 0.5
    assert shape.robustness([0.08, 0.6]) == 0.6
    assert shape.robustness([0.2, 1.5]) == 1.0  # the clip, by default


@pytest.mark.parametrize(
    ("horizon", "expected"), [(None, [1.0, 1.0, 1.0]), (4, [1.0, 0.25, 0.0]), (0, [0.0, 0.0, 0.0])]
)
def test_time_left_is_a_fraction_of_the_horizon(horizon: int | None, expected: list[float]) -> None:
    assert [time_left(sample, horizon) for sample in (0.0, 3.0, 9.0)] == expected
    assert time_left(np.array([0.0, 3.0, 9.0]), horizon).tolist() == expected


def test_features_of_environments_are_those_of_each() -> None:
    state = StateFeatures((1.0, 0.5), 2.0, (None, 9))
    rng = np.random.default_rng(2)
    now, low, high = rng.normal(scale=3.0, size=(3, 2, 5))
    samples = rng.integers(1, 12, 5)
    verdicts = rng.integers(-1, 2, (2, 5)).astype(float)
    entries = state.read(
        MonitorValues(list(now), [], list(low), list(high), list(verdicts), samples)
    )
    assert entries.shape == (5, 10)
    assert entries.dtype == np.float32
    for i in range(5):
        one = [column[:, i].tolist() for column in (now, low, high)]
        decided = verdicts[:, i].tolist()
        values = MonitorValues(one[0], [], one[1], one[2], decided, int(samples[i]))
        assert np.array_equal(entries[i], state.read(values))


def test_priorities_are_asked_for_by_the_names_of_the_specifications() -> None:
    with pytest.raises(InputError) as caught:
        Shaping.of("abcd", mode="hierarchical")
    asked = str(caught.value).partition("such as priorities=")[2]
    assert asked == '{"a": "safety", "b": "target", "c": "comfort", "d": "comfort"}'
    given = json.loads(asked)
    assert Shaping.of("abcd", mode="hierarchical", priorities=given).levels == ((0,), (1,), (2, 3))
