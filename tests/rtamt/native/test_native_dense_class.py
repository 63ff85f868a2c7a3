"""The Python class of the dense machine in C++: errors, memory, snapshots."""

from __future__ import annotations

import gc
import math
import sys
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

import rtamt
from rtamt.language.parser import as_specification
from rtamt.program.dense_lowering import compile_dense
from rtamt.program.encoding import encoded_dense

if TYPE_CHECKING:
    from rtamt._native import DenseMachine
    from rtamt.inputs.events import EventsLike

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SPEC = "always[0:3](speed + 2 * gap > 1)"
EVENTS = {"speed": [(0.0, 1.0), (2.0, 4.0), (9.0, 0.0)], "gap": [(0.0, 2.0), (5.0, 1.0)]}


def monitor(spec: str = SPEC) -> rtamt.dense.Monitor:
    return rtamt.dense.Monitor(spec, backend="native")


def machine(spec: str = SPEC) -> DenseMachine:
    return cast("DenseMachine", monitor(spec)._machine)


def arguments(**changes: object) -> dict[str, object]:
    program = compile_dense(as_specification(SPEC), online=True)
    made = {
        "rows": encoded_dense(program).rows,
        "clock": encoded_dense(program).clock,
        "terms": program.program.terms,
        "variables": program.program.variables,
        "declared": (math.nan,) * len(program.program.variables),
        "result": program.program.result,
        "observed": (program.program.result,),
        "reader": object(),
    }
    return {**made, **changes}


ROW = ("LOAD", "x", 0, 0, 0.0, None, None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"variables": (), "declared": ()}, "expected a variable"),
        ({"declared": ()}, "expected a declared value, or nan, for every variable"),
        ({"result": 99}, "the result is out of range"),
        ({"observed": (99,)}, "an observed register is out of range"),
        ({"rows": [ROW, ("JUMP", "", 0, 0, 0.0, None, None)]}, "unknown kind 'JUMP'"),
        ({"rows": [ROW, ("MAP", "tan", 0, 0, 0.0, None, None)]}, "unknown function 'tan'"),
        ({"rows": [ROW, ("WINDOW", "sum", 0, 0, 0.0, 0, 1)]}, "unknown lattice fold 'sum'"),
        ({"rows": [ROW, ("WINDOW", "min", 0, 0, 0.0, 2, 1)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("WINDOW", "min", 1, 0, 0.0, 0, 1)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("MAP", "neg", 0, 7, 0.0, None, None)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("MAP", "neg", 0, 1, 0.0, None, None)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("MAP", "neg", 1, 0, 0.0, None, None)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("LOAD", "z", 2, 0, 0.0, None, None)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("WINDOW", "min", 0, 0, 0.0, 0, 2**62)]}, "row 1 is out of range"),
        ({"rows": [ROW, ("WINDOW", "min", 0, 0, 0.0, -(2**62), 0)]}, "row 1 is out of range"),
        ({"rows": [ROW, ROW[:6]]}, "expected rows of 7"),
        ({"clock": (1e9, -1, 1)}, "expected a clock that counts"),
        ({"clock": (1e9, 1, 0)}, "expected a clock that counts"),
    ],
)
def test_a_program_that_would_reach_out_of_memory_is_refused(
    changes: dict[str, object], message: str
) -> None:
    small = {"terms": 1, "result": 1, "observed": ()} if "rows" in changes else {}
    with pytest.raises(ValueError, match=f"^{message}$"):
        native.DenseMachine(**arguments(**{**small, **changes}))


def test_run_takes_whole_signals_of_a_new_machine() -> None:
    columns = [(np.array([0.0, 4.0]), np.ones(2)), (np.array([0.0, 5.0]), np.ones(2))]
    times, values = machine().run(columns)
    assert (times.tolist(), values.tolist()) == ([0.0], [2.0])
    assert times.flags.writeable
    assert times.flags.owndata
    with pytest.raises(ValueError, match=r"^expected events of every variable$"):
        machine().run(columns[:1])
    with pytest.raises(ValueError, match=r"^expected 1-D columns of n values$"):
        machine().run([columns[0], (np.arange(2.0), np.zeros(3))])
    used = machine()
    used.update(EVENTS)
    with pytest.raises(ValueError, match=r"^expected a new machine$"):
        used.run(columns)
    late = (np.array([0.0, 0.0]), np.ones(2))
    with pytest.raises(ValueError, match=r"^expected a time after 0\.0 at event 1 of 'gap', got 0"):
        machine().run([columns[0], late])


class Nested(Mapping[str, "EventsLike"]):
    """A mapping that updates the same monitor while it is read."""

    def __init__(self, inner: DenseMachine) -> None:
        self.inner = inner
        self.time = 1.0

    def __getitem__(self, name: str) -> EventsLike:
        self.inner.update({name: [(self.time, 1.0)]})
        self.time += 1.0
        return [(0.5, 1.0)]

    def __iter__(self) -> Iterator[str]:
        return iter("x")

    def __len__(self) -> int:
        return 1


def test_events_that_no_longer_fit_when_they_are_read_are_refused() -> None:
    made = machine("x > 0")
    with pytest.raises(RuntimeError, match=r"^the reader gave events that do not fit$"):
        made.update(Nested(made))
    made.update({"x": [(50.0, 3.0)]})
    assert made.finish() == [(50.0, 3.0)]


# Memory. -----------------------------------------------------------------------------------------


def test_no_argument_is_kept_and_no_reference_is_lost() -> None:
    pairs = [(float(i), i / 3) for i in range(4)]
    array, events = np.array([[9.5, 1.0]]), rtamt.dense.Events([11.5], [1.0])
    names = {"speed": pairs, "gap": [(0.0, 1.5)]}
    kept = [pairs, pairs[1], array, events, names]
    before = [sys.getrefcount(value) for value in kept]
    for _ in range(50):
        made = machine()
        made.update(names)
        made.update({"speed": array})
        made.update({"speed": events})
        for bad in ({"speed": pairs}, {"speed": array}, {"gap": pairs, "speed": "x"}):
            with pytest.raises((ValueError, TypeError)):
                made.update(cast("dict[str, EventsLike]", bad))
        del bad
    del made
    gc.collect()
    assert [sys.getrefcount(value) for value in kept] == before


def test_updates_allocate_nothing_that_stays() -> None:
    update = machine("always[0:10](x > 0)").update
    time = 0.0

    def loop() -> int:
        nonlocal time
        for _ in range(2000):
            time += 0.1
            update({"x": [(time, 1.0)]})
            time += 0.1
            update({"x": np.array([[time, -1.0]])})
        return sys.getallocatedblocks()

    loop()
    first = loop()
    assert loop() - first < 20


def test_a_bound_update_keeps_its_machine() -> None:
    update = machine().update
    gc.collect()
    assert update(EVENTS) == [(0.0, 4.0)]


def test_the_reader_is_not_asked_for_the_times_of_ticks() -> None:
    """Rare cases are left to Python; this reader can do nothing."""
    known = monitor()
    made = native.DenseMachine(**arguments(reader=object()))
    steps = known.update(EVENTS)
    assert steps
    assert made.update(EVENTS) == steps
    assert made.settled == known.settled
    assert made.finish() == known.finish()
