"""The truth of a program's result on a trace that changes seldom, for a solver.

A trace whose values change at some times alone, and never after the last of them, is known by a
value for each run of equal samples. Every truth on it changes seldom too: a window folds whole
runs, and what it tells changes where one of its ends comes into another run. So long windows cost
no more than short ones. The truths are exact for such traces, and say nothing of others.
"""

from __future__ import annotations

import functools
import itertools
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from rtamt.checking.graph import FALSE, TRUE, Graph, Truth
from rtamt.checking.samples import TermTruths
from rtamt.checking.truths import COMBINED, read_until
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Window
from rtamt.program.placement import positive
from rtamt.program.program import Program

__all__ = ["change_times", "truth_of_runs"]

_MOST: Final = 64
"""The most corners of windows at which a trace may change."""

_GRID: Final = 256
"""The most times of an even grid at which a trace may change."""


def truth_of_runs(
    graph: Graph, samples: TermTruths, program: Program, times: Sequence[int]
) -> Truth:
    """Whether the result holds at the first sample of a trace without an end.

    Args:
        graph: Where truths are made.
        samples: The samples.
        program: The program.
        times: The samples at which values may change, in order, from 0 on; the last run has no
            end.
    """
    read = positive(program).with_zero(-0.0)
    until = read_until(read)
    known: dict[int, _Runs] = {}

    def runs(register: int) -> _Runs:
        if register not in known:  # a predicate
            last = until[register]
            begins = [time for time in times if last is None or time <= last]
            known[register] = _merged((time, samples(read, register, time)) for time in begins)
        return known[register]

    for register in range(read.terms, len(read.instructions)):
        instruction = read.formula(register)
        operands = [runs(operand) for operand in instruction.args]
        if isinstance(instruction, Window):
            known[register] = _window(graph, instruction, operands, until[register])
        else:
            combine = graph.all if instruction.function == "min" else graph.any
            begins = sorted({time for each in operands for time in each.begins})
            known[register] = _merged(
                (time, combine(each.at(time) for each in operands)) for time in begins
            )
    return runs(read.result).truths[0]


def change_times(programs: Iterable[Program], most: int) -> Iterator[list[int]]:
    """Samples at which traces may change on which programs are tried, more and more of them.

    The first trace does not change. Others do where windows begin and end that are read from the
    begins and ends of windows around them, and a sample later; then in the middle between these
    times too; then at all multiples of half the shortest window.

    Args:
        programs: The programs.
        most: How many samples a trace has.
    """
    yield [0]
    every = [positive(each) for each in programs]
    corners = sorted(set[int]().union(*map(_corners, every)))
    if len(corners) > _MOST:
        step = len(corners) / _MOST
        corners = [corners[int(i * step)] for i in range(_MOST)]
    times = sorted({0, *(t for c in corners for t in (c, c + 1) if t < most)})
    if len(times) == 1:
        return
    yield times
    between = {(a + b) // 2 for a, b in itertools.pairwise(times)}
    finer = sorted({*times, *between})
    if len(finer) > len(times):
        yield finer
    lengths = [
        window.hi - window.lo
        for each in every
        for window in each.instructions
        if isinstance(window, Window) and window.lo is not None and window.hi is not None
    ]
    step = max(1, min((length for length in lengths if length > 1), default=2) // 2)
    if most // step <= _GRID:
        yield sorted({*times, *range(0, most, step)})


def _corners(program: Program) -> set[int]:
    """The times at which windows begin and end that are read at such times."""
    read: list[set[int]] = [set() for _ in program.instructions]
    read[program.result] = {0}
    for register in range(program.result, program.terms - 1, -1):
        instruction, here = program.formula(register), read[register]
        if isinstance(instruction, Window):
            bounds = {instruction.lo, instruction.hi} - {None}
            here = {max(0, time + (bound or 0)) for time in here for bound in bounds or {0}}
        if len(here) > _MOST:
            kept = sorted(here)
            here = {*kept[: _MOST // 2], *kept[-_MOST // 2 :]}
        for operand in instruction.args:
            read[operand] |= here
    return set[int]().union(*read)


@dataclass(frozen=True, slots=True)
class _Runs:
    """A truth at all times from 0 on: each holds from its begin to the next."""

    begins: Sequence[int]
    truths: Sequence[Truth]

    def at(self, time: int) -> Truth:
        return self.truths[bisect_right(self.begins, time) - 1]


def _merged(runs: Iterable[tuple[int, Truth]]) -> _Runs:
    begins: list[int] = []
    truths: list[Truth] = []
    for time, truth in runs:
        if not truths or truths[-1] != truth:
            begins.append(time)
            truths.append(truth)
    return _Runs(begins, truths)


def _window(graph: Graph, window: Window, operands: Sequence[_Runs], until: int | None) -> _Runs:
    begins = sorted({time for each in operands for time in each.begins})
    elements = [tuple(each.at(time) for each in operands) for time in begins]
    lo, hi = window.lo, window.hi
    changes = {0, *(time - end for time in begins for end in (lo, hi) if end is not None)}
    folded = _FOLDED.get(window.fold)

    def fold(first: int, last: int) -> Truth:
        some = elements[first : last + 1]
        if folded is not None:
            return folded(graph, (element[0] for element in some))
        identity = tuple(TRUE if x > 0 else FALSE for x in FOLDS[window.fold].identity)
        # Equal elements fold to one of them.
        return functools.reduce(functools.partial(COMBINED[window.fold], graph), some, identity)[-1]

    def runs() -> Iterator[tuple[int, Truth]]:
        for time in sorted(changes):
            if time < 0 or (until is not None and time > until):
                continue
            first = 0 if lo is None else max(0, bisect_right(begins, time + lo) - 1)
            last = len(begins) - 1 if hi is None else bisect_right(begins, time + hi) - 1
            yield time, fold(first, last)

    return _merged(runs())


_FOLDED: Final[Mapping[str, Callable[[Graph, Iterable[Truth]], Truth]]] = {
    "min": Graph.all,
    "max": Graph.any,
}
