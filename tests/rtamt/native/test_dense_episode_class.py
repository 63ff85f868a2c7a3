"""The C++ classes of episodes in dense time: wrong programs and states are refused."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

import rtamt

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

NO_PROGRAM = "^expected a program over regions$"
LOAD = (0, "LOAD", "x", 0, 0, 0.0, 0, 0)
CONSTANT = (0, "CONST", "", 0, 0, 1.0, 0, 0)
MAP = (1, "MAP", "neg", 0, 0, 0.0, 0, 0)
LEAST = ("MAP", "min", 0, 0, None, None, False, False)
ENDLESS = ("WINDOW", "min", 0, 0, 0, None, False, False)
NEAR = (("WINDOW", "min", 0, 0, 0, 10, False, False),)
FAR = 2**62


def regions(**changes: object) -> dict[str, Any]:
    """Return `always x` as registers over regions, with changes."""
    made: dict[str, Any] = {
        "terms": 1,
        "constants": (),
        "rows": (ENDLESS,),
        "initial": (1,),
        "streams": (0,),
        "unknowns": (),
    }
    return {**made, **changes}


def test_registers_that_are_a_program_are_read() -> None:
    made = native.DenseRegions(**regions())
    made.advance(np.array([0, 2]), [np.array([3.0, 1.0])], 4)
    assert made.t == 4
    assert made.look(3) == (1.0, -np.inf, 1.0)


def test_new_registers_take_in_the_first_position() -> None:
    """Registers that were never reset: a failure at the first instant only is found."""
    nested = (("WINDOW", "min", 0, 0, 0, 4, False, False), ("WINDOW", "min", 1, 1, *ENDLESS[4:]))
    made = native.DenseRegions(**regions(rows=nested, initial=(2,), streams=(0, 1)))
    made.advance(np.array([0, 1]), [np.array([-1.0, 3.0])], 6)
    assert made.look(3) == (-1.0, -np.inf, -1.0)


def test_a_state_of_registers_in_another_order_is_refused() -> None:
    rows = (("WINDOW", "min", i, i, *ENDLESS[4:]) for i in range(2))
    both = {"terms": 2, "rows": (*rows, ("MAP", "min", 2, 3, *LEAST[4:])), "initial": (2, 3, 4)}
    x, y = np.array([1.0, 5.0]), np.array([2.0, -7.0])
    made, other = (native.DenseRegions(**regions(**both, streams=s)) for s in ((0, 1), (1, 0)))
    made.advance(np.array([0, 2]), [x, y], 4)
    before = other.state()
    with pytest.raises(ValueError, match="those of other programs"):
        other.restore(made.state())
    assert other.state() == before
    other.advance(np.array([0, 2]), [x, y], 4)
    assert other.look(3) == made.look(3) == (-7.0, -np.inf, -7.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"initial": ()},
        {"initial": (2,)},
        {"initial": (1, 1)},
        {"streams": (2,)},
        {"streams": (0, 0)},
        {"streams": ()},
        {"streams": (1,), "initial": (0,)},
        {"constants": ((1, 2.0),)},
        {"rows": (("JUMP", "min", 0, 0, 0, 0, False, False),)},
        {"rows": (("MAP", "min", 1, 0, None, None, False, False),)},
        {"rows": (("MAP", "min", 0, 1, None, None, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, None, None, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, 0, None, True, False),)},
        {"rows": (("WINDOW", "min", 0, 0, -1, 1, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, -1, None, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, None, 1, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, 2, 1, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, -1, -2, False, False),)},
        {"rows": (("WINDOW", "min", 0, 0, -(2**63), 0, False, False),)},
        {  # each alone is near enough
            "rows": (
                ("WINDOW", "min", 0, 0, 0, FAR, False, False),
                ("WINDOW", "min", 1, 1, 0, FAR, False, False),
            ),
            "streams": (0, 1),
            "initial": (2,),
        },
        {"rows": (ENDLESS, LEAST), "streams": (0, 1), "initial": (2,)},  # 1 is no unknown
        {"rows": (("WINDOW", "min", 0, 0, None, -(2**63), False, False),)},
        {"terms": 2, "rows": (("WINDOW", "min", 0, 1, *ENDLESS[4:]),), "initial": (2,)},  # 1 too
        {"terms": 2, "rows": ((*LEAST[:2], 0, 1, *LEAST[4:]),), "initial": (2,), "streams": (0, 2)},
    ],
)
def test_registers_that_are_no_program_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=NO_PROGRAM):
        native.DenseRegions(**regions(**changes))


LATER = "expected a later instant, and the terms at the first"
NEW = "expected new positions that increase"


def places(*positions: int) -> tuple[Any, list[Any]]:
    return np.array(positions, np.int64), [np.arange(float(len(positions)))]


@pytest.mark.parametrize(
    ("positions", "t", "message"),
    [
        ((), 4, LATER),
        ((2,), 4, LATER),
        ((0,), 3, LATER),
        ((0, 0), 4, NEW),
        ((2, 0), 4, NEW),
        ((0, 6), 4, NEW),
    ],
)
def test_registers_take_positions_in_their_order(
    positions: tuple[int, ...], t: int, message: str
) -> None:
    made = native.DenseRegions(**regions(rows=NEAR))
    before = made.state()
    with pytest.raises(ValueError, match=f"^{message}$"):
        made.advance(*places(*positions), t)
    assert made.state() == before
    made.advance(*places(0, 2), 4)
    assert made.t == 4
    for again, later, text in (((), 4, LATER), ((), 2, LATER), ((4,), 6, NEW), ((6,), 7, LATER)):
        with pytest.raises(ValueError, match=f"^{text}$"):
            made.advance(*places(*again), later)
    with pytest.raises(ValueError, match=r"^expected a column for every term$"):
        made.advance(*places(6)[:1], [], 6)
    with pytest.raises(ValueError, match=r"^expected 1-D columns of n values$"):
        made.advance(places(6)[0], [np.ones(2)], 6)
    with pytest.raises(TypeError, match="bytes-like"):
        made.advance([6], [np.ones(1)], 6)
    made.advance(*places(), 6)
    assert made.t == 6


def test_registers_are_looked_at_in_one_to_five_worlds() -> None:
    made = native.DenseRegions(**regions(rows=NEAR))
    for worlds in (0, 6):
        with pytest.raises(ValueError, match=r"^expected 1 to 5 worlds$"):
            made.look(worlds)
    assert len(made.look(5)) == 5
    made.advance(*places(0, 2), 4)
    state = made.state()
    late = (2**63 - 2).to_bytes(8, "little")  # with the window behind it beyond all positions
    assert state[8:16] == (4).to_bytes(8, "little")
    with pytest.raises(ValueError, match=r"^expected a whole state, got a damaged one$"):
        made.restore(state[:8] + late + state[16:])
    assert made.state() == state


def test_a_fold_that_nobody_knows_is_refused() -> None:
    rows = (("WINDOW", "sum", 0, 0, 0, 1, False, False),)
    with pytest.raises(ValueError, match=r"^expected the name of a lattice fold, got sum$"):
        native.DenseRegions(**regions(rows=rows))


@pytest.mark.parametrize("count", [15, 16, 17])
def test_sixteen_operators_without_an_end_may_stand_inside_others(count: int) -> None:
    nested = range(1, count + 1)
    last = ("WINDOW", "min", count, count, 0, 0, False, False)
    changes = {
        "rows": (*(("WINDOW", "min", i, i, 0, None, False, False) for i in range(count)), last),
        "streams": (0, *nested),
        "initial": (count + 1,),
        "unknowns": tuple(nested),
    }
    if count > 16:
        with pytest.raises(ValueError, match=NO_PROGRAM):
            native.DenseRegions(**regions(**changes))
        return
    assert native.DenseRegions(**regions(**changes)).t == -1


def episode(*terms: object, **changes: object) -> dict[str, Any]:
    encoded = (len(terms), (), (("WINDOW", "min", 0, 0, 0, None, False, False),), (len(terms),))
    made: dict[str, Any] = {
        "readings": [(terms, (*encoded, (0,), ()))],
        "variables": ("x",),
        "clock": (1e9, 10**9, 1),
        "declared": (np.nan,),
        "reach": 0,
        "reader": object(),
    }
    return {**made, **changes}


@pytest.mark.parametrize(
    ("terms", "row"),
    [
        ([(0, "LOAD", "x", 1, 0, 0.0, 0, 0)], 0),
        ([(0, "WINDOW", "min", 0, 0, 0.0, 0, 0)], 0),
        ([MAP], 0),
        ([LOAD, (1, "MAP", "add", 1, 0, 0.0, 0, 0)], 1),
        ([LOAD, (1, "MAP", "add", 0, 1, 0.0, 0, 0)], 1),
        ([LOAD, (1, "MAP", "sum", 0, 0, 0.0, 0, 0)], 1),
        ([LOAD, MAP, (2, "MAP", "add", 2, 5, 0.0, 0, 0)], 2),
    ],
)
def test_what_is_no_term_is_refused(terms: list[object], row: int) -> None:
    native.DenseEpisodeMachine(**episode(LOAD, MAP))
    with pytest.raises(ValueError, match=f"^row {row} is no term$"):
        native.DenseEpisodeMachine(**episode(*terms))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"readings": []}, "expected one program, or two with neutral predicates"),
        (
            {"readings": 3 * episode(LOAD)["readings"]},
            "expected one program, or two with neutral predicates",
        ),
        ({"readings": episode()["readings"]}, "expected terms of variables"),
        (
            {"readings": episode(CONSTANT)["readings"], "variables": (), "declared": ()},
            "expected terms of variables",
        ),
        ({"declared": ()}, "expected a declared value, or nan, for every variable"),
        ({"reach": -1}, "the reach is out of range"),
        ({"reach": FAR}, "the reach is out of range"),
        ({"variables": (), "declared": ()}, "row 0 is no term"),
        ({"clock": (1e9, -1, 1)}, "expected a clock that counts"),
    ],
)
def test_what_is_no_episode_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        native.DenseEpisodeMachine(**episode(LOAD, **changes))


TICK = 123_456_789_012_345  # of a nanosecond: no other number of a state equals it


@pytest.mark.parametrize("kind", [rtamt.dense.Monitor, rtamt.dense.EpisodeMonitor])
@pytest.mark.parametrize(
    "text",
    [
        "x > 0",
        "historically[0:1](x > 0)",
        "eventually[0:1](x > 0)",
        "(x > 0) since (once[1:2](x > 1))",
        "(x > 0) until[1:3] (x > 1)",
    ],
)
def test_a_state_says_no_time_that_cannot_be_counted(kind: Any, text: str) -> None:  # noqa: ANN401 - of two classes
    """Ticks are below 2^62; a later time is refused if a state has the present tick."""
    monitor = kind(text, backend="native")
    monitor.update(x=[(0, 1.0), (100_000, 2.0), (TICK / 1e9, 3.0)])
    machine = monitor._machine
    state = machine.state()
    held = struct.pack("=q", TICK)
    places = [i for i in range(len(state)) if state.startswith(held, i)]
    assert places
    for place in places:
        for forged in (FAR + 1, 2**63 - 1):
            damaged = state[:place] + struct.pack("=q", forged) + state[place + 8 :]
            with pytest.raises(ValueError, match=r"^expected a whole state, got a damaged one$"):
                machine.restore(damaged)
    assert machine.state() == state


def test_a_whole_trace_that_decides_nothing_is_not_decided() -> None:
    events = [(np.array([0.0, 3.0]), np.array([1.0, 2.0]))]
    for decided in (False, True):
        monitor = rtamt.dense.EpisodeMonitor("always(x > 0)", backend="native")
        monitor._machine.run(events, decided=decided)
        assert (monitor.decided_at, monitor.settled, monitor.robustness) == (None, 3.0, 1.0)


def test_a_state_is_that_of_a_machine_which_looks_as_far_away() -> None:
    """With another reach a trace of the same events would be too long at another time."""
    near, far = (native.DenseEpisodeMachine(**episode(LOAD, reach=reach)) for reach in (0, 1))
    native.DenseEpisodeMachine(**episode(LOAD)).restore(near.state())
    with pytest.raises(ValueError, match=r"^expected a state that a native machine with this prog"):
        far.restore(near.state())


def test_a_state_keeps_nothing_of_before_its_trace() -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(eventually[0:9](x > 0))", backend="native")
    monitor.update(x=[(0, 1.0), (1, 2.0), (2, 3.0)])
    state = monitor._machine.state()
    kept = struct.pack("=3q", 0, 2 * 10**9, 4 * 10**9)  # x has a step here: two for each tick
    assert kept in state
    for first in (-1, -(2**62)):
        damaged = state.replace(kept, struct.pack("=q", first) + kept[8:])
        with pytest.raises(ValueError, match=r"^expected a whole state, got a damaged one$"):
            monitor._machine.restore(damaged)
    assert monitor._machine.state() == state
