"""The Python class of the machine in C++: arguments, errors, memory, snapshots."""

from __future__ import annotations

import fractions
import gc
import math
import sys
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import pytest

from rtamt import Monitor
from rtamt.program.encoding import encoded_discrete

if TYPE_CHECKING:
    from rtamt._native import DiscreteMachine

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SPEC = "always[0:3](speed + 2 * gap > 1)"


def monitor(spec: str = SPEC, nan: Literal["raise", "hold"] = "raise") -> Monitor:
    return Monitor(spec, backend="native", nan=nan)


def machine(spec: str = SPEC) -> DiscreteMachine:
    return cast("DiscreteMachine", monitor(spec)._machine)


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
