"""The signs of left sides in dense time: C++ against Python, on traces of many blocks."""

from __future__ import annotations

import itertools
from dataclasses import astuple
from typing import get_args

import numpy as np
import pytest
from native_signs import signs

import rtamt
from rtamt.machines.protocols import End
from rtamt.monitors import Occurrences

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

LEFTS = (
    "x > 0",
    "x > 0 and y + x > 0",
    "eventually[0:5](x > 1)",
    "once[2:7](x > 1)",
    "historically(x > -3)",
    "eventually(y > 2)",
    "always[0:3](eventually[1:2](x > 0))",
    "x > 0 until[1:4] y > 0",
    "x > -1 since[0:4] y > 1",
    "not (x > 0 until y > 1)",
    "always[5:9](x < 2) implies once(y > 0)",
    "true",
)


def events(count: int, seed: int, *, dates: bool) -> dict[str, rtamt.dense.Events]:
    rng = np.random.default_rng(seed)
    found = {}
    for name in ("x", "y"):
        steps = np.cumsum(rng.integers(1, 40, count))
        times = steps / 10
        if dates:
            times = steps.astype("M8[s]")
        found[name] = rtamt.dense.Events(times, np.round(rng.normal(size=count), 1))
    return found


@pytest.mark.slow(keep=8)
@pytest.mark.parametrize("dates", [False, True], ids=["numbers", "dates"])
@pytest.mark.parametrize("left", LEFTS)
def test_it_counts_as_python_does(left: str, *, dates: bool) -> None:
    spec = f"always(({left}) implies eventually[0:20](y > -1 or x > -1))"
    for count in (1, 2, 60, 1300):
        trace = events(count, count, dates=dates)
        begin, end = (pick(trace[n].times[i] for n in "xy") for pick, i in ((max, 0), (min, -1)))
        if begin > end:
            continue
        for reading in get_args(End):
            python, native = (
                rtamt.dense.judge(spec, trace, reading, resolution="100ms", backend=backend)
                for backend in ("python", "native")
            )
            assert list(map(astuple, native.triggers)) == list(map(astuple, python.triggers)), count
            assert (native.vacuous, native.never_triggered) == (
                python.vacuous,
                python.never_triggered,
            )


@pytest.mark.slow(keep=8)
@pytest.mark.parametrize("body", LEFTS)
def test_occurrences_match_python(body: str) -> None:
    """The values of C++ at all places, also beyond the trace, equal Python bit by bit."""
    specs = (
        f"always(({body}) or x > 2)",
        f"always[3:400](({body}) implies eventually[0:20](y > -1 or x > -1))",
        f"always(({body}) implies (x < 1 until[1:9] ({body})))",
    )
    for count, spec in itertools.product((1, 2, 60, 700), specs):
        trace = events(count, count + 1, dates=False)
        if max(e.times[0] for e in trace.values()) > min(e.times[-1] for e in trace.values()):
            continue
        for reading in get_args(End):
            python, native = (
                rtamt.dense.occurrences(spec, trace, reading, resolution="100ms", backend=backend)
                for backend in ("python", "native")
            )
            assert bits(native) == bits(python), count


def bits(found: Occurrences) -> list[tuple[str, bytes]]:
    return [
        (name, column.tobytes())
        for body in found.bodies
        for table in (body.violations, body.unknown, body.responses, body.unknown_triggers)
        for name, column in table.columns.items()
    ]


@pytest.mark.parametrize("end", get_args(End))
def test_what_reads_the_past_alone_is_the_same_at_each_end(end: End) -> None:
    """At the last instant x holds for the first time, which is sufficient there."""
    rows = [
        ("WINDOW", "max", 0, 0, -2, -2, False, False),
        ("WINDOW", "since", 1, 0, None, 0, False, False),
    ]
    given, last = [(np.array([0.0, 3.0]), np.array([-1.0, 1.0]))], 6 * 10**9
    found = signs(rows=rows, result=2, given=given, end=end)
    assert found.fails_at([(0, last)]) == (3 * 10**9, 1, 0)
    assert found.fails_at([(last, last)]) == (0, 0, None)
    assert found.holds_at([(last, last)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"result": 9}, "a program over regions"),
        ({"rows": [("WINDOW", "min", 7, 7, 0, 2, False, False)]}, "a program over regions"),
        ({"given": [(np.array([5.0]), np.array([1.0]))]}, "an event at the begin"),
        ({"last": -1}, "expected a trace"),
        ({"terms": [(0, "LOAD", "x", 3, 0, 0.0, 0, 0)]}, "a program over regions"),
    ],
)
def test_what_is_no_program_or_no_trace_is_refused(
    changes: dict[str, object], message: str
) -> None:
    assert signs().fails_at([(0, float("inf"))]) == (0, 1, 6 * 10**9)
    with pytest.raises((ValueError, RuntimeError), match=message):
        signs(**changes)
