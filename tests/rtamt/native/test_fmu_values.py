"""The library of exported monitors equals the Python monitors bit by bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import golden_cases
import pytest
from bits import bits
from expected_monitors import DenseExpected, Expected
from fmu_calls import (
    DISCARD,
    ERROR,
    FIRST,
    LOWER,
    OK,
    ROBUSTNESS,
    UPPER,
    Unit,
    Version,
    dense,
    sampled,
    unit,
    versions,
    write,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interface_cases import VACUITY, Case, cases
from profiles import examples
from strategies import Trace, formulas, length, sample, traces

from rtamt import (
    Formula,
    InputError,
    SpecificationError,
    Verdict,
    parse,
)
from rtamt.export.program_file import Programs

pytest.importorskip("rtamt._native", reason="no compiler was at hand")


def put(unit: Unit, values: Mapping[str, float]) -> None:
    assert unit.set(range(FIRST, FIRST + len(values)), list(values.values())) == OK


def compare(version: Version, programs: Programs, expected: Expected, trace: Trace) -> None:
    """Compare steps of a period with the monitors, up to a sample that they refuse."""
    named = range(FIRST + len(expected.names), FIRST + len(expected.names) + expected.named)
    with TemporaryDirectory() as folder, unit(version, write(Path(folder), programs)) as made:
        made.begin(2.0)
        assert made.outputs(*named) == bits(expected.values)
        for i in range(length(trace)):
            values = sample(trace, i, expected.names)
            put(made, values)
            try:
                expected.update(values)
            except InputError:
                assert made.step(2.0 + i, 1.0) == ERROR
                assert " is not a number for " in made.said
                return
            assert made.step(2.0 + i, 1.0) == OK
            assert made.outputs(*named) == bits(expected.values)


@versions
@settings(max_examples=examples(30))
@given(part=formulas(2, endless=True), whole=formulas(endless=True), trace=traces())
def test_steps_of_a_period_give_what_the_monitors_give(
    version: Version, part: Formula, whole: Formula, trace: Trace
) -> None:
    first = f"part = {part}"
    second = f"whole = {whole}"
    text = f"{first}\n{second}"
    compare(version, sampled(text), Expected(text, first, second), trace)


@versions
@settings(max_examples=examples(30))
@given(case=cases(VACUITY, endless=True), trace=traces())
def test_what_hangs_on_neutral_predicates_stays_open(
    version: Version, case: Case, trace: Trace
) -> None:
    spec, semantics = case
    programs = sampled(spec, semantics=semantics)
    compare(version, programs, Expected(spec, semantics=semantics), trace)


# Between two samples there are eight eighths of a period, which doubles add up exactly.
@versions
@settings(max_examples=examples(30))
@given(
    formula=formulas(2),
    trace=traces(),
    sizes=st.lists(st.sampled_from((1, 2, 3, 4, 5, 8, 8, 9, 16, 20, 40)), min_size=12, max_size=12),
)
def test_a_step_takes_the_samples_whose_time_has_come(
    version: Version, formula: Formula, trace: Trace, sizes: list[int]
) -> None:
    text = f"part = {formula}"
    expected = Expected(text, text)
    named = [FIRST + len(expected.names)]
    with TemporaryDirectory() as folder, unit(version, write(Path(folder), sampled(text))) as made:
        made.begin(-1.0)
        now = 0
        for i, size in enumerate(sizes[: length(trace)]):
            values = sample(trace, i, expected.names)
            put(made, values)
            assert made.step(now / 8 - 1.0, size / 8) == OK
            for _ in [time for time in range(now, now + size) if time % 8 == 0]:
                expected.update(values)
            now += size
            assert made.outputs(*named) == bits(expected.values)


@versions
@pytest.mark.parametrize(("period", "step"), [(0.1, 0.1), (0.3, 0.1), (0.1, 0.3), (0.01, 0.25)])
def test_the_rounding_of_times_neither_adds_nor_loses_samples(
    version: Version, period: float, step: float, tmp_path: Path
) -> None:
    steps = 3_000
    folder = write(tmp_path, sampled("last = x >= 0", period))
    with unit(version, folder) as made:
        made.begin()
        time, exact, size, every = 0.0, Fraction(0), Fraction(str(step)), Fraction(str(period))
        taken = 0
        for i in range(steps):
            due = math.ceil((exact + size) / every)
            assert made.set([FIRST], [i]) == OK
            assert made.step(time, step) == OK
            if due > taken:
                taken, last = due, float(i)
            assert made.get(FIRST + 1) == [last]
            time += step
            exact += size


@versions
@settings(max_examples=examples(30))
@given(
    formula=formulas(2, endless=True, dense=True),
    root=st.sampled_from(("", "always", "eventually")),
    trace=traces(),
    sizes=st.lists(st.sampled_from((0.25, 0.5, 1.0, 1.75)), min_size=12, max_size=12),
)
def test_over_dense_time_every_step_begins_with_events(
    version: Version, formula: Formula, root: str, trace: Trace, sizes: list[float]
) -> None:
    text = f"whole = {root}({formula})"
    try:
        expected = DenseExpected(text, text)
    except SpecificationError:  # it has no variables
        return
    named = FIRST + len(expected.names)
    with TemporaryDirectory() as folder, unit(version, write(Path(folder), dense(text))) as made:
        made.begin(-1.0)
        assert made.outputs(named) == bits(expected.values)
        time = -1.0
        for i, size in enumerate(sizes[: length(trace)]):
            values = sample(trace, i, expected.names)
            put(made, values)
            try:
                expected.update(time, values)
            except InputError:
                assert made.step(time, size) == ERROR
                return
            assert made.step(time, size) == OK
            assert made.outputs(named) == bits(expected.values)
            time += size


def order(value: float) -> tuple[float, float]:
    """Return a key that orders doubles with -0.0 below 0.0."""
    return value, math.copysign(1.0, value)


@settings(max_examples=examples(60))
@given(
    formula=formulas(2, endless=True, dense=True),
    trace=traces(8),
    sizes=st.lists(st.sampled_from((0.25, 0.5, 1.0)), min_size=12, max_size=12),
)
def test_over_dense_time_bounds_hold_at_every_later_end(
    formula: Formula, trace: Trace, sizes: list[float]
) -> None:
    assume(formula.variables)
    said = []
    with TemporaryDirectory() as folder:
        program = dense(parse(f"{formula}"))
        with unit(3, write(Path(folder), program)) as made:
            made.begin()
            time = 0.0
            for i, size in enumerate(sizes[: length(trace)]):
                put(made, sample(trace, i, formula.variables))
                if made.step(time, size) != OK:
                    break
                time += size
                said.append((*made.get(ROBUSTNESS, LOWER, UPPER), made.verdict()))
    for k, (_, lower, upper, verdict) in enumerate(said):
        for robustness, later_lower, later_upper, _ in said[k:]:
            assert order(lower) <= order(robustness) <= order(upper)
            assert order(lower) <= order(later_lower)
            assert order(later_upper) <= order(upper)
            assert verdict in {0, math.copysign(1.0, robustness)}


def test_over_dense_time_golden_cases_are_met_at_their_instant(tmp_path: Path) -> None:
    for case in golden_cases.cases("dense_instant.json"):
        text = case["formula"]
        names = parse(text).variables
        signals = {name: case["signals"][name] for name in names}
        begin = max(events[0][0] for events in signals.values())
        end = min(events[-1][0] for events in signals.values())
        times = sorted({time for events in signals.values() for time, _ in events})
        with unit(2, write(tmp_path, dense(text))) as made:
            made.begin(begin)
            inside = [time for time in times if begin <= time <= end]
            for time, after in zip(inside, [*inside[1:], end + 1], strict=True):
                now = {name: [v for t, v in signals[name] if t <= time][-1] for name in names}
                put(made, now)
                assert made.step(time, after - time) == OK
            lower, robustness, upper = made.get(LOWER, ROBUSTNESS, UPPER)
            assert lower <= robustness <= upper
            assert robustness == float(case["robustness"])


LIMIT = """
const float limit = 3
const float width = 4
part = x < 2 * limit
whole = always[0:width](x > -limit and limit > 1)
"""


@versions
def test_parameters_are_read_when_initialization_ends(version: Version, tmp_path: Path) -> None:
    folder = write(tmp_path, sampled(LIMIT))
    references = dict(zip(("x", "limit", "width", "part", "whole"), range(8, 13), strict=True))
    with unit(version, folder) as made:
        for limit in (0.5, -0.0, 7.0):
            constants = {"limit": limit + 0.0}
            expected = Expected(parse(LIMIT, constants=constants))
            assert made.set([references["limit"]], [limit]) == OK
            made.begin()
            assert made.get(references["limit"], references["width"]) == [limit + 0.0, 4.0]
            assert math.copysign(1.0, made.get(references["limit"])[0]) == 1.0
            for i, x in enumerate((1.0, -0.25, 6.0)):
                put(made, {"x": x})
                assert made.step(float(i), 1.0) == OK
                expected.update({"x": x})
                assert made.outputs() == bits(expected.values)
                assert made.get(references["part"]) == [2 * limit - x]
            assert made.call("Reset") == OK
            assert made.get(references["limit"]) == [3.0]


@versions
def test_a_violation_ends_the_simulation_if_it_is_to(version: Version, tmp_path: Path) -> None:
    folder = write(tmp_path, sampled("always(x > 0)", 0.5))
    for stop in (False, True):
        with unit(version, folder, logging=True) as made:
            assert made.set_stop(stop) == OK
            made.begin()
            for i, (x, verdict) in enumerate([(1.0, 0), (-2.0, -1), (3.0, -1)]):
                put(made, {"x": x})
                ends = stop and verdict == Verdict.VIOLATED
                assert made.step(i * 0.5, 0.5) == (DISCARD if ends else OK)
                assert made.verdict() == verdict
                if version == 2:
                    assert made.ended() == (ends, 0.5 * (i + 1))
        told = "violated: the simulation is to end at {} s"
        said = [told.format(1), told.format("1.5")] if stop else []
        assert made.log == [(OK, "logEvents", text) for text in said]


@versions
def test_instances_do_not_know_each_other(version: Version, tmp_path: Path) -> None:
    folder = write(tmp_path, sampled("historically(x > 0)"))
    with (
        unit(version, folder) as one,
        unit(version, folder) as other,
        unit(3 if version == 2 else 2, folder) as third,
    ):
        for i, x in enumerate((3.0, 2.0, 1.0)):
            for made, value in ((one, x), (other, 5.0), (third, 10 - x)):
                if i == 0:
                    made.begin()
                put(made, {"x": value})
                assert made.step(float(i), 1.0) == OK
        assert [made.get(ROBUSTNESS)[0] for made in (one, other, third)] == [3.0, 5.0, 7.0]
