"""The episode machine in C++ against its definition in Python, with long windows.

Short windows, of every operator, are in test_episode.py.
"""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Iterator
from typing import cast

import pytest
from bits import bits

from rtamt import EpisodeMonitor, Verdict
from rtamt.machines.protocols import MachineState

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Rows = Callable[[int], Iterator[tuple[float, float]]]

SHAPES = (
    "always(x > 0)",
    "always((x >= 1) implies eventually[0:70](y >= 1))",
    "always((x >= 1) implies eventually[0:40] always[0:30](abs(x - y) < 1))",
    "always((x >= 1) implies eventually[0:10] always[5:60](abs(x - y) < 1))",
    "always((x >= 1) implies always[0:70](y >= 1))",
    "eventually((x >= 1) and y < 3 and always[20:70](y >= 1))",
    "eventually((x >= 1) and always[5:40] eventually[3:50](y >= 1))",
    "always eventually[0:3] always[0:90](x > y)",
    "always((x > 0) until[0:75] (y > 0))",
    "eventually((x > 0) until[0:75] (y > 0))",
    "eventually not((x > 0) until[0:75] (y > 0))",
    "always not((x > 0) until[0:75] (y > 0))",
    "always((x > 0) until[30:75] (y > 0))",
    "always(((x > 0) until[0:75] (y > 0)) or x > 1)",
    "always[0:60]((x > 0) until[0:40] (y > 0))",
    "always((always[0:40](x > -1)) until[0:60] (eventually[0:5](y > 1)))",
    "always((x > 0) until[0:50] (next next y > 0))",
    "always historically[0:80](x > 0)",
    "always once[0:80](x > 0)",
    "eventually once[0:80](x > 0)",
    "eventually[0:200] historically[0:80](x > 0)",
    "always[0:90] once[20:60](x > 0)",
    "always[0:90]((x > 0) since[0:60] (y > 0))",
    "eventually((x > 0) since[10:60] (y > 0))",
    "always[40:90] eventually[5:50] historically[0:45](x > 0)",
    "always((x > 0) implies eventually always[0:50](y > 0))",
    "always[0:60] eventually((x > 0) and always[0:40](y > 0))",
    "always eventually[0:40]((x > 0) until (y > 0))",
)


def ramps(n: int) -> Iterator[tuple[float, float]]:
    """Every value changes all folds before it, then none."""
    for i in range(n):
        yield (i / 8 if i % 100 < 50 else -i / 8), (n - i) / 16 - 2


def noise(n: int) -> Iterator[tuple[float, float]]:
    """Few values, so that equal ones meet."""
    rng = random.Random(n)
    for _ in range(n):
        yield rng.choice((-2.0, -0.5, 0.0, 0.5, 3.0)), rng.choice((-3.0, -1.0, 0.0, 2.0, math.inf))


