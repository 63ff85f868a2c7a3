"""Memory of native machines: windows that fill with samples, and unusual arrays."""

from __future__ import annotations

import copy
import itertools
import resource
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rtamt
from rtamt import Monitor, VectorMonitor

pytest.importorskip("rtamt._native", reason="no compiler was at hand")


def faults() -> int:
    """Return the number of pages that this process was the first to touch."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


@pytest.mark.parametrize("text", ["always[0:{}](x > 0)", "(x > 0) and next(once[{0}:{0}](x > 0))"])
def test_a_long_window_touches_memory_as_samples_come(text: str) -> None:
    before = faults()
    monitor = Monitor(text.format(50_000_000), backend="native")
    for x in range(100):
        monitor.update(float(x))
    twin = copy.copy(monitor)
    monitor.reset()
    assert twin.samples == 100
    assert faults() - before < 50_000  # of 190,000; the address sanitizer touches some itself


@pytest.mark.parametrize("length", [*range(1, 9), 33, 100, 131])
@pytest.mark.parametrize(
    "text",
    ["historically[0:{}](x > 0)", "(x > 0) since[0:{}] (x < 3)", "prev(once[{0}:{0}](x > 0))"],
)
def test_a_window_that_fills_is_the_same_by_samples_by_blocks_and_by_snapshots(
    text: str, length: int
) -> None:
    values = np.random.default_rng(length).integers(-5, 5, 3 * length + 40).astype(float)
    one, many = (Monitor(text.format(length), backend="native") for _ in range(2))
    new = one._machine.state()
    sizes, begin = itertools.cycle((1, 2, 15, 16, 17, 5, 64)), 0
    while begin < len(values):
        block = values[begin : begin + next(sizes)]
        begin += len(block)
        expected = [one.update(x) for x in block]
        assert many.update_many({"x": block}).tolist() == expected
        assert one._machine.state() == many._machine.state()
        many = copy.copy(many)
    one.reset()
    assert one._machine.state() == new
    assert [one.update(x) for x in values] == rtamt.Monitor(
        text.format(length), backend="python"
    ).update_many({"x": values}).tolist()


def misaligned(values: object) -> Any:  # noqa: ANN401 - an array of any shape
    """Return the values at an address that is wrong for doubles."""
    array = np.asarray(values, dtype=np.float64)
    odd = np.frombuffer(b"\0" + array.tobytes(), np.uint8)[1:].view(np.float64)
    assert not odd.flags.aligned
    return odd.reshape(array.shape)


TEXT = "always[0:1](x > y)"
TABLE = np.array([[3.0, 1.0], [2.0, 5.0], [4.0, 0.5]])
READERS: dict[str, Callable[[Callable[[Any], Any]], object]] = {
    "update": lambda odd: [Monitor("x > y").update(odd(row)) for row in TABLE],
    "update_many": lambda odd: (
        Monitor(TEXT).update_many({"x": odd(TABLE[:, 0]), "y": odd(TABLE[:, 1])})[1:].tolist()
    ),
    "update_many of a table": lambda odd: Monitor(TEXT).update_many(odd(TABLE))[1:].tolist(),
    "evaluate": lambda odd: rtamt.evaluate(
        TEXT, {"x": odd(TABLE[:, 0]), "y": odd(TABLE[:, 1])}
    ).tolist(),
    "evaluate backwards": lambda odd: rtamt.evaluate(
        "always(x > y)", {"x": odd(TABLE[:, 0]), "y": TABLE[:, 1]}
    ).tolist(),
    "evaluate of one variable": lambda odd: rtamt.evaluate("x > 3", odd(TABLE[:, :1])).tolist(),
    "evaluate_many": lambda odd: rtamt.evaluate(TEXT, odd([TABLE, TABLE])).tolist(),
    "entries": lambda odd: VectorMonitor("x > y", 3).update(odd(TABLE)).tolist(),
    "events": lambda odd: rtamt.dense.Monitor("x > 0").update(
        x=rtamt.dense.Events(odd([0.0, 1.0, 2.0]), odd([1.0, -1.0, 2.0]))
    ),
    "events of a table": lambda odd: rtamt.dense.Monitor("x > 0").update(
        x=odd([[0.0, 1.0], [1.0, -1.0], [2.0, 2.0]])
    ),
}


@pytest.mark.parametrize("reader", READERS)
def test_misaligned_numbers_are_read_as_what_they_are(reader: str) -> None:
    read = READERS[reader]
    assert read(misaligned) == read(np.asarray)


def test_every_boolean_that_is_not_0_is_one() -> None:
    odd = np.array([2, 0, 255], np.uint8).view(np.bool_)
    assert Monitor("x > 0.5").update_many({"x": odd}).tolist() == [0.5, -0.5, 0.5]
    assert rtamt.evaluate("x > 0.5", {"x": odd}).tolist() == [0.5, -0.5, 0.5]
    assert [Monitor("x > 0.5").update(odd[i : i + 1]) for i in range(3)] == [0.5, -0.5, 0.5]
    assert [Monitor("x > 0.5").update(x) for x in odd] == [0.5, -0.5, 0.5]
