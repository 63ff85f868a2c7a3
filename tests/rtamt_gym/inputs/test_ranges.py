"""Signals and parameters: what they hold, and what they refuse."""

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rtamt import InputError, InputTypeError
from rtamt_gym import Parameter, Signal

THROTTLE = Signal("throttle", 0, 100, points=3, interpolation="linear", duration=30)
GEAR = Parameter("gear", values=[1, 2, math.inf], default=math.inf, unit="1", about="which")


def test_ranges_are_floats_and_equal_those_made_again() -> None:
    assert THROTTLE.columns == ("throttle[0]", "throttle[1]", "throttle[2]")
    assert (type(THROTTLE.high), type(THROTTLE.duration)) == (float, float)
    assert GEAR.columns == ("gear",)
    assert (GEAR.values, GEAR.low, GEAR.high) == ((1.0, 2.0, math.inf), 1.0, math.inf)
    mass = Parameter("mass", np.float64(1), 2, log=True)
    assert (type(mass.low), type(mass.high), mass.default) == (float, float, None)
    for each in (THROTTLE, GEAR, mass):
        assert pickle.loads(pickle.dumps(each)) == each
        assert replace(each) == each
        assert hash(replace(each)) == hash(each)
        assert replace(each, name="other") != each


SIGNAL_ERRORS: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"name": ""}, InputTypeError, "expected the name of a signal, a text, got ''"),
    ({"name": 3}, InputTypeError, "expected the name of a signal, a text, got 3"),
    ({"low": 2}, InputError, "signal 'u': expected low= at most high=, got 2 and 1; swap them"),
    ({"low": math.nan}, InputError, "signal 'u': expected low= as a finite number, got nan"),
    ({"high": math.inf}, InputError, "signal 'u': expected high= as a finite number, got inf"),
    ({"high": "1"}, InputTypeError, "signal 'u': expected high= as a number, got '1'"),
    ({"low": False}, InputTypeError, "signal 'u': expected low= as a number, got False"),
    (
        {"low": -1e308, "high": 1e308},
        InputError,
        "signal 'u': the range from -1e+308 to 1e+308 is too wide for a float",
    ),
    (
        {"points": 0},
        InputError,
        "signal 'u': expected points=1 or more with interpolation='hold', got 0",
    ),
    (
        {"points": 1, "interpolation": "pchip"},
        InputError,
        "signal 'u': expected points=2 or more with interpolation='pchip', got 1",
    ),
    ({"points": 2.0}, InputTypeError, "signal 'u': expected points= as a whole number, got 2.0"),
    (
        {"interpolation": "cubic"},
        InputError,
        "expected interpolation='hold' or 'linear' or 'pchip', got 'cubic'",
    ),
    (
        {"duration": 0},
        InputError,
        "expected duration= as a finite number above 0, got 0",
    ),
]


@pytest.mark.parametrize(("change", "kind", "message"), SIGNAL_ERRORS)
def test_a_signal_says_what_it_expects(
    change: dict[str, Any], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind) as caught:
        Signal(**{"name": "u", "low": 0, "high": 1, "points": 2, **change})
    assert str(caught.value) == message


PARAMETER_ERRORS: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"name": None}, InputTypeError, "expected the name of a parameter, a text, got None"),
    (
        {},
        InputError,
        "parameter 'm': expected low and high, or values=, got neither; write Parameter('m', 0, 1)",
    ),
    ({"low": 1}, InputError, "parameter 'm': expected high= as a finite number, got nan"),
    (
        {"low": 3, "high": 1},
        InputError,
        "parameter 'm': expected low= at most high=, got 3 and 1; swap them",
    ),
    (
        {"low": 0, "high": 1, "log": True},
        InputError,
        "parameter 'm': expected low= above 0 with log=True, got 0",
    ),
    ({"values": ()}, InputError, "parameter 'm': expected at least one value in values=, got none"),
    ({"values": 3}, InputTypeError, "parameter 'm': expected values= as several numbers, got 3"),
    (
        {"values": "12"},
        InputTypeError,
        "parameter 'm': expected values= as several numbers, got '12'",
    ),
    ({"values": (1, "2")}, InputTypeError, "parameter 'm': expected values= as a number, got '2'"),
    ({"values": (1, 2, 1)}, InputError, "parameter 'm': expected different values=, got 1 twice"),
    ({"values": (math.nan,)}, InputError, "parameter 'm': expected values= as a number, got nan"),
    (
        {"low": 0, "high": 1, "values": (1, 2)},
        InputError,
        "parameter 'm': expected low and high, or values=, got both",
    ),
    (
        {"values": (1, 2), "log": True},
        InputError,
        "parameter 'm': log=True is for low and high, got values= as well",
    ),
    (
        {"low": 0, "high": 1, "default": math.nan},
        InputError,
        "parameter 'm': expected default= as a number, got nan",
    ),
]


@pytest.mark.parametrize(("given", "kind", "message"), PARAMETER_ERRORS)
def test_a_parameter_says_what_it_expects(
    given: dict[str, Any], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind) as caught:
        Parameter(**{"name": "m", **given})
    assert str(caught.value) == message
