"""Ranges, spaces and cases: points, JSON and errors."""

import json
import math
import pickle
from dataclasses import replace
from typing import Any, cast, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtamt import InputError, InputTypeError
from rtamt_gym import Case, Parameter, Signal, Space, Waveform
from rtamt_gym.inputs.case import LEAST_POINTS, WaveformInterpolation

lows = st.floats(-1e6, 1e6)
ranges = st.tuples(lows, st.just(0.0) | st.floats(1e-6, 1e6)).map(lambda r: (r[0], r[0] + r[1]))


@st.composite
def spaces(draw: st.DrawFn) -> Space:
    """Spaces of signals and parameters of every kind."""
    entries: list[Signal | Parameter] = []
    for i in range(draw(st.integers(1, 4))):
        low, high = draw(ranges)
        match draw(st.sampled_from([*get_args(WaveformInterpolation), "number", "log", "values"])):
            case "number":
                entries.append(Parameter(f"x{i}", low, high))
            case "log":
                entries.append(
                    Parameter(f"x{i}", 1 + abs(low), 1 + abs(low) + high - low, log=True)
                )
            case "values":
                values = draw(st.lists(st.floats(allow_nan=False), min_size=1, unique=True))
                entries.append(Parameter(f"x{i}", values=values))
            case kind:
                points = draw(st.integers(LEAST_POINTS[kind], 5))
                duration = draw(st.none() | st.floats(0.1, 100))
                signal = Signal(f"x{i}", low, high, points=points, duration=duration)
                entries.append(replace(signal, interpolation=kind))
    return Space(entries, duration=draw(st.floats(0.1, 100)))


@given(spaces(), st.data())
def test_points_and_cases_round_trip(space: Space, data: st.DataObject) -> None:
    point = [data.draw(st.floats(0, 1)) for _ in range(space.dimension)]
    case = space.case(point)
    assert tuple(case.columns()) == space.columns
    for each in space:
        entry = case[each.name]
        values = entry.values if isinstance(entry, Waveform) else [entry]
        assert all(each.low <= value <= each.high for value in values)
        if isinstance(each, Parameter) and each.values is not None:
            assert entry in each.values
    again = space.case(space.point(case))
    assert list(again) == list(case)
    for column, value in again.columns().items():
        assert math.isclose(value, case.columns()[column], rel_tol=1e-9, abs_tol=1e-9) or (
            value == case.columns()[column]
        )


@given(spaces(), st.sampled_from([0.0, 1.0]))
def test_points_reach_the_ends_of_ranges(space: Space, end: float) -> None:
    columns = iter(space.case(np.full(space.dimension, end)).columns().values())
    for each in space:
        for _ in each.columns:
            if isinstance(each, Parameter) and each.values is not None:
                assert next(columns) == each.values[0 if end == 0 else -1]
            else:
                assert next(columns) == (each.low if end == 0 else each.high)


def test_coordinates_are_even() -> None:
    space = Space(
        {
            "u": Signal("u", -1, 1, points=2, interpolation="pchip"),
            "k": Parameter("k", 1e-3, 1e3, log=True),
            "mode": Parameter("mode", values=(7, 8, math.inf)),
        },
        duration=10,
    )
    assert space.dimension == 4
    case = space.case([0.25, 0.75, 0.5, 0.4])
    assert case["u"] == Waveform([0, 10], [-0.5, 0.5], "pchip")
    assert case["k"] == pytest.approx(1, rel=1e-15)
    assert [space.case([0, 0, 0, x])["mode"] for x in (0, 0.33, 0.34, 0.67, 1)] == [
        *(7, 7, 8, math.inf, math.inf)
    ]
    assert space.point(case) == pytest.approx([0.25, 0.75, 0.5, 0.5])


@given(spaces())
def test_equal_spaces(space: Space) -> None:
    for again in (pickle.loads(pickle.dumps(space)), Space(space, duration=space.duration)):
        assert again == space
        assert hash(again) == hash(space)
    assert Space(space, duration=101) != space
    assert space != list(space)


