"""Exported monitors give what the monitors give, bit by bit."""

import re
from collections.abc import Mapping
from typing import get_args

import pytest
from bits import identical
from expected_monitors import Expected
from exported import Drawn, Unit, exported, texts
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import Trace, length, sample, traces

from rtamt import EpisodeMonitor, InputError, SemanticsName, SpecificationError, export_fmu, parse
from rtamt.export import Fmi

OUTPUTS = ("robustness", "lower", "upper", "verdict", "part", "whole")


def monitors(
    drawn: Drawn,
    constants: Mapping[str, float] | None = None,
    *,
    period: float = 1,
    semantics: SemanticsName = "standard",
) -> Expected:
    """The monitors of a drawn specification."""
    whole, part = (parse(text, constants=constants) for text in (drawn.text, drawn.part))
    return Expected(whole, part, whole, period=period, semantics=semantics)


def check_steps(unit: Unit, expected: Expected, trace: Trace, period: float) -> None:
    """Every step gives what the monitors give, up to the first sample that they refuse."""
    assert unit.outputs() == OUTPUTS
    assert identical(unit.get(*OUTPUTS), expected.values)
    for i in range(length(trace)):
        values = sample(trace, i, expected.names)
        try:
            expected.update(values)
        except InputError:
            with pytest.raises(FMICallException):
                unit.step(i * period, period, values)
            return
        unit.step(i * period, period, values)
        assert identical(unit.get(*OUTPUTS), expected.values)


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=examples(30))
@given(drawn=texts(), trace=traces(), period=st.sampled_from((1.0, 0.5)))
def test_an_exported_monitor_is_the_episode_monitor(
    fmi: Fmi, drawn: Drawn, trace: Trace, period: float
) -> None:
    try:
        expected = monitors(drawn, period=period)
    except SpecificationError as error:
        with pytest.raises(SpecificationError, match=re.escape(str(error).partition("\n")[0])):
            export_fmu(drawn.text, "never.fmu", period=period)
        return
    with exported(drawn.text, fmi, period=period) as unit:
        unit.begin()
        check_steps(unit, expected, trace, period)


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=examples(30))
@given(drawn=texts(), trace=traces())
def test_a_parameter_is_the_constant_of_a_text_that_is_compiled_anew(
    fmi: Fmi, drawn: Drawn, trace: Trace
) -> None:
    try:
        EpisodeMonitor(drawn.text, 1)
    except SpecificationError:  # a constant term that is no number
        return
    with exported(drawn.text, fmi, period=1) as unit:
        others = {name: drawn.others[name] for name in drawn.others if name in unit.entries}
        try:
            expected = monitors(drawn, drawn.others)
        except SpecificationError:
            with pytest.raises(FMICallException):
                unit.begin(others)
            return
        unit.begin(others)
        check_steps(unit, expected, trace, 1)


@pytest.mark.parametrize("semantics", get_args(SemanticsName)[1:])
@settings(max_examples=examples(10))
@given(drawn=texts(), trace=traces())
def test_every_semantics_is_exported(semantics: SemanticsName, drawn: Drawn, trace: Trace) -> None:
    try:
        expected = monitors(drawn, semantics=semantics)
    except SpecificationError:  # a term of constants is no number
        return
    with exported(drawn.text, 2, period=1, semantics=semantics) as unit:
        unit.begin()
        check_steps(unit, expected, trace, 1)


@pytest.mark.parametrize("fmi", [2, 3])
def test_named_formulas_without_an_end_are_judged_as_far_as_the_run_has_come(fmi: Fmi) -> None:
    text = """
    const float limit = 30
    slow = always(speed < limit)
    done = eventually(speed > 20)
    answered = always(speed > 10 implies done)
    out = always(slow) and answered
    """
    with exported(text, fmi, period=1) as unit:
        unit.begin({"limit": 25.0})
        found = []
        for i, speed in enumerate((5.0, 15.0, 22.0, 12.0)):
            unit.step(i, 1, {"speed": speed})
            found.append(unit.get("slow", "done", "answered", "out"))
            assert unit.get("out") == unit.get("robustness")
    assert found == [
        [20.0, -15.0, 5.0, 5.0],
        [10.0, -5.0, -5.0, -5.0],
        [3.0, 2.0, 2.0, 2.0],
        [3.0, 2.0, -2.0, -2.0],
    ]


def test_a_sample_is_refused_by_every_formula_or_by_none() -> None:
    # The terms of `other` are in no formula of the result, which would have taken the sample.
    text = "other = always(eventually(sqrt(y) > 0)); fine = always(eventually(x > 0))"
    with exported(text, 2, period=1) as unit:
        unit.begin()
        unit.step(0, 1, {"x": 1.0, "y": 4.0})
        with pytest.raises(FMICallException):
            unit.step(1, 1, {"x": 2.0, "y": -1.0})
        assert unit.get("other", "fine", "robustness") == [2.0, 1.0, 1.0]
        unit.step(1, 1, {"x": 2.0, "y": 1.0})
        assert unit.get("other", "fine", "robustness") == [1.0, 2.0, 2.0]
