"""Exported monitors over dense time give what `DenseEpisodeMonitor` gives, bit by bit."""

import math

import pytest
from bits import identical
from expected_monitors import DenseExpected
from exported import Drawn, exported, texts
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_oracle import SEMANTICS
from profiles import examples
from strategies import Trace, length, sample, traces

from rtamt import DenseMonitor, InputError, SemanticsName, SpecificationError, parse
from rtamt.export import Fmi

OUTPUTS = ("robustness", "lower", "upper", "verdict", "part", "whole")


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=examples(25))
@given(
    drawn=texts(dense=True),
    trace=traces(),
    steps=st.lists(st.sampled_from((0.25, 1.0, 1.5, 3.0)), min_size=12, max_size=12),
    semantics=st.just("standard") | st.sampled_from(SEMANTICS),
)
def test_a_monitor_over_dense_time_is_the_dense_episode_monitor(
    fmi: Fmi, drawn: Drawn, trace: Trace, steps: list[float], semantics: SemanticsName
) -> None:
    try:
        expected = DenseExpected(drawn.text, drawn.part, drawn.text, semantics=semantics)
    except SpecificationError:  # it has no variables, or a term of constants is no number
        return
    now = 0.0
    with exported(drawn.text, fmi, dense=True, semantics=semantics) as unit:
        unit.begin()
        assert unit.outputs() == OUTPUTS
        assert identical(unit.get(*OUTPUTS), expected.values)
        for i in range(length(trace)):
            values = sample(trace, i, expected.names)
            try:
                expected.update(now, values)
            except InputError:
                with pytest.raises(FMICallException):
                    unit.step(now, steps[i], values)
                return
            unit.step(now, steps[i], values)
            assert identical(unit.get(*OUTPUTS), expected.values)
            now += steps[i]


@pytest.mark.parametrize("unit", ["s", "ms"])
def test_steps_are_in_seconds_whatever_the_unit_of_the_text(unit: str) -> None:
    size = {"s": 1.0, "ms": 0.001}[unit]
    spec = parse("out = eventually[0:2](x > 0)", unit=unit)
    with exported(spec, 2, dense=True) as monitor:
        monitor.begin()
        settled = []
        for i, x in enumerate((-1.0, 5.0, -3.0, -4.0, -2.0)):
            monitor.step(i * size, size, {"x": x})
            settled.append(monitor.get("out", "robustness", "upper", "verdict"))
    nan, inf = math.nan, math.inf
    assert identical(settled[0], [nan, -1.0, inf, 0.0])
    assert identical(settled[1], [nan, 5.0, inf, 1.0])
    assert identical(settled[2], [nan, 5.0, 5.0, 1.0])
    assert [each[0] for each in settled[3:]] == [5.0, 5.0]


def test_a_named_formula_over_the_whole_trace_has_what_is_known_so_far() -> None:
    text = (
        "low = always(x < 5); seen = eventually[0:1](x > 2); done = eventually(seen); once(x > 3)"
    )
    parts = {
        "low": "always(x < 5)",
        "seen": "eventually[0:1](x > 2)",
        "done": "eventually(eventually[0:1](x > 2))",
    }
    monitors = {name: DenseMonitor(f"{name} = {part}") for name, part in parts.items()}
    with exported(text, 2, dense=True) as unit:
        unit.begin()
        for i, x in enumerate((1.0, 4.0, 3.0, 2.0, 1.0)):
            for monitor in monitors.values():
                monitor.update({"x": [(float(i), x)]})
            unit.step(i, 1, {"x": x})
            expected = [monitor.values[name] for name, monitor in monitors.items()]
            assert identical(unit.get(*parts), expected)
        assert unit.get(*parts) == [1.0, 1.0, 2.0]


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_no_monitor_can_wait_for_is_as_if_the_run_ended_now(fmi: Fmi) -> None:
    text = "done = always(x > 0 implies eventually(y > 0)); near = once[0:1](x > 0); done and near"
    steps = ((0.0, 1.0, -1.0), (2.0, 1.0, -2.0), (3.0, -1.0, 4.0), (3.5, 1.0, -3.0))
    with exported(text, fmi, dense=True) as unit:
        assert unit.entries["done"].description.endswith("as if the run ended now")
        unit.begin()
        found = []
        for time, x, y in steps:
            unit.step(time, {0.0: 2.0, 2.0: 1.0}.get(time, 0.5), {"x": x, "y": y})
            found.append(unit.get("done", "near", "robustness"))
    assert [each[0] for each in found] == [-1.0, -1.0, 4.0, -1.0]
    assert identical(found[0][1:], [math.nan, -1.0])
    assert found[3][1:] == [1.0, -1.0]