def bursts(n: int) -> Iterator[tuple[float, float]]:
    """Long runs of satisfaction and of violation."""
    for i in range(n):
        yield (1.0 + i % 7 / 8 if i // 40 % 2 else -1.0), (2.0 if i % 37 == 0 else -1.0 - i % 5)


def feed(monitor: EpisodeMonitor, x: float, y: float) -> float:
    return monitor.update({name: {"x": x, "y": y}[name] for name in monitor.variables})


def offered(monitor: EpisodeMonitor) -> list[int]:
    """Return robustness, lower and upper bound, bit by bit."""
    return bits([monitor.robustness, monitor.lower, monitor.upper])


@pytest.mark.slow(keep=28)
@pytest.mark.parametrize("rows", [ramps, noise, bursts], ids=["ramps", "noise", "bursts"])
@pytest.mark.parametrize("shape", SHAPES)
def test_long_windows_equal_their_definition(shape: str, rows: Rows) -> None:
    expected, monitor = (EpisodeMonitor(shape, backend=b) for b in ("python", "native"))
    for i, (x, y) in enumerate(rows(230)):
        assert feed(monitor, x, y) == feed(expected, x, y)
        assert offered(monitor) == offered(expected), i
        if i in (0, 33, 150):
            monitor = copy.copy(monitor)


CUT_SHAPES = (
    *SHAPES,
    "always(eventually[0:5](once[0:40](x > 0)))",
    "always(eventually[20:25](once[30:40](x > 0)))",
    "always(eventually[20:25]((x > 0) since[30:40] (y > 0)))",
    "eventually(not(eventually[0:5]((x > 0) since[3:20] (y > 0))))",
    "always(once[5:9](eventually[0:3](x > 0)))",
    "always(eventually[0:5](prev prev prev(x > 0)))",
    "always[10:inf](eventually[0:30](historically[5:25](y > 0)))",
    "eventually[0:20](always(eventually[0:5](once[0:40](x > 0))))",
    "always(eventually[0:9](once(x > 0) and historically[3:3](y > 0)))",
    "historically[0:3](always(x > 0)) or eventually[2:9](eventually(y > 2))",
    "always[0:5]((eventually[3:4] true) until[2:inf] (x > 0))",
    "eventually[0:5](not ((eventually[3:4] true) until[2:inf] (x > 0)))",
)


@pytest.mark.slow(keep=40)
@pytest.mark.parametrize("rows", [ramps, noise, bursts], ids=["ramps", "noise", "bursts"])
@pytest.mark.parametrize("shape", CUT_SHAPES)
def test_a_cut_trace_of_long_windows_equals_its_definition(shape: str, rows: Rows) -> None:
    expected, monitor = (EpisodeMonitor(shape, backend=b) for b in ("python", "native"))
    for i, (x, y) in enumerate(rows(110)):
        feed(monitor, x, y)
        feed(expected, x, y)
        if i in (0, 2, 7, 24, 33, 58, 109):
            cut, defined = copy.copy(monitor), copy.copy(expected)
            assert cut.finish("cut") == defined.finish("cut")
            assert offered(cut) == offered(defined), i
            assert offered(copy.copy(cut)) == offered(cut)
            cut.reset()
            assert machine(cut).state() == machine(EpisodeMonitor(shape)).state()


def size_of_state(monitor: EpisodeMonitor) -> int:
    return len(cast("bytes", monitor.__reduce__()[2]))


@pytest.mark.parametrize("shape", SHAPES)
def test_memory_is_bounded_by_the_horizon(shape: str) -> None:
    monitor = EpisodeMonitor(shape, backend="native")
    sizes = []
    for i, (x, y) in enumerate(noise(2000)):
        feed(monitor, x, y)
        if i in (999, 1999):
            sizes.append(size_of_state(monitor))
    assert sizes[0] == sizes[1]


def test_what_is_decided_is_forgotten() -> None:
    monitor = EpisodeMonitor("always[0:10] eventually[0:100](x > 0)", backend="native")
    sizes = []
    for i in range(130):
        monitor.update(x=i % 7 - 3.0)
        sizes.append(size_of_state(monitor))
    assert sizes[109] > sizes[10] > sizes[111] == sizes[129]
    assert (monitor.robustness, monitor.lower, monitor.upper) == (3.0, 3.0, 3.0)


def machine(monitor: EpisodeMonitor) -> MachineState:
    return monitor._machine


TERM = (0, "LOAD", "x", 0, 0, 0.0, 0, 0)
MARKS = (False, False)  # of a window: whether it is a guard, or a part of an unbounded one


@pytest.mark.parametrize(
    ("formulas", "initial", "streams", "message"),
    [
        ([("WINDOW", "mean", 0, 0, 0, 1, *MARKS)], [1], [0], "unknown lattice fold 'mean'"),
        ([("MAP", "sub", 0, 0, None, None, *MARKS)], [0, 1], [], "function 'sub' is not monotone"),
        ([("DELAY", "", 0, 0, 0, 1, *MARKS)], [1], [0], "unknown kind 'DELAY'"),
        (
            [("WINDOW", "min", 0, 0, 0, 1, *MARKS)],
            [1],
            [],
            "register 0 is read before it is written",
        ),
        (
            [("WINDOW", "min", 9, 9, 0, 1, *MARKS)],
            [1],
            [0],
            "register 9 is read before it is written",
        ),
        ([], [], [], "expected a result, got none"),
    ],
)
def test_rows_that_would_break_memory_are_refused(
    formulas: list[tuple[object, ...]], initial: list[int], streams: list[int], message: str
) -> None:
    reader = EpisodeMonitor("x > 0")._reader
    with pytest.raises(ValueError, match=f"^{message}$"):
        native.EpisodeMachine([TERM], formulas, initial, streams, ("x",), reader)


@pytest.mark.parametrize("span", [(0, 1), (0, None), (-1, 0), (None, 0)])
@pytest.mark.parametrize("streams", [[0, 1], [0, 1, 2]])
def test_a_second_operand_of_a_fold_of_one_is_not_read(
    span: tuple[int | None, int | None], streams: list[int]
) -> None:
    terms = [TERM, (1, *TERM[1:])]
    reader = EpisodeMonitor("x > 0")._reader
    outer = ("WINDOW", "max", 2, 2, 0, None, *MARKS)
    results = []
    for second in (0, 1):
        formulas = [("WINDOW", "min", 0, second, *span, *MARKS), outer]
        initial = [3] if 2 in streams else [2]
        machine = native.EpisodeMachine(terms, formulas, initial, streams, ("x",), reader)
        results.append([machine.update(x) for x in (3.0, 1.0, 2.0, 4.0)])
    assert results[0] == results[1]


def test_slots_that_a_monitor_does_not_have_are_refused() -> None:
    class Other:
        __slots__ = ("value",)

    monitor = EpisodeMonitor("always(x > 0)", backend="native")
    slot = vars(Other)["value"]
    for strange, message in (
        (vars(EpisodeMonitor)["lower"], "expected a slot that can be written"),
        (EpisodeMonitor.reset, "expected a slot of a class"),
        (slot, "expected slots of the monitor's class"),
    ):
        with pytest.raises(TypeError, match=f"^{message}$"):
            machine(monitor).show_in(monitor, [strange] * 4, tuple(Verdict))
    with pytest.raises(ValueError, match=r"^expected 4 slots and 3 verdicts$"):
        machine(monitor).show_in(monitor, [slot], tuple(Verdict))
    monitor.update(1.0)
    assert (monitor.robustness, monitor.upper) == (1.0, 1.0)
