"""Definitions of success equal a count by hand, for every end of an episode."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import InputError, InputTypeError
from rtamt_gym.success import (
    READINGS,
    SuccessReading,
    at_rest,
    flag,
    hysteresis,
    one_sided,
    reading,
    readings,
    released,
    within,
)

FLAGS = st.lists(st.integers(0, 1), min_size=1, max_size=12)


def by_hand(name: SuccessReading, flags: list[int], hold: int) -> bool:
    """Return a success by the flags of an episode, without a monitor."""
    runs = [sum(run) for run in _runs(flags)]
    if name == "any":
        return any(flags)
    if name == "last":
        return flags[-1] == 1
    if name == "held":
        return max(runs) > hold
    return runs[-1] > hold


def _runs(flags: list[int]) -> list[list[int]]:
    """Return the runs of ones, or an empty run; the last is at the end."""
    runs: list[list[int]] = [[]]
    for each in flags:
        if each:
            runs[-1].append(1)
        else:
            runs.append([])
    return runs


def satisfied(formula: rtamt.Formula, trace: dict[str, list[Any]], end: rtamt.typing.End) -> bool:
    return rtamt.judge(formula, trace, period=1, end=end).verdict is rtamt.Verdict.SATISFIED


@pytest.mark.parametrize("end", ["complete", "cut"])
@given(flags=FLAGS, hold=st.integers(1, 5))
def test_readings_match_counts(end: rtamt.typing.End, flags: list[int], hold: int) -> None:
    for name, formula in readings("ok", hold).items():
        expected = by_hand(name, flags, hold)  # type: ignore[arg-type]  # a name of them
        judged = rtamt.judge(formula, {"ok": flags}, period=1, end=end)
        assert judged.verdict is not rtamt.Verdict.UNDECIDED
        assert (judged.verdict is rtamt.Verdict.SATISFIED) == expected
        assert abs(judged.robustness) in {0.5, float("inf")}


@given(flags=FLAGS, hold=st.integers(1, 5))
def test_stricter_readings_imply_weaker(flags: list[int], hold: int) -> None:
    any_, last, held, kept = (by_hand(name, flags, hold) for name in READINGS)
    assert kept <= (held and last)
    assert (held or last) <= any_
    trace = {"ok": flags}
    found = [satisfied(each, trace, "complete") for each in readings("ok", hold).values()]
    assert found == [any_, last, held, kept]


@pytest.mark.parametrize("name", READINGS)
def test_readings_can_be_satisfied_and_violated(name: SuccessReading) -> None:
    formula = reading(name, one_sided("angle", at_least=1.0) & at_rest("speed", below=0.1), "300ms")
    good = {"angle": [0.0, 1.0, 1.2, 1.3, 1.3], "speed": [9.0, 0.0, 0.05, 0.0, 0.0]}
    bad = good | {"speed": [9.0, 0.2, 0.3, 0.2, 0.2]}
    verdicts = [rtamt.judge(formula, each, period="100ms").verdict.name for each in (good, bad)]
    assert verdicts == ["SATISFIED", "VIOLATED"]


@given(distances=st.lists(st.sampled_from([0.0, 4.0, 5.0, 6.0, 7.0, 8.0]), min_size=1, max_size=9))
def test_hysteresis_matches_a_switch(distances: list[float]) -> None:
    """A state machine by hand, of a distance and of a height."""
    low, high, on, off = [], [], False, False
    for each in distances:
        on = each <= 7.0 if on else each <= 5.0
        off = -each >= -7.0 if off else -each >= -5.0
        low.append(on)
        high.append(off)
    assert low == high
    near = hysteresis("x", enter=5.0, leave=7.0)
    far = hysteresis("y", enter=-5.0, leave=-7.0)
    trace = {"x": distances, "y": [-each for each in distances]}
    for state in (near, far):
        monitor = rtamt.Monitor(state)
        values = zip(*(trace[name] for name in monitor.variables), strict=True)
        assert [rtamt.holds(monitor.update(*each)) for each in values] == low


def test_hysteresis_bridges_flicker() -> None:
    distances = {"x": [9.0, 4.0, 6.0, 4.0, 6.0]}
    strict = reading("kept", one_sided("x", at_most=5.0), 2)
    bridged = reading("kept", hysteresis("x", enter=5.0, leave=7.0), 2)
    assert not satisfied(strict, distances, "complete")
    assert satisfied(bridged, distances, "complete")


def test_band_and_one_side() -> None:
    angle = {"angle": [0.0, 0.5, 1.0, 1.5, 1.5, 1.5]}
    assert not satisfied(reading("kept", within("angle", 1.0, 0.1), 1), angle, "complete")
    assert satisfied(reading("kept", one_sided("angle", at_least=1.0), 1), angle, "complete")


def test_held_block_is_not_released() -> None:
    at_goal = within("height", 0.2, 0.05)
    trace = {"height": [0.0, 0.2, 0.2, 0.2], "reach": [0.0, 0.0, 0.0, 0.0]}
    assert satisfied(reading("kept", at_goal, 1), trace, "complete")
    put = at_goal & released("reach", at_least=0.03)
    assert not satisfied(reading("kept", put, 1), trace, "complete")
    assert satisfied(reading("kept", put, 1), trace | {"reach": [0.0, 0.0, 0.1, 0.1]}, "complete")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: reading("heald"),  # type: ignore[arg-type]
            "expected name='any', 'last', 'held' or 'kept', got 'heald'; did you mean 'held'?",
        ),
        (lambda: reading("kept", "ok", 0), "expected a time above 0 for hold, got 0"),
        (lambda: reading("kept", "ok", "0ms"), "expected a time above 0 for hold, got '0ms'"),
        (lambda: reading("kept", "ok", float("inf")), "expected a time above 0 for hold, got inf"),
        (lambda: reading("kept", "ok", -1), "expected a bound of at least 0, got -1"),
        (lambda: reading("kept", "ok", "1 hour"), "expected a unit (s, ms, us, ns, ps"),
        (
            lambda: reading("kept", 3),  # type: ignore[arg-type]
            "expected a state, such as one_sided('angle', at_least=1.2), or the name of a flag",
        ),
        (
            lambda: one_sided("x"),
            "expected one side, at_least= or at_most=, got none; a band is within()",
        ),
        (
            lambda: one_sided("x", at_least=1, at_most=2),
            "expected one side, at_least= or at_most=, got both; a band is within()",
        ),
        (
            lambda: hysteresis("x", enter=1, leave=1),
            "expected two numbers as enter= and leave=, got 1 twice; one_sided() has no gap",
        ),
        (lambda: within("x", 1, 0), "expected tolerance= as more than 0, got 0"),
        (lambda: within("x", float("nan"), 1), "expected a number as target=, got nan"),
        (lambda: at_rest("v", below=-1), "expected below= as more than 0, got -1"),
        (lambda: released("d", at_least=0), "expected at_least= as more than 0, got 0"),
        (lambda: released("d", at_least=True), "expected a number as at_least=, got True"),
        (lambda: one_sided("x", at_most="3"), "expected a number as at_most=, got '3'"),  # type: ignore[arg-type]
        (lambda: flag("always"), "'always' is an operator and cannot name a variable"),
    ],
)
def test_success_errors(make: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises((InputError, InputTypeError, rtamt.SpecificationError)) as refused:
        make()
    assert str(refused.value).startswith(message)
