"""Exported monitors give what the monitors give, bit by bit."""

import math
import re
from collections.abc import Mapping
from typing import Any, get_args

import pytest
from bits import identical
from exported import Drawn, Unit, exported, texts
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import Trace, length, sample, traces

from rtamt import (
    EpisodeMonitor,
    InputError,
    Monitor,
    SpecificationError,
    export_fmu,
    parse,
)
from rtamt.export import Fmi
from rtamt.monitors.options import Spec
from rtamt.program.interface import Semantics


def judge(spec: Spec, period: float, **options: Any) -> Monitor | EpisodeMonitor:  # noqa: ANN401
    """What judges a named formula: a monitor, or the one of episodes if none can wait for it."""
    try:
        return Monitor(spec, period, **options)
    except SpecificationError:
        return EpisodeMonitor(spec, period, **options)


class Expected:
    """The monitors of a specification, in Python."""

    def __init__(
        self,
        drawn: Drawn,
        period: float,
        constants: Mapping[str, float] | None = None,
        semantics: Semantics = "standard",
    ) -> None:
        whole, part = (parse(text, constants=constants) for text in (drawn.text, drawn.part))
        options: Any = {"semantics": semantics, "backend": "python"}
        self.episode = EpisodeMonitor(whole, period, **options)
        named = {"part": part, "whole": whole}
        self.monitors = {name: judge(spec, period, **options) for name, spec in named.items()}
        self.named = [math.nan] * len(self.monitors)
        self.outputs = ("robustness", "lower", "upper", "verdict", *self.monitors)

    def update(self, values: Mapping[str, float]) -> None:
        self.named = [
            monitor.update({name: values[name] for name in monitor.variables})
            for monitor in self.monitors.values()
        ]
        self.episode.update({name: values[name] for name in self.episode.variables})

    @property
    def values(self) -> list[float]:
        episode = self.episode
        return [episode.robustness, *episode.bounds(), float(episode.verdict), *self.named]


def check_steps(unit: Unit, expected: Expected, trace: Trace, period: float) -> None:
    """Every step gives what the monitors give, up to the first sample that they refuse."""
    assert unit.outputs() == expected.outputs
    assert identical(unit.get(*expected.outputs), expected.values)
    for i in range(length(trace)):
        values = sample(trace, i, expected.episode.variables)
        try:
            expected.update(values)
        except InputError:
            with pytest.raises(FMICallException):
                unit.step(i * period, period, values)
            return
        unit.step(i * period, period, values)
        assert identical(unit.get(*expected.outputs), expected.values)


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=30)
@given(drawn=texts(), trace=traces(), period=st.sampled_from((1.0, 0.5)))
def test_an_exported_monitor_is_the_episode_monitor(
    fmi: Fmi, drawn: Drawn, trace: Trace, period: float
) -> None:
    try:
        expected = Expected(drawn, period)
    except SpecificationError as error:
        with pytest.raises(SpecificationError, match=re.escape(str(error).partition("\n")[0])):
            export_fmu(drawn.text, "never.fmu", period=period)
        return
    with exported(drawn.text, fmi, period=period) as unit:
        unit.begin()
        check_steps(unit, expected, trace, period)


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=30)
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
            expected = Expected(drawn, 1, drawn.others)
        except SpecificationError:
            with pytest.raises(FMICallException):
                unit.begin(others)
            return
        unit.begin(others)
        check_steps(unit, expected, trace, 1)


@pytest.mark.parametrize("semantics", get_args(Semantics)[1:])
@settings(max_examples=10)
@given(drawn=texts(), trace=traces())
def test_every_semantics_is_exported(semantics: Semantics, drawn: Drawn, trace: Trace) -> None:
    try:
        expected = Expected(drawn, 1, semantics=semantics)
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
