"""The class that Python sees of the machine over dense time in C++: errors, memory, snapshots."""

from __future__ import annotations

import gc
import math
import random
import sys
import threading
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

import rtamt
from rtamt import StateError
from rtamt.language.parser import as_specification
from rtamt.program.dense_lowering import compile_dense
from rtamt.program.encoding import encoded_dense

if TYPE_CHECKING:
    from rtamt._native import DenseMachine
    from rtamt.inputs.events import EventsLike

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SPEC = "always[0:3](speed + 2 * gap > 1)"
RUNNING = (
    "the monitor is running in another thread; wait until that call returns, "
    "or make a monitor for each thread"
)
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


@pytest.mark.filterwarnings("ignore:nanobind. attempted to access an uninitialized instance")
def test_an_object_that_was_not_made_is_refused() -> None:
    unmade = native.DenseMachine.__new__(native.DenseMachine)
    with pytest.raises(TypeError, match=r"^the machine was not made: __init__ was not called$"):
        unmade.update({})
    with pytest.raises(TypeError):
        unmade.settled  # noqa: B018
    with pytest.raises(TypeError):
        unmade.finish()
    with pytest.raises(TypeError):
        unmade.run([])
    del unmade
    gc.collect()


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
    """A mapping that hands events to the same monitor while it is read."""

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
    """What is rare is left to Python; this reader can do nothing at all."""
    known = monitor()
    made = native.DenseMachine(**arguments(reader=object()))
    steps = known.update(EVENTS)
    assert steps
    assert made.update(EVENTS) == steps
    assert made.settled == known.settled
    assert made.finish() == known.finish()


# Snapshots. --------------------------------------------------------------------------------------

FOREIGN = (
    "^expected a state that a native machine with this program gave; "
    "those of other programs, back-ends or processors do not fit$"
)


@pytest.mark.parametrize(
    "state",
    [
        b"",
        b"rtamt",
        bytes(200),
        None,
        rtamt.dense.Monitor(SPEC, backend="python")._machine.state(),
        machine("always[0:4](speed + 2 * gap > 1)").state(),
        machine("always[0:3](speed + 3 * gap > 1)").state(),
        machine("eventually[0:3](speed + 2 * gap > 1)").state(),
    ],
)
def test_a_foreign_state_is_refused_and_changes_nothing(state: object) -> None:
    made = machine()
    made.update(EVENTS)
    before = made.state()
    with pytest.raises(ValueError, match=FOREIGN):
        made.restore(cast("bytes", state))
    assert made.state() == before


def test_a_damaged_state_is_refused_and_changes_nothing() -> None:
    made = machine()
    made.update(EVENTS)
    state = made.state()
    for damaged in (
        state[:-8],
        state[:20],
        state + bytes(8),
        state[:16] + b"\xff" * (len(state) - 16),
    ):
        with pytest.raises(ValueError, match=r"^expected a whole state, got a damaged one$"):
            made.restore(damaged)
        assert made.state() == state
    assert made.finish() == machine_after(EVENTS).finish()


def machine_after(events: Mapping[str, EventsLike], spec: str = SPEC) -> DenseMachine:
    made = machine(spec)
    made.update(events)
    return made


def test_no_change_of_a_state_reaches_out_of_memory() -> None:
    spec = "(x > 0) until[1:3] (y > 0) and once[0:2] eventually[0:2] (x > y)"
    rng = random.Random(5)
    events = {n: [(i + rng.random(), rng.gauss(0, 1)) for i in range(30)] for n in "xy"}
    state = machine_after(events, spec).state()
    later = {"x": [(50.0, 1.0), (60.0, 2.0)], "y": [(55.0, -1.0), (70.0, 2.0)]}
    made, refused = machine_after(events, spec), 0
    for _ in range(4000):
        damaged = bytearray(state)
        for _ in range(rng.choice((1, 2, 8))):
            damaged[rng.randrange(8, len(state))] = rng.choice((0, 1, 0x7F, 0x80, 0xF0, 0xFF))
        try:
            made.restore(bytes(damaged))
        except ValueError:
            refused += 1
            assert made.state() == state
            continue
        try:  # any result will do, but it ends
            made.update(later)
            made.finish()
        except (ValueError, RuntimeError):
            pass
        made.restore(state)
    assert refused > 400


# Threads. ----------------------------------------------------------------------------------------


def test_what_another_thread_is_running_is_left_alone() -> None:
    made = machine("always[0:3](x > 1) and eventually[0:100](x > 0)")
    columns = [(np.arange(2e6), np.random.default_rng(0).random(2_000_000))]
    results: list[int] = []
    thread = threading.Thread(target=lambda: results.append(len(made.run(columns)[0])))
    messages: set[str] = set()
    thread.start()
    while thread.is_alive():
        for call in (lambda: made.update({}), made.state, made.finish):
            try:
                call()
            except StateError as error:  # others: not yet running, or no longer
                messages.add(str(error))
    assert len(results) == 1
    assert all(m == RUNNING or m.startswith(("finish() needs", "the trace is")) for m in messages)
