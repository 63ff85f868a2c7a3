"""Exported monitors over dense time give what `DenseMonitor` settles, and bounds of the start."""

import math

import pytest
from bits import identical
from exported import Drawn, exported, texts
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import Trace, length, sample, traces

from rtamt import DenseMonitor, InputError, SpecificationError, parse
from rtamt.export import Fmi

INF = math.inf


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=25)
@given(
    drawn=texts(dense=True),
    trace=traces(),
    steps=st.lists(st.sampled_from((0.25, 1.0, 1.5, 3.0)), min_size=12, max_size=12),
)
def test_a_monitor_over_dense_time_settles_what_the_dense_monitor_does(
    fmi: Fmi, drawn: Drawn, trace: Trace, steps: list[float]
) -> None:
    try:
        dense = DenseMonitor(drawn.text, backend="python")
    except SpecificationError:  # it has no variables, or a term of constants is no number
        return
    now, first, last = 0.0, math.nan, math.nan
    with exported(drawn.text, fmi, dense=True) as unit:
        unit.begin()
        for i in range(length(trace)):
            values = sample(trace, i, dense.variables)
            try:
                given = dense.update({name: [(now, value)] for name, value in values.items()})
            except InputError:
                with pytest.raises(FMICallException):
                    unit.step(now, steps[i], values)
                return
            unit.step(now, steps[i], values)
            now += steps[i]
            if given:
                last = given[-1][1]
                first = given[0][1] if math.isnan(first) else first
            expected = [dense.values["whole"], dense.values["part"]]
            assert identical(unit.get("robustness", "part"), expected)
            assert identical(unit.get("whole"), unit.get("robustness"))
            bounds = [-INF, INF] if math.isnan(first) else bounds_of(drawn.text, first, last)
            assert identical(unit.get("lower", "upper"), bounds)
            signs = [math.copysign(1, bound) for bound in bounds]
            assert unit.get("verdict") == [signs[0] if signs[0] == signs[1] else 0]


def bounds_of(text: str, first: float, last: float) -> list[float]:
    """What the first and the last robustness say of the start."""
    whole = text.splitlines()[-1]
    if whole.startswith("whole = always("):
        return [-INF, last]
    return [last, INF] if whole.startswith("whole = eventually(") else [first, first]


@pytest.mark.parametrize("unit", ["s", "ms"])
def test_steps_are_in_seconds_whatever_the_unit_of_the_text(unit: str) -> None:
    size = {"s": 1.0, "ms": 0.001}[unit]
    spec = parse("eventually[0:2](x > 0)", unit=unit)
    with exported(spec, 2, dense=True) as monitor:
        monitor.begin()
        settled = []
        for i, x in enumerate((-1.0, 5.0, -3.0, -4.0, -2.0)):
            monitor.step(i * size, size, {"x": x})
            settled.append(monitor.get("robustness")[0])
    assert identical(settled, [math.nan, math.nan, math.nan, 5.0, 5.0])


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
