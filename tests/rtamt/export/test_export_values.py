"""Start values and parameters of an exported monitor, and what it says when it refuses one."""

import math
from typing import Any

import pytest
from bits import identical
from exported import exported
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from fmpy.fmi2 import fmi2Terminated  # type: ignore[import-untyped]

from rtamt import EpisodeMonitor
from rtamt.export import Fmi

TEXT = (
    "const float gain = 4; const float T = 1; float x = 1.5; float y; once[0:T](x * gain + y > 1)"
)
BOTH = pytest.mark.parametrize("fmi", [2, 3])


class Heard:
    """The last message of a unit, without the call that it begins with."""

    last = ""

    def __call__(self, *arguments: Any) -> None:  # noqa: ANN401 - FMPy calls it
        _, _, self.last = arguments[-1].decode().partition(": ")


@BOTH
def test_inputs_have_the_defaults_of_the_text_until_they_are_set(fmi: Fmi) -> None:
    with exported(TEXT, fmi, period=1) as unit:
        unit.begin()
        unit.step(0, 1, {})
        assert unit.get("x", "y", "robustness") == [1.5, 0.0, 5.0]
        unit.step(1, 1, {"y": 2.0})
        assert unit.get("x", "y", "robustness") == [1.5, 2.0, 5.0]


@BOTH
def test_what_a_new_monitor_says_before_the_first_sample(fmi: Fmi) -> None:
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
def test_a_term_of_constants_that_is_no_number_fails_the_initialization(fmi: Fmi) -> None:
    heard = Heard()
    with exported("const float k = 4; sqrt(k - 1) < x", fmi, heard, period=1) as unit:
        with pytest.raises(FMICallException):
            unit.begin({"k": 0.5})
        assert heard.last == (
            "with these parameters a constant of the specification is not a number: k=0.5"
        )


@BOTH
def test_a_longer_step_takes_several_samples_of_held_inputs(fmi: Fmi) -> None:
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
def test_of_shorter_steps_those_take_a_sample_in_which_one_falls(fmi: Fmi) -> None:
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
