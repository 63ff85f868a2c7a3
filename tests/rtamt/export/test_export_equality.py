"""Exported monitors give what the monitors give, bit by bit."""

import os
import re
from collections.abc import Mapping
from contextlib import suppress
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
from rtamt.program.interface import Semantics


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
        self.monitors = {"part": Monitor(part, period, **options)}
        with suppress(SpecificationError):  # it needs the whole future
            self.monitors["whole"] = Monitor(whole, period, **options)
        self.outputs = ("robustness", "lower", "upper", "verdict", *self.monitors)

    def update(self, values: Mapping[str, float]) -> None:
        monitors: list[Monitor | EpisodeMonitor] = [*self.monitors.values(), self.episode]
        for monitor in monitors:
            monitor.update({name: values[name] for name in monitor.variables})

    @property
    def values(self) -> list[float]:
        episode = self.episode
        named = [monitor.values[name] for name, monitor in self.monitors.items()]
        return [episode.robustness, *episode.bounds(), float(episode.verdict), *named]


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
            export_fmu(drawn.text, os.devnull, period=period)
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