def test_control_points_divide_the_duration() -> None:
    def times(**options: Any) -> object:  # noqa: ANN401 - of a signal
        space = Space([Signal("u", 0, 1, **options)], duration=0.7)
        waveform = space.case([0.5] * space.dimension)["u"]
        return waveform.times if isinstance(waveform, Waveform) else None

    assert times(points=7) == (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    assert times(points=8, interpolation="linear") == (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    assert times(points=2, duration=10) == (0.0, 5.0)


SPACE_ERRORS: list[tuple[Any, type[Exception], str]] = [
    (
        [Parameter("m", 1, 2), Signal("m", 0, 1, points=1)],
        InputError,
        "expected entries of different names, got 'm' twice",
    ),
    (
        [Parameter("m[0]", 1, 2), Signal("m", 0, 1, points=1)],
        InputError,
        "expected columns of different names, got 'm[0]' twice",
    ),
    (
        {"mass": Parameter("m", 1, 2)},
        InputError,
        "expected 'm' by its own name, got it as 'mass'",
    ),
    ([], InputError, "expected at least one signal or parameter, got none"),
    (
        {"m": (1, 2)},
        InputTypeError,
        (
            "expected signals and parameters, got (1, 2) among them; write "
            "Signal('throttle', 0, 100, points=7) or Parameter('mass', 1, 2)"
        ),
    ),
    (
        3,
        InputTypeError,
        "expected several signals and parameters, such as [Parameter('mass', 1, 2)], got 3",
    ),
]


@pytest.mark.parametrize(("entries", "kind", "message"), SPACE_ERRORS)
def test_space_errors(entries: object, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as caught:
        Space(cast("Any", entries))
    assert str(caught.value) == message


U = Waveform([0, 5], [0, 1])

CASE_OF_SPACE_ERRORS: list[tuple[dict[str, Any], str]] = [
    ({"u": U}, "expected a case of 'u', 'k', 'mode', got 'u'"),
    (
        {"u": U, "k": 1, "mode": 1, "more": 1},
        "expected a case of 'u', 'k', 'mode', got 'u', 'k', 'mode', 'more'",
    ),
    ({"u": U, "k": 3, "mode": 1}, "expected 'k' of a case from 1 to 2, got 3"),
    ({"u": U, "k": U, "mode": 1}, f"expected 'k' of a case as a number, got {U!r}"),
    ({"u": U, "k": 1, "mode": 3}, "expected 'mode' of a case among 1.0, 2.0, got 3"),
    (
        {"u": Waveform([0, 5], [0, 2]), "k": 1, "mode": 1},
        "expected 'u' of a case from 0 to 1, got 2",
    ),
    (
        {"u": 1.0, "k": 1, "mode": 1},
        (
            "expected 'u' of a case as a waveform of interpolation 'hold' and times (0.0, 5.0), "
            "got 1.0"
        ),
    ),
    (
        {"u": Waveform([0, 5], [0, 1], "linear"), "k": 1, "mode": 1},
        (
            "expected 'u' of a case as a waveform of interpolation 'hold' and times (0.0, 5.0), "
            "got Waveform(times=(0.0, 5.0), values=(0.0, 1.0), interpolation='linear')"
        ),
    ),
]

SMALL = Space(
    [Signal("u", 0, 1, points=2), Parameter("k", 1, 2), Parameter("mode", values=(1, 2))],
    duration=10,
)


@pytest.mark.parametrize(("case", "message"), CASE_OF_SPACE_ERRORS)
def test_case_of_another_space_error(case: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        SMALL.point(case)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ([0, 0, 0], "expected a point of shape (4,), got shape (3,)"),
        ([0, 0, 1.5, 0], "expected 'k' of a point from 0 to 1, got 1.5"),
        ([0, np.nan, 1, 0], "expected 'u[1]' of a point from 0 to 1, got nan"),
    ],
)
def test_point_outside_the_cube_error(point: list[float], message: str) -> None:
    with pytest.raises(InputError) as caught:
        SMALL.case(point)
    assert str(caught.value) == message


def test_point_without_numbers_error() -> None:
    with pytest.raises(InputTypeError) as caught:
        SMALL.case(cast("Any", ["u", 0, 0, 0]))
    assert str(caught.value) == "expected a point as 4 numbers, got ['u', 0, 0, 0]"


def test_missing_duration_error() -> None:
    with pytest.raises(InputError) as caught:
        Space([Signal("u", 0, 1, points=2)]).case([0, 0])
    assert str(caught.value) == (
        "signal 'u' has no duration; write Signal('u', ..., duration=30) or "
        "Space(..., duration=30), in seconds"
    )


@given(spaces(), st.data())
def test_equal_cases(space: Space, data: st.DataObject) -> None:
    case = space.case([data.draw(st.floats(0, 1)) for _ in range(space.dimension)])
    text = case.to_json()
    json.loads(text, parse_constant=pytest.fail)
    for again in (Case.from_json(text), pickle.loads(pickle.dumps(case)), Case(case)):
        assert again == case
        assert list(again) == list(case)
        assert hash(again) == hash(case)
    assert Case({**case, "more": 1}) != case


def test_repr_of_case() -> None:
    assert repr(Case({"mass": 1, "u": U})) == (
        "Case({'mass': 1.0, 'u': Waveform(times=(0.0, 5.0), values=(0.0, 1.0), "
        "interpolation='hold')})"
    )


def test_infinities_are_texts_in_json() -> None:
    case = Case({"H1": math.inf, "low": -math.inf, "mass": np.float64(1.5)})
    assert case.to_json() == '{"H1": "inf", "low": "-inf", "mass": 1.5}'
    assert Case.from_json(case.to_json()) == case


CASE_ERRORS: list[tuple[Any, type[Exception], str]] = [
    (3, InputTypeError, 'expected a case as a mapping such as {"mass": 1.5}, got 3'),
    (
        SMALL,
        InputTypeError,
        (
            f'expected a case as a mapping such as {{"mass": 1.5}}, got {SMALL!r}; '
            "space.case(point) gives one"
        ),
    ),
    ({1: 2}, InputTypeError, "expected the names of a case as texts, got 1"),
    (
        {"m": "1"},
        InputTypeError,
        (
            "expected 'm' of a case as a number or a waveform such as Waveform([0, 5], [1, 2]), "
            "got '1'"
        ),
    ),
    ({"m": math.nan}, InputError, "expected 'm' of a case as a number, got nan"),
]


@pytest.mark.parametrize(("entries", "kind", "message"), CASE_ERRORS)
def test_case_argument_errors(entries: object, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as caught:
        Case(cast("Any", entries))
    assert str(caught.value) == message


def test_json_must_be_text() -> None:
    with pytest.raises(InputTypeError) as caught:
        Case.from_json(cast("Any", {"m": 1}))
    assert str(caught.value) == "expected a case as text in JSON, got {'m': 1}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "{m: 1}",
            (
                "expected a case in JSON, got '{m: 1}': Expecting property name enclosed in double "
                "quotes: line 1 column 2 (char 1)"
            ),
        ),
        ("[1]", "expected a case in JSON such as {\"mass\": 1.5}, got '[1]'"),
        (
            '{"u": {"times": [0]}}',
            "expected 'u' in JSON with 'times', 'values', 'interpolation', got 'times'",
        ),
        ('{"m": NaN}', "expected 'm' of a case as a number, got nan"),
    ],
)
def test_case_json_errors(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        Case.from_json(text)
    assert str(caught.value) == message


THROTTLE = Signal("throttle", 0, 100, points=3, interpolation="linear", duration=30)
GEAR = Parameter("gear", values=[1, 2, math.inf], default=math.inf, unit="1", about="which")


def test_ranges_convert_to_floats_and_compare() -> None:
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
        "expected interpolation='hold', 'linear' or 'pchip', got 'cubic'",
    ),
    (
        {"duration": 0},
        InputError,
        "expected duration= as a finite number above 0, got 0",
    ),
]


@pytest.mark.parametrize(("change", "kind", "message"), SIGNAL_ERRORS)
def test_signal_errors(change: dict[str, Any], kind: type[Exception], message: str) -> None:
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
def test_parameter_errors(given: dict[str, Any], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as caught:
        Parameter(**{"name": "m", **given})
    assert str(caught.value) == message
