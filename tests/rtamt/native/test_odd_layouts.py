"""Arrays of every layout in the native functions that read arrays: correct, or left to Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

import rtamt
from rtamt import VectorEpisodeMonitor, VectorMonitor
from rtamt.machines.clocks import OperatorClock

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Array = NDArray[Any]
Layout = Callable[[Array], Any]


def misaligned(array: Array) -> Array:
    """Return the same in memory that starts one byte after an aligned address."""
    memory = np.zeros(array.nbytes + 1, np.uint8)
    found = memory[1:].view(array.dtype).reshape(array.shape)
    found[...] = array
    return found


def with_gaps(array: Array) -> Array:
    """Return the same with a byte between the parts of the first dimension."""
    inner = (array.dtype, array.shape[1:])
    found = np.zeros(len(array), [("its", *inner), ("gap", "u1")])["its"]
    found[...] = array
    return found


def spread_out(array: Array) -> Array:
    """Return the same with other numbers between the elements."""
    found = np.full([2 * size for size in array.shape], 77).astype(array.dtype)
    view = found[tuple(slice(None, None, 2) for _ in array.shape)]
    view[...] = array
    return view


SAME: dict[str, Layout] = {
    "C": lambda a: a,
    "Fortran": np.asfortranarray,
    "backwards": lambda a: np.ascontiguousarray(a[::-1])[::-1],
    "spread out": spread_out,
    "misaligned": misaligned,
    "with gaps": with_gaps,
    "with gaps in the other dimension": lambda a: with_gaps(a.T).T,
    "read only": lambda a: np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape),
    "another byte order": lambda a: a.astype(a.dtype.newbyteorder()),
    "a subclass": lambda a: a.view(np.recarray),
    "lists": lambda a: a.tolist(),
}
"""The same numbers in another form."""


@pytest.mark.parametrize("layout", SAME)
@pytest.mark.parametrize("kind", [VectorMonitor, VectorEpisodeMonitor])
def test_tables_of_entries(kind: Any, layout: str) -> None:  # noqa: ANN401 - of two classes
    table = np.arange(6.0).reshape(3, 2)
    found, expected = (
        kind("historically[0:2](x - 2 * y > 0)", 3, backend="native") for _ in range(2)
    )
    for scale in (1.0, -1.0):
        given = SAME[layout](scale * table)
        assert found.update(given).tolist() == expected.update(scale * table).tolist()


@pytest.mark.parametrize("begin", [0, 1])
@pytest.mark.parametrize("layout", [name for name in SAME if name != "lists"])
def test_masks_of_entries(layout: str, begin: int) -> None:
    mask = np.array([False, True, False, True])[begin : begin + 3]
    for kind in (VectorMonitor, VectorEpisodeMonitor):
        monitor = kind("historically(x > 0)", 3, backend="native")
        monitor.update(np.ones((3, 1)), SAME[layout](mask))
        assert monitor.samples.tolist() == mask.astype(int).tolist()


@pytest.mark.parametrize("layout", SAME)
def test_tables_that_batches_are_fed(layout: str) -> None:
    table = np.arange(6.0).reshape(3, 2)
    batch, other = (
        VectorEpisodeMonitor("x - 2 * y > 0", 3, backend="native")._machine for _ in range(2)
    )
    if native.feed_batches((batch,), ((0, 1),), SAME[layout](table), None) == 0:
        assert layout not in {"C", "Fortran", "backwards", "spread out", "read only"}
        assert batch.samples.tolist() == [0, 0, 0]
        return
    assert batch.robustness.tolist() == other.update(table).tolist()


@pytest.mark.parametrize("layout", SAME)
def test_pairs_of_events(layout: str) -> None:
    events = np.array([[0.0, 1.0], [2.0, 3.0], [5.0, -1.0]])
    monitor = rtamt.dense.Monitor("x > 0", backend="native")
    found = monitor.update({"x": SAME[layout](events)}) + monitor.finish()
    assert found == [tuple(event) for event in events.tolist()]


def test_events_whose_rows_lie_in_one_another() -> None:
    numbers = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    for steps, expected in (
        ((16, 8), [(0.0, 1.0), (2.0, 3.0), (4.0, 5.0)]),
        ((8, 8), [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0)]),
        ((16, 0), [(0.0, 0.0), (2.0, 2.0), (4.0, 4.0)]),
    ):
        monitor = rtamt.dense.Monitor("x > 0", backend="native")
        found = monitor.update({"x": as_strided(numbers, (3, 2), steps)}) + monitor.finish()
        assert found == expected
    messages = set()
    for backend in ("native", "python"):
        monitor = rtamt.dense.Monitor("x > 0", backend=backend)
        for wrong in (numbers.reshape(3, 2)[:, :1], as_strided(numbers, (2, 3), (16, 8))):
            with pytest.raises(ValueError, match="events") as refusal:
                monitor.update({"x": wrong})
            messages.add(str(refusal.value))
    assert len(messages) == 2


@pytest.mark.parametrize("layout", SAME)
def test_times_that_are_counted(layout: str) -> None:
    times = np.array([0.0, 0.001, 5.0])
    found = native.ticks((1e3, 1000, 1), SAME[layout](times))
    if found is None:
        assert layout not in {"C", "Fortran", "read only"}
    else:
        assert found.tolist() == [0, 1, 5000]
    for shape in ((), (1, 3), (3, 1), (1, 1, 3)):
        assert native.ticks((1e3, 1000, 1), np.ones(shape)) is None


WRONG: dict[str, Layout] = {
    "no dimension": lambda a: a.reshape(-1)[:1].reshape(()),
    "three dimensions": lambda a: a.reshape(1, *a.shape[-1:], -1) if a.ndim < 2 else a[None],
    "spread out": spread_out,
    "backwards": lambda a: np.ascontiguousarray(a[::-1])[::-1],
    "one element more": lambda a: np.append(a.reshape(-1), a.reshape(-1)[:1]),
    "one element less": lambda a: a.reshape(-1)[1:],
    "other numbers": lambda a: a.astype(np.float32),
    "lists": lambda a: a.tolist(),
}
"""Arrays that native functions on rows of entries do not accept."""

MISALIGNED: dict[str, Layout] = {"misaligned": misaligned}


def clocks() -> Any:  # noqa: ANN401 - of the native module
    return native.ClockBatch([OperatorClock("oldest", "holds", 0, 5, 0, ((0, 0),))], 2, 2)


@pytest.mark.parametrize("layout", [*WRONG, "misaligned"])
def test_rows_that_clocks_do_not_take(layout: str) -> None:
    values = np.array([[1.0, -1.0], [2.0, 3.0]])
    batch = clocks()
    with pytest.raises(ValueError, match=r"^expected a contiguous row of each part$"):
        batch.feed({**WRONG, **MISALIGNED}[layout](values))
    if layout != "misaligned":
        with pytest.raises(ValueError, match=r"^expected a mask of one boolean for each entry$"):
            batch.feed(values, WRONG[layout](np.ones(2, np.bool_)))
    assert batch.samples.tolist() == [0, 0]
    for taken in (values, values.reshape(-1), np.asfortranarray(values.reshape(1, 4))):
        batch.feed(taken)
    assert batch.samples.tolist() == [3, 3]


@pytest.mark.parametrize("layout", [*WRONG, "misaligned"])
def test_logs_that_are_not_written(layout: str) -> None:
    batch = VectorEpisodeMonitor("always(x > 0)", 2, backend="native")._machine
    batch.update(np.array([[1.0], [-1.0]]))
    log: dict[str, Any] = {
        "settled_at": np.full(2, -1),
        "violated": np.zeros(2, np.bool_),
        "failed": np.zeros(2, np.bool_),
        "first": np.full(2, -1),
        "violated_at": np.full(2, -1),
    }
    for name, array in log.items():
        if layout == "misaligned" and array.dtype == np.bool_:
            continue
        odd = {**log, name: {**WRONG, **MISALIGNED}[layout](array)}
        with pytest.raises(ValueError, match=r"^expected contiguous arrays of the batches' shape$"):
            native.note_verdicts((batch,), None, **odd)
        with pytest.raises(ValueError, match=r"^expected contiguous arrays of the batches' shape$"):
            native.forget_verdicts(None, 1, 2, **odd)
    native.note_verdicts((batch,), None, **log)
    assert log["settled_at"].tolist() == [-1, 0]
    assert log["first"].tolist() == [-1, 0]


@pytest.mark.parametrize("kind", [np.float64, np.int64, np.bool_, object])
@pytest.mark.parametrize("layout", [*WRONG, "misaligned"])
def test_values_of_entries_that_are_left_to_python(layout: str, kind: Any) -> None:  # noqa: ANN401
    one, rows = np.array([1, 2]).astype(kind), np.array([[1, 2], [3, 4]]).astype(kind)
    if layout == "misaligned" and kind in {np.bool_, object}:
        return
    for values in (one, rows):
        places: Any = {} if values.ndim == 1 else [{}, {}]
        odd = {**WRONG, **MISALIGNED}[layout](values)
        columns = [(places, "a", "_a", odd, None)]
        assert native.spread_entries(columns, np.array([1, 0]), 2) == 0
        assert places in ({}, [{}, {}])
    groups: list[dict[str, Any]] = [{}, {}]
    assert native.spread_entries([(groups, "a", "_a", rows, None)], np.array([1, 0]), 2) == 1
    assert [group["a"].tolist() for group in groups] == [
        rows[0, ::-1].tolist(),
        rows[1, ::-1].tolist(),
    ]
