"""The class that Python sees of the machine in C++: arguments, errors, memory, snapshots."""

from __future__ import annotations

import fractions
import gc
import math
import pickle
import sys
import threading
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import pytest

from rtamt import Monitor, StateError
from rtamt.program.encoding import encoded_discrete

if TYPE_CHECKING:
    from rtamt._native import DiscreteMachine

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SPEC = "always[0:3](speed + 2 * gap > 1)"
RUNNING = (
    "the monitor is running in another thread; wait until that call returns, "
    "or make a monitor for each thread"
)


def monitor(spec: str = SPEC, nan: Literal["raise", "hold"] = "raise") -> Monitor:
    return Monitor(spec, backend="native", nan=nan)


def machine(spec: str = SPEC) -> DiscreteMachine:
    return cast("DiscreteMachine", monitor(spec)._machine)


@pytest.mark.filterwarnings("ignore:nanobind. attempted to access an uninitialized instance")
def test_an_object_that_was_not_made_is_refused() -> None:
    unmade = native.DiscreteMachine.__new__(native.DiscreteMachine)
    with pytest.raises(TypeError, match=r"^the machine was not made: __init__ was not called$"):
        unmade.update(1.0)
    with pytest.raises(TypeError):
        unmade.samples  # noqa: B018
    with pytest.raises(TypeError):
        unmade.state()
    del unmade
    gc.collect()


def test_update_of_another_type_is_refused() -> None:
    with pytest.raises(TypeError, match="doesn't apply to a 'int' object"):
        native.DiscreteMachine.update(3, 1.0)


def arguments(**changes: object) -> dict[str, object]:
    program = monitor().program
    made = {
        "rows": encoded_discrete(program).rows,
        "terms": program.terms,
        "variables": program.variables,
        "result": program.result,
        "observed": [(program.result, 3)],
        "reader": object(),
    }
    return {**made, **changes}


@pytest.mark.filterwarnings("ignore:nanobind. attempted to initialize an already-initialized")
def test_a_machine_is_made_once() -> None:
    made = native.DiscreteMachine(**arguments())
    made.update(1.0, 1.0)
    with pytest.raises(TypeError):
        made.__init__(**arguments())
    assert made.samples == 1


ROW = (0, "CONST", "", 0, 0, 1.0, 0, 0)
WINDOW = (1, "WINDOW", "min", 0, 0, 0.0, 2, 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observed": []}, "expected the result first among the observed"),
        ({"observed": [(0, 3)]}, "expected the result first among the observed"),
        ({"observed": [(99, 0)], "result": 99}, "an observed register is out of range"),
        (
            {"rows": [ROW], "observed": [(1, 0)], "result": 1},
            "an observed register is out of range",
        ),
        (
            {"rows": [ROW], "observed": [(0, 0), (0, -1)], "result": 0},
            "an observed register is out of range",
        ),
        ({"rows": [ROW, (1, "JUMP", "", 0, 0, 0.0, 0, 0)]}, "unknown kind 'JUMP'"),
        ({"rows": [ROW, (1, "MAP", "tan", 0, 0, 0.0, 0, 0)]}, "unknown function 'tan'"),
        ({"rows": [ROW, (1, "WINDOW", "sum", 0, 0, 0.0, 2, 0)]}, "unknown lattice fold 'sum'"),
        ({"rows": [ROW, (1, "MAP", "neg", 7, 7, 0.0, 0, 0)]}, "row 1 is out of range"),
        ({"rows": [ROW, (1, "MAP", "neg", 2, 0, 0.0, 0, 0)]}, "row 1 is out of range"),
        ({"rows": [ROW, (1, "MAP", "neg", 0, 2, 0.0, 0, 0)]}, "row 1 is out of range"),
        ({"rows": [ROW, (2, "MAP", "neg", 0, 0, 0.0, 0, 0)]}, "row 2 is out of range"),
        ({"rows": [ROW, (1, "LOAD", "z", 2, 0, 0.0, 0, 0)]}, "row 1 is out of range"),
        ({"rows": [(0, *WINDOW[1:])]}, "row 0 is out of range"),
        ({"rows": [(0, "DELAY", *WINDOW[2:])]}, "row 0 is out of range"),
        ({"rows": [ROW, (1, "DELAY", "", 0, 0, 0.0, 0, 0)]}, "a delay of nothing"),
        ({"rows": [ROW, (1, "DELAY", "", 0, 0, 0.0, 2**32 + 1, 0)]}, "row 1 is out of range"),
        ({"rows": [ROW[:7]]}, "expected rows of 8"),
    ],
)
def test_a_program_that_would_reach_out_of_memory_is_refused(
    changes: dict[str, object], message: str
) -> None:
    terms = {"terms": 1} if "rows" in changes else {}
    with pytest.raises(ValueError, match=f"^{message}$"):
        native.DiscreteMachine(**arguments(**terms, **changes))


