"""The machine in C++ against its definition in Python, instruction by instruction, bit by bit."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from rtamt import Monitor, evaluate
from rtamt.inputs.samples import SampleReader
from rtamt.machines.windows import DelayLine, make_window
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import Instruction
from rtamt.program.program import Delay

if TYPE_CHECKING:
    from rtamt._native import DiscreteMachine

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

READER = SampleReader(Monitor("x + y > 0").program)
Row = tuple[object, ...]
X: Row = (0, "LOAD", "x", 0, 0, 0.0, 0, 0)
Y: Row = (1, "LOAD", "y", 1, 0, 0.0, 0, 0)

SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -2.0, 3.0, 710.0, 1e-320, 1e308, math.inf, -math.inf)
LENGTHS = (1, 2, 3, 4, 5, 6, 9, 16, 37)
BLOCKS = (1, 2, 7, 255, 256, 257, 300)


def bits(values: Sequence[float] | NDArray[np.float64]) -> list[int]:
    """Return bits that distinguish 0.0 and -0.0, and treat every nan as equal."""
    array = np.array(values, dtype=np.float64)
    array[np.isnan(array)] = math.nan
    return cast("list[int]", array.view(np.int64).tolist())


def machine(row: Row) -> DiscreteMachine:
    """Return a machine with one instruction after two inputs; after the terms it may be nan."""
    made = native.DiscreteMachine([X, Y, row], 2, ("x", "y"), 2, [(2, 0), (2, 0)], READER)
    return cast("DiscreteMachine", made)


def samples(n: int, seed: int = 0) -> list[tuple[float, float]]:
    """Few values, so that equal ones meet; also infinities and both zeros."""
    rng = random.Random(seed)
    return [(rng.choice(SPECIAL), rng.choice(SPECIAL)) for _ in range(n)]


def columns(rows: Sequence[tuple[float, float]]) -> list[NDArray[np.float64]]:
    return [np.array(column) for column in zip(*rows, strict=True)]


def chunked(rows: Sequence[tuple[float, float]], seed: int) -> list[Sequence[tuple[float, float]]]:
    rng, chunks, begin = random.Random(seed), [], 0
    while begin < len(rows):
        end = begin + rng.choice(BLOCKS)
        chunks.append(rows[begin:end])
        begin = end
    return chunks


def played(made: DiscreteMachine, rows: Sequence[tuple[float, float]], seed: int) -> list[float]:
    """Samples and blocks in turn."""
    values: list[float] = []
    for chunk in chunked(rows, seed):
        if len(chunk) < 8:
            values += [made.update(*row) for row in chunk]
        else:
            values += made.run(columns(chunk), len(chunk))[0].tolist()
    return values


def test_both_sides_know_the_same_functions() -> None:
    assert {name: f.arity for name, f in FUNCTIONS.items()} == native.FUNCTIONS


def test_both_sides_know_the_same_lattice_folds() -> None:
    assert {name: fold.width for name, fold in FOLDS.items()} == native.FOLDS


def test_both_sides_know_the_same_kinds_of_instructions() -> None:
    assert set(native.KINDS) == {kind.__name__.upper() for kind in get_args(Instruction | Delay)}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_gives_the_bits_of_its_definition(name: str) -> None:
    function = FUNCTIONS[name]
    made = machine((2, "MAP", name, 0, function.arity - 1, 0.0, 0, 0))
    rows = [(x, y) for x in SPECIAL for y in SPECIAL] + samples(300)
    rng = random.Random(1)
    rows += [(rng.gauss(0, 3), rng.gauss(0, 3)) for _ in range(300)]
    expected = [function.apply(*row[: function.arity]) for row in rows]
    assert bits([made.update(*row) for row in rows]) == bits(expected)
    assert bits(made.run(columns(rows), len(rows))[0]) == bits(expected)


@pytest.mark.parametrize("name", ["min", "max"])
def test_the_least_and_greatest_of_terms_keep_a_nan_of_either_side(name: str) -> None:
    spec = f"{name}(sqrt(x), sqrt(y)) > 0"
    for x, y in ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
        with pytest.raises(ValueError, match=r"is not a number at sample 0"):
            Monitor(spec, backend="native").update(x, y)


@pytest.mark.parametrize("length", [0, *LENGTHS])
@pytest.mark.parametrize("name", FOLDS)
def test_a_window_gives_the_bits_of_its_definition(name: str, length: int) -> None:
    fold, start = FOLDS[name], 3
    window = make_window(fold, length or None)
    rows = samples(1200, length)
    expected = []
    for i, row in enumerate(rows):
        element = row[: fold.width] if i >= start else fold.identity
        expected.append(window.push(element)[-1])
    made = machine((2, "WINDOW", name, 0, fold.width - 1, 0.0, length, start))
    assert bits([made.update(*row) for row in rows]) == bits(expected)
    for seed in range(4):
        made.reset()
        assert bits(played(made, rows, seed)) == bits(expected)


@pytest.mark.parametrize("length", [*LENGTHS, 255, 256, 700])
def test_a_delay_line_gives_the_bits_of_its_definition(length: int) -> None:
    line = DelayLine(length)
    rows = samples(1500, length)
    expected = [line.push(x) for x, _ in rows]
    made = machine((2, "DELAY", "", 0, 0, 0.0, length, 0))
    assert bits([made.update(*row) for row in rows]) == bits(expected)
    for seed in range(4):
        made.reset()
        assert bits(played(made, rows, seed)) == bits(expected)


PROGRAMS = (
    "always[0:5](x + y > -2)",
    "always((x >= 0) implies eventually[0:5](y >= 0.3))",
    "eventually[0:20] always[0:5] (abs(x - y) < 0.5)",
    "(x > 0) until[3:9] (y > 0)",
    "not ((x > 0) until[0:300] (y > 0))",
    "(x > 0) since[2:9] (y > 0) or historically[300:600](x > y)",
    "prev(x > 0) unless[0:3] y > 0",
    "next rise(x > 0) and once[2:2](y > x)",
    "sqrt(abs(x)) + exp(y) - ln(abs(x) + 1) * pow(abs(y), x) / log(abs(y) + 3, 3) > min(x, y)",
    "low = x > 1; high = eventually[0:4](y > 1); always[0:300] (low implies high)",
    "y > 0 and true",
)


def trace(n: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(n)
    return np.where(rng.random((n, 2)) < 0.5, rng.integers(-2, 3, (n, 2)), rng.normal(size=(n, 2)))


@pytest.mark.parametrize("spec", PROGRAMS)
def test_registers_are_those_of_the_definition_after_every_sample(spec: str) -> None:
    mine, definition = (Monitor(spec, backend=b)._machine for b in ("native", "python"))
    assert bits(mine.registers) == bits(definition.registers)
    width = len(Monitor(spec).variables)
    for row in trace(700)[:, :width].tolist():
        assert bits([mine.update(*row)]) == bits([definition.update(*row)])
        assert bits(mine.registers) == bits(definition.registers)
        assert mine.inputs == definition.inputs
        assert mine.samples == definition.samples


@pytest.mark.parametrize("spec", PROGRAMS)
def test_blocks_and_samples_and_snapshots_mix_without_a_trace(spec: str) -> None:
    whole, mixed = Monitor(spec, backend="native"), Monitor(spec, backend="native")
    data = trace(1500)[:, : len(whole.variables)]
    expected = [whole.update(*row) for row in data.tolist()]
    for seed in range(3):
        mixed.reset()
        got: list[float] = []
        for chunk in chunked(data.tolist(), seed):
            if len(chunk) < 8:
                got += [mixed.update(*row) for row in chunk]
            else:
                got += mixed.update_many(chunk).tolist()
            state = mixed._machine.state()
            mixed = Monitor(spec, backend="native")
            mixed._machine.restore(state)
            assert mixed._machine.state() == state
        assert bits(got) == bits(expected)
        assert mixed._machine.registers == whole._machine.registers
        assert mixed._machine.inputs == whole._machine.inputs


@pytest.mark.parametrize("spec", [*PROGRAMS, "always(x > y)", "always eventually (x > y)"])
@pytest.mark.parametrize("n", [1, 2, 5, 255, 256, 257, 900])
def test_whole_traces_are_those_of_the_definition(spec: str, n: int) -> None:
    data = dict(zip("xy", trace(n).T, strict=True))
    mine, definition = (evaluate(spec, data, backend=b) for b in ("native", "python"))
    assert bits(mine) == bits(definition)


@pytest.mark.parametrize("n", [5, 256, 257, 1000])
@pytest.mark.parametrize("bad", [0, 3, -1])
def test_a_block_with_a_bad_term_is_not_taken_in_at_all(n: int, bad: int) -> None:
    spec = "always[0:3](sqrt(x) > 1)"
    mine, definition = (Monitor(spec, backend=b) for b in ("native", "python"))
    for monitor in (mine, definition):
        monitor.update_many([[4.0]] * 3)
    before = mine._machine.state()
    values = np.full((n, 1), 9.0)
    values[bad] = -1.0
    messages = []
    for monitor in (mine, definition):
        with pytest.raises(ValueError, match="not a number") as refusal:
            monitor.update_many(values)
        messages.append(str(refusal.value))
    assert messages == [
        f"'sqrt(x)' is not a number at sample {3 + range(n)[bad]}, where x = -1.0"
    ] * len(messages)
    assert mine._machine.state() == before
    assert mine.update(4.0) == definition.update(4.0)


@pytest.mark.parametrize("taken", [0, 1, 3])
def test_a_refused_sample_leaves_the_registers_of_the_one_before(taken: int) -> None:
    mine, definition = (
        Monitor("always[0:3](sqrt(x) + exp(y) > 2)", backend=b) for b in ("native", "python")
    )
    for monitor in (mine, definition):
        for x in range(taken):
            monitor.update(x, -x)
        before = monitor._machine.registers
        with pytest.raises(ValueError, match="not a number"):
            monitor.update(-1.0, 5.0)
        assert bits(monitor._machine.registers) == bits(before)
    assert bits(mine._machine.registers) == bits(definition._machine.registers)
    assert mine._machine.inputs == definition._machine.inputs


def test_a_nan_that_no_term_keeps_is_refused() -> None:
    monitor = Monitor("pow(x, 0) > y", backend="native")
    for x, y, name in ((math.nan, 0.0, "x"), (0.0, math.nan, "y")):
        with pytest.raises(ValueError, match=f"^variable '{name}' is nan at sample 0"):
            monitor.update(x, y)
    assert monitor._machine.samples == 0


@pytest.mark.parametrize("n", [3, 1000])
def test_a_whole_trace_with_a_bad_term_names_the_sample(n: int) -> None:
    values = np.full(n, 9.0)
    values[-1] = -1.0
    with pytest.raises(ValueError, match=rf"'sqrt\(x\)' is not a number at sample {n - 1}"):
        evaluate("always[0:3](sqrt(x) > 1)", {"x": values}, backend="native")
