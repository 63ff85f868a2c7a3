"""Errors of exported monitors: each call returns the status of an error and logs the reason."""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from fmu_calls import (
    ERROR,
    FIRST,
    LOWER,
    OK,
    ROBUSTNESS,
    VERDICT,
    Unit,
    Version,
    dense,
    sampled,
    unit,
    versions,
    write,
)

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

EVERYTHING = (0, *range(FIRST, FIRST + 4))
"""Time, inputs, the parameter and the named formula."""
NAN = math.nan
NO_STATE = "expected a state that was taken of this instance and is not freed"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    text = "const float limit = 4\nwhole = always(sqrt(x) > limit - y)"
    return write(tmp_path, sampled(text, "100ms"))


def begun(made: Unit) -> None:
    assert made.set([FIRST, FIRST + 1], [1.0, 4.0]) == OK
    made.begin(0.0, 1.0)
    assert made.step(0.0, 0.1) == OK


def ended(made: Unit) -> None:
    begun(made)
    assert made.call("Terminate") == OK


def new(_: Unit) -> None:
    pass


def entered(made: Unit) -> None:
    assert made.enter() == OK


Act = Callable[[Unit], int]
INPUT = "expected the value reference of an input or a parameter, got {}"
REAL = "expected the value reference of a variable of this type, got {}"

REFUSED: dict[str, tuple[Callable[[Unit], None], Act, str]] = {
    "a step before initialization": (
        new,
        lambda u: u.step(0.0, 0.1),
        "expected the call after initialization, got it before initialization",
    ),
    "a step in initialization": (
        entered,
        lambda u: u.step(0.0, 0.1),
        "expected the call after initialization, got it in initialization",
    ),
    "a step after the end": (
        ended,
        lambda u: u.step(0.1, 0.1),
        "expected the call after initialization, got it after terminate",
    ),
    "initialization twice": (
        entered,
        lambda u: u.enter(),
        "expected the call before initialization, got it in initialization",
    ),
    "an end of no initialization": (
        new,
        lambda u: u.call("ExitInitializationMode"),
        "expected the call in initialization, got it before initialization",
    ),
    "terminate before the begin": (
        new,
        lambda u: u.call("Terminate"),
        "expected the call after initialization, got it before initialization",
    ),
    "a start that is no time": (
        new,
        lambda u: u.enter(NAN),
        "expected times that are numbers, got nan to inf",
    ),
    "a step into the past": (
        begun,
        lambda u: u.step(0.0, 0.1),
        "expected a step from 0.1 s, where the last one ended, got one from 0 s",
    ),
    "a step over a gap": (
        begun,
        lambda u: u.step(0.2, 0.1),
        "expected a step from 0.1 s, where the last one ended, got one from 0.2 s",
    ),
    "a step from no time": (
        begun,
        lambda u: u.step(NAN, 0.1),
        "expected a step from 0.1 s, where the last one ended, got one from nan s",
    ),
    "a step of nothing": (
        begun,
        lambda u: u.step(0.1, 0.0),
        "expected a finite step of more than 0 s, got 0 s",
    ),
    "a step back": (
        begun,
        lambda u: u.step(0.1, -0.1),
        "expected a finite step of more than 0 s, got -0.1 s",
    ),
    "a step without end": (
        begun,
        lambda u: u.step(0.1, math.inf),
        "expected a finite step of more than 0 s, got inf s",
    ),
    "a step past the stop time": (
        begun,
        lambda u: u.step(0.1, 1.0),
        "expected steps until the stop time, 1 s, got one to 1.1 s",
    ),
    "an input that is nan": (
        begun,
        lambda u: u.set([FIRST + 1], [NAN]) or u.step(0.1, 0.1),
        "expected a number as input 'y', got nan, at 0.1 s",
    ),
    "a term that is nan": (
        begun,
        lambda u: u.set([FIRST], [-1.0]) or u.step(0.1, 0.1),
        "a term of the specification is not a number for x=-1, y=4, at 0.1 s",
    ),
    "a parameter that is nan": (
        new,
        lambda u: u.set([FIRST + 2], [NAN]),
        "expected a finite number as parameter 'limit', got nan",
    ),
    "a parameter that no text can have": (
        new,
        lambda u: u.set([FIRST + 2], [-math.inf]),
        "expected a finite number as parameter 'limit', got -inf",
    ),
    "a parameter after initialization": (
        begun,
        lambda u: u.set([FIRST + 2], [1.0]),
        "the parameter 'limit' can be set until initialization ends",
    ),
    "the parameter of the end after initialization": (
        begun,
        lambda u: u.set_stop(True),
        "the parameter 'stop_on_violation' can be set until initialization ends",
    ),
    "an input after the end": (
        ended,
        lambda u: u.set([FIRST], [1.0]),
        "an input cannot be set after terminate; reset the instance",
    ),
    "an output that is set": (begun, lambda u: u.set([ROBUSTNESS], [1.0]), INPUT.format(1)),
    "a named formula that is set": (begun, lambda u: u.set([FIRST + 3], [1.0]), INPUT.format(11)),
    "a reference of nothing that is set": (begun, lambda u: u.set([99], [1.0]), REAL.format(99)),
    "a reference of nothing": (begun, lambda u: u.set([2**32 - 1], [1.0]), REAL.format(2**32 - 1)),
    "a reference of a gap": (begun, lambda u: u.set([6], [1.0]), INPUT.format(6)),
    "a number of another type": (
        begun,
        lambda u: got(u, VERDICT, "Float64"),
        REAL.format(4),
    ),
    "a verdict that is none": (
        begun,
        lambda u: got(u, LOWER, "Int32"),
        "expected the value reference 4, of 'verdict', got 2",
    ),
    "a flag that is none": (
        begun,
        lambda u: got(u, LOWER, "Boolean"),
        "expected the value reference 5, of 'stop_on_violation', got 2",
    ),
    "a state that is none": (begun, lambda u: u.restore(ctypes.c_void_p(8)), NO_STATE),
    "a state of nothing": (begun, lambda u: u.restore(ctypes.c_void_p()), NO_STATE),
    "no place for a state": (
        begun,
        lambda u: u.call("GetFMUState", None),
        "expected an array, got a null pointer",
    ),
    "an unknown category": (
        begun,
        lambda u: u.call("SetDebugLogging", 1, ctypes.c_size_t(1), strings(b"logAll")),
        "expected the categories logStatusError and logEvents, got 'logAll'",
    ),
    "categories of nothing": (
        begun,
        lambda u: u.call("SetDebugLogging", 1, ctypes.c_size_t(1), None),
        "expected an array, got a null pointer",
    ),
}
"""The preparation, the refused call, and the text."""


