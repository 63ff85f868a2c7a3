"""Exported units against the monitors, over samples and in dense time."""

import math
import re
from collections.abc import Mapping
from typing import Any, get_args

import pytest
from bits import bits, identical
from expected_monitors import DenseExpected, Expected
from exported import Drawn, Unit, exported, texts
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from fmpy.fmi2 import fmi2Terminated  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_oracle import SEMANTICS
from profiles import examples
from strategies import Trace, length, sample, traces

from rtamt import EpisodeMonitor, InputError, SpecificationError, parse
from rtamt.export.fmu import Fmi, export_fmu
from rtamt.typing import SemanticsName

OUTPUTS = ("robustness", "lower", "upper", "verdict", "part", "whole")


def monitors(
    drawn: Drawn,
    constants: Mapping[str, float] | None = None,
    *,
    period: float = 1,
    semantics: SemanticsName = "standard",
) -> Expected:
    """Return the monitors of a generated specification."""
    full, part = (parse(text, constants=constants) for text in (drawn.text, drawn.part))
    return Expected(full, part, full, period=period, semantics=semantics)


def check_steps(unit: Unit, expected: Expected, trace: Trace, period: float) -> None:
    """Compare every step with the monitors, up to the first sample that they refuse."""
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
def test_parameters_match_recompiled_constants(fmi: Fmi, drawn: Drawn, trace: Trace) -> None:
    try:
        EpisodeMonitor(drawn.text, 1)
    except SpecificationError:  # a constant term is not a number
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
    except SpecificationError:  # a constant term is not a number
        return
    with exported(drawn.text, 2, period=1, semantics=semantics) as unit:
        unit.begin()
        check_steps(unit, expected, trace, 1)


def test_a_sample_is_refused_by_every_formula_or_by_none() -> None:
    # The result does not use the terms of `other`, and would have accepted the sample.
    text = "other = always(eventually(sqrt(y) > 0)); fine = always(eventually(x > 0))"
    with exported(text, 2, period=1) as unit:
        unit.begin()
        unit.step(0, 1, {"x": 1.0, "y": 4.0})
        with pytest.raises(FMICallException):
            unit.step(1, 1, {"x": 2.0, "y": -1.0})
        assert unit.get("other", "fine", "robustness") == [2.0, 1.0, 1.0]
        unit.step(1, 1, {"x": 2.0, "y": 1.0})
        assert unit.get("other", "fine", "robustness") == [1.0, 2.0, 2.0]


@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=examples(25))
@given(
    drawn=texts(dense=True),
    trace=traces(),
    steps=st.lists(st.sampled_from((0.25, 1.0, 1.5, 3.0)), min_size=12, max_size=12),
    semantics=st.just("standard") | st.sampled_from(SEMANTICS),
)
def test_dense_unit_matches_episode_monitor(
    fmi: Fmi, drawn: Drawn, trace: Trace, steps: list[float], semantics: SemanticsName
) -> None:
    try:
        expected = DenseExpected(drawn.text, drawn.part, drawn.text, semantics=semantics)
    except SpecificationError:  # it has no variables, or a constant term is not a number
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
def test_steps_are_in_seconds(unit: str) -> None:
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
    assert [item[0] for item in settled[3:]] == [5.0, 5.0]


KINDS: dict[str, dict[str, Any]] = {"samples": {"period": 1}, "dense": {"dense": True}}


def continued(unit: Unit, trace: Trace, begin: int, names: tuple[str, ...]) -> list[list[int]]:
    """Return the outputs of each step from one on, up to the first refused step."""
    found = []
    for i in range(begin, length(trace)):
        try:
            unit.step(float(i), 1.0, sample(trace, i, names))
        except FMICallException:
            break
        found.append(bits(unit.get(*unit.outputs())))
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=examples(10))
@given(drawn=texts(dense=True), trace=traces(4), step_index=st.integers(0, 4))
def test_a_restored_monitor_goes_on_alike(
    fmi: Fmi, kind: str, drawn: Drawn, trace: Trace, step_index: int
) -> None:
    names = parse(drawn.text).variables
    try:
        with exported(drawn.text, fmi, **KINDS[kind]) as unit:
            unit.begin()
            before = {name: trace[name][:step_index] for name in trace}
            if len(continued(unit, before, 0, names)) < step_index:
                return
            outputs = bits(unit.get(*unit.outputs()))
            state = unit.state()
            once = continued(unit, trace, step_index, names)
            unit.restore(state)
            assert bits(unit.get(*unit.outputs())) == outputs
            assert continued(unit, trace, step_index, names) == once
            with exported(drawn.text, fmi, **KINDS[kind]) as other:
                other.begin()
                other.restore(state)
                assert bits(other.get(*other.outputs())) == outputs
                assert continued(other, trace, step_index, names) == once
    except SpecificationError:  # it has no variables, or a constant term is not a number
        return


