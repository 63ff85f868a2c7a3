"""Errors of the native module for arguments that our Python never passes."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from native_signs import signs

import rtamt
from rtamt import EpisodeMonitor, InputError, Monitor, VectorEpisodeMonitor, Verdict
from rtamt.machines.clocks import OperatorClock
from rtamt.program.placement import MAX_UNKNOWNS

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

LOAD = (0, "LOAD", "x", 0, 0, 0.0, 0, 0)
ENDLESS = ("WINDOW", "min", 0, 0, 0, None, False, False)


# Rows. -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [0, 511, 512, 1499])
@pytest.mark.parametrize(("column", "value"), [(0, -1.0), (0, math.nan), (1, math.nan)])
def test_traces_with_a_nan_are_refused(column: int, value: float, at: int) -> None:
    rows = [LOAD, (1, "MAP", "sqrt", 0, 0, 0.0, 0, 0)]
    window = ("WINDOW", "min", 1, 1, 0, None, False, False)
    columns = [np.ones(3000), np.ones(3000)]
    columns[column][at] = value
    spans = np.array([0, 1500]), np.array([1500, 1500])
    *_, refused = native.judge_traces(
        *(rows, [window], [2], [1], 2, columns, *spans, "complete", 2)
    )
    assert refused.tolist() == [True, False]


def test_ranges_are_found_of_terms() -> None:
    given = [np.zeros(1)], [np.ones(1)], 1
    ((low,), (high,)) = native.term_ranges([LOAD], 1, [0], object(), *given)
    assert (low.tolist(), high.tolist()) == ([0.0], [1.0])
    with pytest.raises(ValueError, match=r"^an observed register is no term$"):
        native.term_ranges([LOAD], 1, [1], object(), *given)


@pytest.mark.parametrize(
    "changes",
    [
        {"terms": [(0, "LOAD", "x", 1, 0, 0.0, 0, 0)]},
        {"terms": [LOAD, (1, "WINDOW", "min", 0, 0, 0.0, 0, 0)]},
        {"terms": [LOAD, (1, "MAP", "add", 1, 0, 0.0, 0, 0)]},
        {"terms": [LOAD, (1, "MAP", "add", 0, 1, 0.0, 0, 0)]},
        {"terms": [LOAD, (1, "MAP", "sum", 0, 0, 0.0, 0, 0)]},
        {"rows": [("WINDOW", "min", 1, 0, 0, 2, False, False)]},
        {"rows": [("WINDOW", "min", 0, 1, 0, 2, False, False)]},
        {"rows": [("JUMP", "min", 0, 0, 0, 2, False, False)]},
        {"rows": [("WINDOW", "min", 0, 0, None, None, False, False)]},
        {"rows": [("WINDOW", "min", 0, 0, None, 1, False, False)]},
        {"rows": [("WINDOW", "min", 0, 0, -1, 1, False, False)]},
        {"rows": [("WINDOW", "min", 0, 0, -1, None, False, False)]},
        {"rows": [("WINDOW", "min", 0, 0, 1, None, False, False)]},
        {"rows": [("WINDOW", "min", 0, 0, 2, 1, False, False)]},
        {"result": 1},
    ],
)
def test_signs_of_what_is_no_program_are_refused(changes: dict[str, object]) -> None:
    assert signs().holds_at([(0, 0)])
    with pytest.raises(ValueError, match=r"^expected a program over regions$"):
        signs(**changes)


def test_signs_are_of_a_trace_of_numbers() -> None:
    for begin, last in ((1, 0), (-(2**62), 0), (0, 2**62)):
        with pytest.raises(ValueError, match=r"^expected a trace$"):
            signs(begin=begin, last=last)
    with pytest.raises(ValueError, match=r"^expected end='complete', 'cut' or 'open'$"):
        signs(end="never")
    root = [LOAD, (1, "MAP", "sqrt", 0, 0, 0.0, 0, 0)]
    with pytest.raises(ValueError, match=r"^a term is no number$"):
        signs(terms=root, result=1)
    with pytest.raises(ValueError, match=r"^expected a world, 0 to 4$"):
        signs(numbers=True).result(5)


class Counting:
    """A reader that counts times by a given function."""

    def __init__(self, *ticks: int) -> None:
        self.ticks = np.array(ticks)

    def counted(self, given: Any, last: object, dated: object) -> object:  # noqa: ANN401
        assert (last, dated) == ([-math.inf], None)
        return [(self.ticks, np.array([float(value) for value in given[0][1]]))], False


def test_what_the_reader_of_signs_counts_has_to_fit() -> None:
    whole = [(np.array([0.0, 3.0]), np.array([1, -1]))]  # integers, which the reader reads
    found = signs(given=whole, reader=Counting(0, 3 * 10**9))
    assert found.fails_at([(0, math.inf)]) == signs().fails_at([(0, math.inf)])
    with pytest.raises(RuntimeError, match=r"^the reader gave events that do not fit$"):
        signs(given=whole, reader=Counting(3, 3))
    with pytest.raises(RuntimeError, match=r"^the reader gave events that do not fit$"):
        signs(given=whole, reader=Counting(0, 2**62))


# Readers. ----------------------------------------------------------------------------------------


class Giving:
    """A reader that returns given values for any input."""

    def __init__(self, given: object) -> None:
        self.given = given
        self.refused: tuple[object, ...] = ()

    def read(self, *_: object) -> object:
        return self.given

    read_sample = read

    def refuse(self, *given: object) -> None:
        self.refused = given


def test_readers_that_give_too_little_are_noticed() -> None:
    row = ("LOAD", "x", 0, 0, 0.0, None, None)
    dense = native.DenseMachine(
        [row], 1, ("x",), 0, (1.0, 1, 1), (math.nan,), (), Giving(([], None))
    )
    with pytest.raises(RuntimeError, match=r"^the reader gave another number of columns$"):
        dense.update({"y": []})
    for given in ([], [1.0, 2.0]):
        sampled = native.DiscreteMachine([LOAD], 1, ("x",), 0, [(0, 0)], Giving(given))
        with pytest.raises(RuntimeError, match=r"^the reader gave another number of values$"):
            sampled.update("text")
        assert sampled.samples == 0


def test_a_term_that_is_nan_for_what_the_reader_gives_is_refused() -> None:
    rows = [LOAD, (1, "MAP", "sqrt", 0, 0, 0.0, 0, 0)]
    reader = Giving([-1.0])
    made = native.DiscreteMachine(rows, 2, ("x",), 1, [(1, 0)], reader)
    with pytest.raises(RuntimeError, match=r"^Python did not refuse the call$"):
        made.update("text")
    assert reader.refused == ([-1.0], 0)
    messages = set()
    for backend in ("native", "python"):
        for kind in (Monitor, EpisodeMonitor):
            with pytest.raises(InputError) as refusal:
                kind("sqrt(x) > 0", backend=backend).update(Fraction(-1))
            messages.add(str(refusal.value))
    assert len(messages) == 1


@pytest.mark.parametrize("backwards", [False, True])
def test_a_nan_that_no_term_reads_is_refused_in_a_trace(*, backwards: bool) -> None:
    reader = Giving([])
    rows = [LOAD, (1, "WINDOW", "min", 0, 0, 0.0, 2, 0)]
    made = native.DiscreteMachine(rows, 1, ("x", "y"), 1, [(1, 0), (1, 0)], reader)
    x, y = np.array([3.0, 1.0, 2.0]), np.array([0.0, math.nan, 0.0])
    with pytest.raises(RuntimeError, match=r"^Python did not refuse the call$"):
        made.evaluate([x, y], 3, backwards=backwards)
    assert repr(reader.refused) == "([1.0, nan], 1)"


def test_a_mask_of_the_reader_may_lie_anywhere() -> None:
    class Reader:
        def mask(self, given: Any) -> Any:  # noqa: ANN401 - of the test
            return given

    made = native.DiscreteBatch([LOAD], 1, ("x",), 0, 0, 3, Reader())
    for begin in range(3):
        mask = np.array([True, False, True, False, True])[begin : begin + 3]
        made.update(np.ones((3, 1)), mask.view(np.recarray))
    assert made.samples.tolist() == [2, 1, 2]


def test_a_machine_observes_its_result_first_and_its_variables_are_names() -> None:
    for observed in ([], [(1, 0)]):
        with pytest.raises(ValueError, match=r"^expected the result first among the observed$"):
            native.DiscreteMachine([LOAD], 1, ("x",), 0, observed, object())
    with pytest.raises(TypeError, match="str"):
        native.DiscreteMachine([LOAD], 1, (1,), 0, [(0, 0)], object())


def test_a_second_variable_of_a_machine_of_one_is_unknown() -> None:
    messages = set()
    for kind in (rtamt.dense.Monitor, rtamt.dense.EpisodeMonitor):
        for backend in ("native", "python"):
            with pytest.raises(InputError) as refusal:
                kind("x > 0", backend=backend).update({"x": [(0.0, 1.0)], "y": []})
            messages.add(str(refusal.value))
    assert messages == {"unknown variable 'y'; the variables are x"}


def test_events_that_were_not_made_are_none() -> None:
    for backend in ("native", "python"):
        monitor = rtamt.dense.Monitor("x > 0", backend=backend)
        with pytest.raises(AttributeError, match="given"):
            monitor.update({"x": rtamt.dense.Events.__new__(rtamt.dense.Events)})
        assert monitor.update({"x": rtamt.dense.Events([0.0], [1.0])}) == []


# Slots. ------------------------------------------------------------------------------------------


def test_slots_hold_objects_of_a_monitor_that_can_be_forgotten() -> None:
    with pytest.raises(TypeError, match=r"^expected a slot that can be written$"):
        native.read_only(vars(type)["__dictoffset__"])

    class Bare:
        __slots__ = ("a", "b", "c", "d")

    slots = [vars(Bare)[name] for name in Bare.__slots__]
    machine = EpisodeMonitor("always(x > 0)", backend="native")._machine
    for verdicts in ((), tuple(Verdict)[:2]):
        with pytest.raises(ValueError, match=r"^expected 4 slots and 3 verdicts$"):
            machine.show_in(Bare(), slots, verdicts)
    with pytest.raises(TypeError, match="weak reference"):
        machine.show_in(Bare(), slots, tuple(Verdict))
    assert machine.update(2.0) == 2.0


# Monitor sets. -----------------------------------------------------------------------------------


def monitor_set(**changes: object) -> Any:  # noqa: ANN401 - of the native module
    made: dict[str, Any] = {
        "machines": [EpisodeMonitor("always(x > y)", backend="native")._machine],
        "places": [(0, 1)],
        "reads": [0, "y"],
        "decided": None,
        "seen": None,
        "number": float,
    }
    return native.EpisodeMonitorSet(**{**made, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"places": []}, "expected the places of the variables of each machine"),
        ({"places": [(0,)]}, "expected a place for each variable of a machine"),
        ({"places": [(0, 2)]}, "expected places in a sample"),
        ({"reads": [(np.ones(2), 2), 1]}, "expected an element of an array of float64 or float32"),
        ({"reads": [(np.ones(2, int), 0), 1]}, "expected an element of an array of"),
    ],
)
def test_a_monitor_set_reads_a_number_for_each_variable(
    changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        monitor_set(**changes)


def test_a_monitor_set_reads_keys_arrays_and_functions() -> None:
    held, seen = np.array([5.0, 7.0]), list[list[float]]()
    keys = (1, 2, 3)
    made = monitor_set(reads=[keys, (held, 1)], seen=seen.append)
    assert made.feed({keys: 9})[0] == 2.0
    with pytest.raises(RuntimeError, match=r"^expected what elements are read from$"):
        made.feed()
    with pytest.raises(KeyError):
        made.feed({})
    assert monitor_set(reads=[lambda *args: len(args), (held, 0)]).feed(0, 0)[0] == -3.0
    held.resize(1, refcheck=False)
    with pytest.raises(RuntimeError, match=r"^an array has lost the element that is read$"):
        made.feed({keys: 9})
    assert seen == [[9.0, 7.0]]


# Clocks of operators. ----------------------------------------------------------------------------


def clock(**changes: object) -> Any:  # noqa: ANN401 - of the native module
    made: dict[str, Any] = {
        "kind": "oldest",
        "event": "holds",
        "begin": 0,
        "end": 5,
        "late": 0,
        "operands": ((0, 0),),
    }
    return native.ClockBatch([OperatorClock(**{**made, **changes})], 2, 3)


def test_clocks_are_those_of_parts_that_are_fed() -> None:
    assert clock().samples.tolist() == [0, 0, 0]
    row = r"^expected a row of rtamt\.machines\.clocks\.OperatorClock$"
    changes: Mapping[str, object]
    for changes in ({"kind": "eldest"}, {"event": "held"}):
        with pytest.raises(ValueError, match=row):
            clock(**changes)
    for changes in ({"operands": ((2, 0),)}, {"operands": ((2, 0), (0, 0))}, {"asked": 2}):
        with pytest.raises(ValueError, match=r"^expected clocks of the parts that are fed$"):
            clock(**changes)


# Objects in arrays. ------------------------------------------------------------------------------


def test_what_numpy_holds_as_no_object_is_spread_as_none() -> None:
    """Of an array whose memory a C library has cleared."""
    values = np.array([None, object()])
    ctypes.memset(values.ctypes.data, 0, ctypes.sizeof(ctypes.c_void_p))
    info: dict[str, Any] = {}
    assert native.spread_entries([(info, "a", "_a", values, None)], np.array([2, 0]), 3) == 1
    assert info["a"].tolist() == [values[1], None, None]
    assert info["_a"].tolist() == [True, False, True]


def test_keys_of_entries_that_no_dictionary_takes_are_refused() -> None:
    keys: list[Any] = [[], {}]
    for key in keys:
        info: dict[str, Any] = {}
        with pytest.raises(TypeError, match="unhashable"):
            native.spread_entries([(info, key, "_a", np.ones(1), None)], np.array([0]), 2)
        assert info == {}


def test_no_more_rows_are_spread_than_there_are_dictionaries() -> None:
    groups: list[dict[str, Any]] = [{}, {}]
    columns = [(groups, "a", "_a", np.ones((3, 1)), None)]
    assert native.spread_entries(columns, np.array([0]), 2) == 0
    assert groups == [{}, {}]


def test_masks_of_other_entries_are_no_masks() -> None:
    batch = VectorEpisodeMonitor("always(x > 0)", 3, backend="native")._machine
    for mask in (np.ones(2, bool), np.ones(3), np.ones((3, 3), bool), np.ones(6, bool)[::2]):
        with pytest.raises(ValueError, match=r"^expected contiguous arrays of the batches' shape$"):
            native.reset_batches((batch,), mask)
        assert native.feed_batches((batch,), ((0,),), np.ones((3, 1)), mask) == 0
    assert batch.samples.tolist() == [0, 0, 0]


def test_a_batch_has_an_entry() -> None:
    with pytest.raises(ValueError, match=r"^expected an entry, got none$"):
        native.EpisodeBatch([LOAD], [ENDLESS], [1], [0], ("x",), 0, object())


@pytest.mark.parametrize("count", [MAX_UNKNOWNS, MAX_UNKNOWNS + 1])
def test_few_operators_without_an_end_may_stand_inside_others(count: int) -> None:
    rows = [("WINDOW", "min", i, i, 0, None, False, False) for i in range(count)]
    rows.append(("WINDOW", "min", count, count, 0, None, False, False))
    given = ([LOAD], rows, [count + 1], range(count + 1), ("x",), EpisodeMonitor("x > 0")._reader)
    if count > MAX_UNKNOWNS:
        with pytest.raises(ValueError, match=r"^too many unknowns$"):
            native.EpisodeMachine(*given)
        return
    assert native.EpisodeMachine(*given).update(2.0) == 2.0