def test_blocks_of_a_wrong_form_are_refused() -> None:
    made = machine()
    column = np.ones(4)
    with pytest.raises(ValueError, match=r"^expected a column for every variable$"):
        made.run([column], 4)
    for bad in (np.ones(3), np.ones((4, 1)), np.float64(1.0)):
        with pytest.raises(ValueError, match=r"^expected 1-D columns of n values$"):
            made.run([column, bad], 4)
    assert made.run([column, column], 4)[0][3] == 2.0
    assert made.samples == 4
    assert made.run([np.empty(0)] * 2, 0)[0].shape == (0,)


def test_blocks_take_any_array() -> None:
    expected = [np.nan] * 3 + [8.0]
    for array in (
        [3, 3, 3, 3],
        np.full(8, 3.0)[::2],
        np.full(4, 3.0)[::-1],
        np.full(4, 3, np.float32),
        np.broadcast_to(np.array(3), 4),
    ):
        (values,) = machine().run([array, array], 4)
        assert np.array_equal(values, expected, equal_nan=True)


# Memory. -----------------------------------------------------------------------------------------


def test_no_argument_is_kept_and_no_reference_is_lost() -> None:
    update = machine().update
    values = [
        3.25,
        10**20,
        np.float64(1.5),
        fractions.Fraction(1, 3),
        np.array([1.0, 2.0]),
        {"speed": 1.5, "gap": 2.0},
    ]
    before = [sys.getrefcount(value) for value in values]
    for _ in range(100):
        update(values[0], values[1])
        update(speed=values[2], gap=values[3])
        update(values[4])
        update(values[5])
        update(**cast("dict[str, float]", values[5]))
        for bad in ((values[0],), (values[0], "x"), ({"speed": values[0]},), (values[4], 1.0)):
            with pytest.raises((ValueError, TypeError)):
                update(*bad)
            del bad
    assert [sys.getrefcount(value) for value in values] == before


def test_updates_allocate_nothing_that_stays() -> None:
    update = machine("always[0:1000](x + y > 0)").update
    row, array = {"x": 1.0, "y": 2.0}, np.ones(2)

    def loop() -> int:
        for _ in range(2000):
            update(1.0, 2.0)
            update(row)
            update(array)
            update(y=2.0, x=1.0)
        return sys.getallocatedblocks()

    loop()
    first = loop()
    assert loop() - first < 20


def test_a_bound_update_keeps_its_machine() -> None:
    update = machine().update
    gc.collect()
    assert math.isnan(update(1.0, 1.0))


# Snapshots. --------------------------------------------------------------------------------------


def test_a_pickled_state_continues_where_it_was_taken() -> None:
    made = machine("always[0:50](speed > gap) or gap since[0:9] speed")
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(400, 2)).tolist()
    for row in rows[:137]:
        made.update(*row)
    twin = machine("always[0:50](speed > gap) or gap since[0:9] speed")
    twin.restore(pickle.loads(pickle.dumps(made.state())))
    assert (twin.samples, twin.inputs, twin.registers) == (137, made.inputs, made.registers)
    assert [made.update(*row) for row in rows[137:]] == [twin.update(*row) for row in rows[137:]]


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
        [0, [], [], []],
        machine("always[0:4](speed + 2 * gap > 1)").state(),
        machine("always[0:3](speed + 3 * gap > 1)").state(),
        machine("eventually[0:3](speed + 2 * gap > 1)").state(),
    ],
)
def test_a_foreign_state_is_refused_and_changes_nothing(state: object) -> None:
    made = machine()
    made.update(1.0, 2.0)
    before = made.state()
    with pytest.raises(ValueError, match=FOREIGN):
        made.restore(cast("bytes", state))
    assert made.state() == before


def test_a_damaged_state_is_refused_and_changes_nothing() -> None:
    made = machine()
    for _ in range(3):
        made.update(1.0, 2.0)
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
    assert made.update(1.0, 2.0) == 4.0


# Threads. ----------------------------------------------------------------------------------------


def test_what_another_thread_is_running_is_left_alone() -> None:
    made = machine("always[0:3](x > 1) and eventually[0:100](x > 0)")
    column = np.ones(3_000_000)
    results: list[float] = []
    thread = threading.Thread(target=lambda: results.append(made.run([column], len(column))[0][-1]))
    refused = 0
    thread.start()
    while thread.is_alive():
        for call in (lambda: made.update(1.0), made.state, made.reset):
            try:
                call()
            except StateError as error:
                assert str(error) == RUNNING  # noqa: PT017
                refused += 1
    assert len(results) == 1