TEXT = (
    "const float gain = 4; const float T = 1; float x = 1.5; float y; once[0:T](x * gain + y > 1)"
)
BOTH = pytest.mark.parametrize("fmi", [2, 3])


class Heard:
    """The last message of a unit, without the call at its start."""

    last = ""

    def __call__(self, *arguments: Any) -> None:  # noqa: ANN401 - FMPy calls it
        _, _, self.last = arguments[-1].decode().partition(": ")


@BOTH
def test_input_defaults(fmi: Fmi) -> None:
    with exported(TEXT, fmi, period=1) as unit:
        unit.begin()
        unit.step(0, 1, {})
        assert unit.get("x", "y", "robustness") == [1.5, 0.0, 5.0]
        unit.step(1, 1, {"y": 2.0})
        assert unit.get("x", "y", "robustness") == [1.5, 2.0, 5.0]


@BOTH
def test_outputs_before_the_first_sample(fmi: Fmi) -> None:
    with exported("once(x > 0) and true", fmi, period=1) as unit:
        unit.begin()
        found = unit.get("robustness", "lower", "upper", "verdict")
        assert identical(found, [math.nan, -math.inf, math.inf, 0])
    with exported("const float v = 1; x > 0 or v > 0", fmi, period=1) as unit:
        unit.begin({"v": 3.0})
        assert unit.get("lower", "upper", "verdict") == [3.0, math.inf, 1]
    with exported("const float v = 1; x > 0 or v > 0", fmi, period=1) as unit:
        unit.begin({"v": -3.0})
        assert unit.get("lower", "upper", "verdict") == [-3.0, math.inf, 0]


@BOTH
def test_a_parameter_is_minus_zero_in_no_text(fmi: Fmi) -> None:
    with exported("const float v = 1; v / x > 0", fmi, period=1) as unit:
        unit.begin({"v": -0.0})
        unit.step(0, 1, {"x": 1.0})
        assert identical(unit.get("robustness"), [-0.0])
    with exported("const float v = 1; 1 / v + x > 0", fmi, period=1) as unit:
        unit.begin({"v": -0.0})
        unit.step(0, 1, {"x": 1.0})
        assert identical(unit.get("robustness"), [math.inf])


@BOTH
def test_a_constant_in_a_bound_can_be_read_and_not_set(fmi: Fmi) -> None:
    heard = Heard()
    with exported(TEXT, fmi, heard, period=1) as unit:
        assert unit.get("T") == [1.0]
        with pytest.raises(FMICallException):
            unit.set({"T": 2.0})
        assert heard.last == "expected the value reference of an input or a parameter, got 11"
        unit.begin()
        with pytest.raises(FMICallException):
            unit.set({"gain": 2.0})
        assert heard.last == "the parameter 'gain' can be set until initialization ends"
        assert unit.get("T", "gain") == [1.0, 4.0]


@BOTH
def test_nan_constant_fails_initialization(fmi: Fmi) -> None:
    heard = Heard()
    with exported("const float k = 4; sqrt(k - 1) < x", fmi, heard, period=1) as unit:
        with pytest.raises(FMICallException):
            unit.begin({"k": 0.5})
        assert heard.last == (
            "with these parameters a constant of the specification is not a number: k=0.5"
        )


@BOTH
def test_long_step_holds_inputs(fmi: Fmi) -> None:
    text = "historically[2:2](x > 0) or x > 5"
    episode = EpisodeMonitor(f"always({text})", 0.5)
    with exported(f"always({text})", fmi, period=0.5) as unit:
        unit.begin()
        now = 0.0
        for x, samples in ((6.0, 3), (-1.0, 2), (9.0, 1), (4.0, 7), (-2.0, 4)):
            unit.step(now, samples / 2, {"x": x})
            now += samples / 2
            for _ in range(samples):
                episode.update(x=x)
            found = unit.get("robustness", "lower", "upper", "verdict")
            assert identical(found, [episode.robustness, *episode.bounds(), episode.verdict])


@BOTH
def test_shorter_steps_take_due_samples(fmi: Fmi) -> None:
    with exported("always(x > 0)", fmi, period=1) as unit:
        unit.begin()
        for k, (x, least) in enumerate([(5, 5), (1, 5), (2, 5), (3, 5), (4, 4), (0, 4)]):
            unit.step(k / 4, 0.25, {"x": float(x)})
            assert unit.get("robustness") == [least]


@BOTH
def test_dense_time_ends_at_a_violation_too(fmi: Fmi) -> None:
    with exported("always[0:1](x > 0)", fmi, dense=True, stop_on_violation=True) as unit:
        unit.begin()
        unit.step(0, 0.5, {"x": 1.0})
        ended = False
        try:
            unit.step(0.5, 1, {"x": -1.0})
            answer = unit.fmu.doStep(1.5, 1)
            ended = fmi == 3 and answer[1]
        except FMICallException:
            ended = unit.fmu.getBooleanStatus(fmi2Terminated)
        assert ended
        assert unit.get("robustness", "verdict") == [-1.0, -1]