def got(made: Unit, reference: int, kind: str) -> int:
    """Return the status of a call that reads one value."""
    if made.version == 2:
        kind = {"Float64": "Real", "Int32": "Integer"}.get(kind, kind)
    given = ((ctypes.c_uint32 * 1)(reference), ctypes.c_size_t(1), (ctypes.c_double * 1)())
    return made.call(f"Get{kind}", *given, *([ctypes.c_size_t(1)] if made.version == 3 else []))


def strings(*values: bytes) -> ctypes.Array[ctypes.c_char_p]:
    return (ctypes.c_char_p * len(values))(*values)


@versions
@pytest.mark.parametrize("what", REFUSED)
def test_a_call_is_refused_and_changes_nothing(version: Version, what: str, folder: Path) -> None:
    before, act, text = REFUSED[what]
    with unit(version, folder) as made:
        before(made)
        inputs = made.get(FIRST, FIRST + 1)
        values = made.outputs(*EVERYTHING)
        assert made.log == []
        assert act(made) == ERROR
        ((status, category, said),) = made.log
        assert (status, category) == (ERROR, "logStatusError")
        assert re.fullmatch(f"fmi{version}[A-Z]\\w+: {re.escape(text)}", said)
        if before is begun:
            assert made.set([FIRST, FIRST + 1], inputs) == OK
        assert made.outputs(*EVERYTHING) == values
        if before is begun:
            assert made.step(0.1, 0.1) == OK


@versions
def test_a_step_of_too_many_samples_is_refused(version: Version, folder: Path) -> None:
    with unit(version, folder) as made:
        assert made.set([FIRST, FIRST + 1], [1.0, 4.0]) == OK
        made.begin()
        for size in (2.2e8, 1e300):
            assert made.step(0.0, size) == ERROR
            assert "expected a step of less than 2^31 periods of 0.1 s, got " in made.said
        assert made.step(0.0, 0.1) == OK


@versions
def test_parameters_that_give_no_number_end_no_initialization(
    version: Version, tmp_path: Path
) -> None:
    text = "const float c = 4\nconst float d = 1\nalways(x > sqrt(c) / d)"
    with unit(version, write(tmp_path, sampled(text))) as made:
        assert made.set([FIRST + 1], [-4.0]) == OK
        assert made.enter() == OK
        assert made.call("ExitInitializationMode") == ERROR
        assert made.said == (
            f"fmi{version}ExitInitializationMode: with these parameters a constant of the "
            "specification is not a number: c=-4 d=1"
        )
        assert made.set([FIRST + 1], [9.0]) == OK
        assert made.call("ExitInitializationMode") == OK


@versions
def test_over_dense_time_steps_are_of_a_tick_at_least(version: Version, tmp_path: Path) -> None:
    with unit(version, write(tmp_path, dense("always(x > 0)", "1ms"))) as made:
        made.begin()
        assert made.step(0.0, 1e-4) == OK
        assert made.step(1e-4, 1e-4) == ERROR
        assert made.said.endswith(
            "expected steps of a tick at least; two begin on the tick of 1e-04 s"
        )
        assert made.call("Reset") == OK
        made.begin(1e17)
        assert made.step(1e17, 1e17) == ERROR
        assert made.said.endswith("expected a time that ticks can count, got 1e+17 s")
