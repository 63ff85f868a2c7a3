"""A violating input becomes simpler, and still violates."""

import math
from collections.abc import Iterator, Mapping

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt_gym import Case, Parameter, Signal, Space, Waveform, falsify
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.falsification.falsify import reduced

SPACE = Space(
    [
        Signal("push", 0, 100, points=5),
        Signal("wave", -1, 1, points=4, interpolation="linear"),
        Parameter("fault", 0, 10, default=math.inf),
        Parameter("gear", values=(1, 2, 3)),
    ],
    duration=10,
)


def row_of(case: Case) -> Trial:
    return Trial(case, None, {}, "violation", 0.0, 0.0)


@given(st.data())
@settings(max_examples=examples(60))
def test_whatever_violates_the_reduced_case_does_so_and_is_no_larger(data: st.DataObject) -> None:
    point = data.draw(st.lists(st.floats(0, 1), min_size=11, max_size=11))
    case = SPACE.case(point)
    # A violation that is hard to keep: some of the columns, to some digits.
    kept = data.draw(st.sets(st.sampled_from(["push", "wave", "fault", "gear"])))
    digits = data.draw(st.integers(-1, 2))
    times = [0.5, 2.5, 7.0]

    def traits(each: Case) -> list[object]:
        found: list[object] = []
        for name in sorted(kept):
            entry = each[name]
            numbers = entry.at(times).tolist() if isinstance(entry, Waveform) else [entry]
            found.append([round(x, digits) if math.isfinite(x) else x for x in numbers])
        return found

    asked = []

    def again(each: Case) -> Trial | None:
        asked.append(each)
        return row_of(each) if traits(each) == traits(case) else None

    row, count = reduced(row_of(case), SPACE, again, 50)
    assert count == len(asked) <= 50
    assert traits(row.case) == traits(case)
    assert row.case == case or row.case in asked
    assert len(row.case.columns()) <= len(case.columns())
    for entry in SPACE:
        values = row.case[entry.name]
        numbers = values.values if isinstance(values, Waveform) else [values]
        default = getattr(entry, "default", None)
        assert all(entry.low <= x <= entry.high or x == default for x in numbers)
    if "fault" not in kept:
        assert row.case["fault"] == math.inf


def test_points_faults_and_digits_that_do_not_matter_are_gone() -> None:
    case = SPACE.case([0.123456, 0.9, 0.812345, 0.3, 0.4, 0.5, 0.2, 0.7, 0.9, 0.4, 0.9])

    def again(each: Case) -> Trial | None:
        push = each["push"]
        assert isinstance(push, Waveform)
        # It must be above 70 from 4 s to 6 s, and below 20 at the start.
        return row_of(each) if push(4) > 70 and push(5.9) > 70 and push(0) < 20 else None

    row, count = reduced(row_of(case), SPACE, again, 200)
    assert row.case == {
        "push": Waveform([0, 2], [0, 100]),
        "wave": Waveform([0], [0]),
        "fault": math.inf,
        "gear": 3,
    }
    assert count < 40


def test_a_curve_keeps_two_control_points() -> None:
    case = Case({"wave": Waveform([0, 5, 10], [-1, 0.25, 1], "linear")})

    def again(each: Case) -> Trial | None:
        wave = each["wave"]
        assert isinstance(wave, Waveform)
        return row_of(each) if wave(0) <= -1 and wave(10) >= 1 else None

    space = Space([Signal("wave", -1, 1, points=3, interpolation="linear")], duration=10)
    row, _ = reduced(row_of(case), space, again, 200)
    assert row.case == {"wave": Waveform([0, 10], [-1, 1], "linear")}


def heater(push: Waveform, leak: float = 0.0) -> Iterator[Mapping[str, float]]:
    heat = 0.0
    for second in range(20):
        heat += push(second) - leak * heat
        yield {"heat": heat}


def test_a_search_reduces_what_it_finds_unless_told_not_to() -> None:
    space = [
        Signal("push", 0, 1, points=4, duration=20),
        Parameter("leak", 0, 0.5, default=0),
    ]
    found = falsify(heater, "always(heat < 8)", space, period=1, optimizer="random")
    assert found.falsified
    assert len(found.unreduced.columns()) == 5
    assert found.input == {"push": Waveform([0], [found.row.case.columns()["push[0]"]]), "leak": 0}
    assert found.reductions > 0
    assert found.replay().histories["spec"].verdict is rtamt.Verdict.VIOLATED
    assert found.robustness == found.replay().histories["spec"].final
    whole = falsify(heater, "always(heat < 8)", space, period=1, optimizer="random", reduce=False)
    assert whole.input == whole.unreduced == found.unreduced
    assert (whole.reductions, whole.record) == (0, found.record)


def test_what_is_not_found_is_not_reduced() -> None:
    space = [Signal("push", 0, 0.1, points=4, duration=20)]
    closest = falsify(heater, "always(heat < 8)", space, period=1, budget=20)
    assert not closest.falsified
    assert closest.reductions == 0
    assert closest.robustness == min(row.outcomes["spec"].robustness for row in closest.record)
    assert closest.robustness == pytest.approx(6)  # all high is a corner
