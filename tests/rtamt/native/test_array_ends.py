"""Arrays between two protected pages: reading one number too many ends the process."""

from __future__ import annotations

import ctypes
import mmap
import sys
from collections.abc import Callable

import numpy as np
import pytest
from bits import bits
from numpy.typing import ArrayLike, NDArray

from rtamt import (
    EpisodeMonitor,
    Monitor,
    VectorEpisodeMonitor,
    VectorMonitor,
    evaluate,
)
from rtamt.inputs.samples import SampleReader

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Array = NDArray[np.float64]
PAGE = mmap.PAGESIZE


def _close(address: int) -> None:
    """Forbid the page at an address."""
    page = ctypes.c_void_p(address), ctypes.c_size_t(PAGE)
    if sys.platform == "win32":
        no_access, before = 1, ctypes.c_ulong()
        assert ctypes.windll.kernel32.VirtualProtect(*page, no_access, ctypes.byref(before))
    else:
        no_access = 0
        assert ctypes.CDLL(None).mprotect(*page, no_access) == 0


def between(values: ArrayLike, edge: str) -> Array:
    """Return a copy of an array that touches the protected page after it, or the one before it."""
    array = np.asarray(values, np.float64)
    room = -(-array.nbytes // PAGE) * PAGE
    memory = mmap.mmap(-1, room + 2 * PAGE)
    whole = np.frombuffer(memory, np.uint8)
    for page in (0, PAGE + room):
        _close(whole.ctypes.data + page)
    begin = PAGE + (room - array.nbytes if edge == "end" else 0)
    copy = whole[begin : begin + array.nbytes].view(np.float64).reshape(array.shape)
    copy[...] = array
    return copy


edges = pytest.mark.parametrize("edge", ["begin", "end"])

TEXTS = (
    "always[0:5](x + y > -2)",
    "x and eventually[0:30] y",
    "prev x or next next y",
    "(x until[3:9] y) since[2:8] x",
    "once x and y",
    "pow(x, 0) > y",
    "p = x > 0; q = y > 0",
)
LENGTHS = (1, 2, 7, 8, 255, 256, 257, 4095, 4096, 4097, 4700)


def trace(n: int) -> dict[str, Array]:
    random = np.random.default_rng(n)
    return {"x": random.normal(size=n), "y": random.normal(size=n)}


@pytest.mark.slow(keep=60)
@edges
@pytest.mark.parametrize("n", LENGTHS)
@pytest.mark.parametrize("text", [*TEXTS, "always (x implies eventually y)", "once(x or always y)"])
def test_a_whole_trace_is_read_from_its_begin_to_its_end(text: str, n: int, edge: str) -> None:
    data = trace(n)
    held = {name: between(values, edge) for name, values in data.items()}
    found = evaluate(text, held, backend="native")
    assert bits(found) == bits(evaluate(text, data, backend="python"))


@edges
@pytest.mark.parametrize("n", LENGTHS)
@pytest.mark.parametrize("late", [1, 30, 5000])
def test_a_variable_is_not_read_behind_a_trace_by_what_goes_on_there(
    late: int, n: int, edge: str
) -> None:
    reader = SampleReader(Monitor("x + y > 0").program)
    loads = [(i, "LOAD", name, i, 0, 0.0, 0, 0) for i, name in enumerate("xy")]
    delay = (2, "DELAY", "", 0, 0, 0.0, late, 0)
    observed = [(2, 0), (2, late)]
    machine = native.DiscreteMachine([*loads, delay], 2, ("x", "y"), 2, observed, reader)
    x, y = (between(values, edge) for values in trace(n).values())
    assert bits(machine.evaluate([x, y], n)[0]) == bits(x)
    assert bits(machine.evaluate([x, y], n, backwards=True)[0]) == bits(x)


@edges
@pytest.mark.parametrize("n", LENGTHS)
@pytest.mark.parametrize("window", ["min", "max", "until", "since"])
def test_a_window_over_variables_reads_them_from_their_begin_to_their_end(
    window: str, n: int, edge: str
) -> None:
    """A trace that is not read from its end has its columns read in place."""
    reader = SampleReader(Monitor("x + y > 0").program)
    loads = [(i, "LOAD", name, i, 0, 0.0, 0, 0) for i, name in enumerate("xy")]
    row = (2, "WINDOW", window, 0, int(window in ("until", "since")), 0.0, 31, 0)
    machine = native.DiscreteMachine([*loads, row], 2, ("x", "y"), 2, [(2, 0), (2, 0)], reader)
    data = trace(n).values()
    found = machine.evaluate([between(values, edge) for values in data], n)[0]
    assert bits(found) == bits(machine.run(list(data), n)[0])


@pytest.mark.slow(keep=50)
@edges
@pytest.mark.parametrize("n", LENGTHS)
@pytest.mark.parametrize("text", TEXTS)
def test_a_block_is_read_from_its_begin_to_its_end(text: str, n: int, edge: str) -> None:
    data = trace(n)
    held = {name: between(values, edge) for name, values in data.items()}
    mine, definition = (Monitor(text, backend=b) for b in ("native", "python"))
    assert bits(mine.update_many(held)) == bits(definition.update_many(data))


@edges
@pytest.mark.parametrize("entries", [1, 3, 8, 17, 64])
@pytest.mark.parametrize("kind", [VectorMonitor, VectorEpisodeMonitor])
def test_rows_of_entries_are_read_from_their_begin_to_their_end(
    kind: Callable[..., VectorMonitor | VectorEpisodeMonitor], entries: int, edge: str
) -> None:
    text = "always(x implies eventually[0:3] y)"
    if kind is VectorMonitor:
        text = "x and once[0:3] y"
    mine, definition = (kind(text, entries, backend=b) for b in ("native", "python"))
    random = np.random.default_rng(entries)
    for _ in range(9):
        values = random.normal(size=(entries, 2))
        mask = random.random(entries) < 0.7
        found = mine.update(between(values, edge), mask)
        assert bits(found) == bits(definition.update(values, mask))


@edges
def test_a_sample_is_read_from_its_begin_to_its_end(edge: str) -> None:
    text = "always(x implies eventually[0:3] y)"
    mine, definition = (EpisodeMonitor(text, backend=b) for b in ("native", "python"))
    for values in np.random.default_rng(0).normal(size=(9, 2)):
        assert mine.update(between(values, edge)) == definition.update(values)
