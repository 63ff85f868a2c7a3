"""Traces in C++ against the definition of windows in Python, bit by bit."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from numpy.typing import NDArray

import rtamt
from rtamt.inputs.samples import SampleReader
from rtamt.machines.backend import Backend
from rtamt.machines.windows import DelayLine, make_window
from rtamt.program.algebra import FOLDS

if TYPE_CHECKING:
    from rtamt._native import DiscreteMachine

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

READER = SampleReader(rtamt.Monitor("x + y > 0").program)
BLOCK = 4096
LENGTHS = (0, 1, 2, 3, 4, 5, 8, 9, 16, 17, 33, 64, 65, 127, 1000, 2047, 2048, 2049, 5000)
COMMON = (1.0, 0.5, 2.0, 3.0, -1.0, 0.0, math.inf)


def machine(*rows: tuple[object, ...]) -> DiscreteMachine:
    """Return instructions after two inputs, the first of which is observed."""
    loads = [(i, "LOAD", name, i, 0, 0.0, 0, 0) for i, name in enumerate("xy")]
    made = native.DiscreteMachine([*loads, *rows], 2, ("x", "y"), 2, [(2, 0), (2, 0)], READER)
    return cast("DiscreteMachine", made)


def bits(values: Sequence[float] | NDArray[np.float64]) -> list[int]:
    """Return bits that distinguish 0.0 and -0.0."""
    return cast("list[int]", np.array(values, dtype=np.float64).view(np.int64).tolist())


def columns(rows: Sequence[tuple[float, float]]) -> list[NDArray[np.float64]]:
    return [np.array(column) for column in zip(*rows, strict=True)]


def trace(n: int, seed: int, minus_zeros: range) -> list[tuple[float, float]]:
    """Samples of which only some may be -0.0, so that windows slide over and away from them."""
    rng = random.Random(seed)

    def value(i: int) -> float:
        if i in minus_zeros and rng.random() < 0.02:
            return -0.0
        return rng.choice(COMMON)

    return [(value(i), value(i)) for i in range(n)]


@pytest.mark.slow(keep=40)
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("name", FOLDS)
def test_a_window_over_a_trace_gives_the_bits_of_its_definition(name: str, length: int) -> None:
    fold, start = FOLDS[name], 3
    made = machine((2, "WINDOW", name, 0, fold.width - 1, 0.0, length, start))
    for n, minus_zeros in ((2, range(2)), (2 * BLOCK + 77, range(BLOCK + 9, BLOCK + 500))):
        rows = trace(n, length, minus_zeros)
        window = make_window(fold, length or None)
        expected = [
            window.push(row[: fold.width] if i >= start else fold.identity)[-1]
            for i, row in enumerate(rows)
        ]
        assert bits(made.evaluate(columns(rows), n)[0]) == bits(expected)
        backwards = [column[::-1] for column in columns(rows)]
        assert bits(made.evaluate(backwards, n, backwards=True)[0][::-1]) == bits(expected)
    assert made.samples == 0


@pytest.mark.parametrize("length", [2, 3, 9, 127])
@pytest.mark.parametrize("name", ["min", "max"])
def test_a_window_keeps_a_zero_of_the_block_before_it(name: str, length: int) -> None:
    fold, window = FOLDS[name], make_window(FOLDS[name], length)
    values = np.zeros(BLOCK + length - 1)
    values[BLOCK - 1] = -0.0
    made = machine((2, "WINDOW", name, 0, fold.width - 1, 0.0, length, 0))
    expected = [window.push((value,))[-1] for value in values.tolist()]
    assert bits(made.evaluate([values, values], len(values))[0]) == bits(expected)


@pytest.mark.parametrize(("name", "sign"), [("min", -1.0), ("max", 1.0)])
def test_a_new_extreme_is_seen_at_every_place_of_a_chunk(name: str, sign: float) -> None:
    chunk = 64
    values = np.zeros(chunk * chunk)
    values[:: chunk + 1] = sign * np.arange(1, chunk + 1)
    accumulate = np.minimum if name == "min" else np.maximum
    made = machine((2, "WINDOW", name, 0, 0, 0.0, 0, 0))
    expected = accumulate.accumulate(values)
    assert bits(made.evaluate([values, values], len(values))[0]) == bits(expected)


@pytest.mark.parametrize("length", [1, 5, 300, BLOCK, BLOCK + 1])
def test_a_delay_over_a_trace_gives_the_bits_of_its_definition(length: int) -> None:
    made = machine((2, "DELAY", "", 0, 0, 0.0, length, 0))
    rows, line = trace(2 * BLOCK + 5, length, range(2 * BLOCK)), DelayLine(length)
    expected = [line.push(x) for x, _ in rows]
    assert bits(made.evaluate(columns(rows), len(rows))[0]) == bits(expected)


def test_what_memory_held_before_is_not_taken_for_a_register() -> None:
    """Deleted machines leave the number of the register that the next ones write."""
    window = (2, "WINDOW", "max", 0, 0, 0.0, 31, 0)
    two = float(np.array([2]).view(np.float64)[0])
    constants = [(i, "CONST", "", 0, 0, two, 0, 0) for i in (3, 4)]
    x, y = (np.random.default_rng(seed).normal(size=2 * BLOCK) for seed in range(2))
    expected = bits(machine(window).run([x, y], 2 * BLOCK)[0])
    gone = [machine(window, *constants) for _ in range(20)]
    del gone
    for made in [machine(window) for _ in range(20)]:
        assert bits(made.evaluate([x, y], 2 * BLOCK)[0]) == expected


@pytest.mark.parametrize("backend", ["native", "python"])
def test_a_term_without_a_value_names_its_first_sample_whichever_way_the_trace_is_read(
    backend: Backend,
) -> None:
    values = np.ones(BLOCK + 50)
    values[[40, BLOCK + 7]] = -1.0
    for text in ("always(sqrt(x) > 0)", "historically(sqrt(x) > 0)"):
        with pytest.raises(rtamt.InputError, match=r"'sqrt\(x\)' is not a number at sample 40"):
            rtamt.evaluate(text, {"x": values}, backend=backend)


@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize(
    "text", ["always(x > y)", "once(x > y)", "pow(x, 0) > y", "p = x > 0; q = y > 0"]
)
def test_a_nan_is_found_in_every_variable_or_held(text: str, backend: Backend) -> None:
    values = np.ones(BLOCK + 50)
    values[[30, BLOCK + 7]] = math.nan
    data = {"x": values, "y": np.zeros(len(values))}
    with pytest.raises(
        rtamt.InputError, match=r"^variable 'x' is nan at sample 30; pass nan='hold'"
    ):
        rtamt.evaluate(text, data, backend=backend)
    held = rtamt.evaluate(text, data, backend=backend, nan="hold")
    expected = rtamt.evaluate(text, data | {"x": np.ones(len(values))})
    assert bits(held) == bits(expected)
