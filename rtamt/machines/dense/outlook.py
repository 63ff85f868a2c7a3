"""The undecided registers of a formula, over a trace in dense time and beyond it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given
from rtamt.machines.dense.episode import Regions
from rtamt.machines.dense.regions import CUT, CUT_LOWER, CUT_UPPER, LOWER, NOW, UPPER, WORLDS
from rtamt.machines.dense.rows import FindBoth, RegionRows, rows_between
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.protocols import End
from rtamt.machines.terms import term_columns, term_ranges
from rtamt.program.dense_lowering import RegionProgram
from rtamt.program.implications import Counted, InstantRuns
from rtamt.program.instructions import Const, Window
from rtamt.program.placement import Placement, variants_of
from rtamt.program.program import Program


class Places(NamedTuple):
    """Runs of positions, and which of them are true."""

    starts: Sequence[int]
    values: Sequence[bool]

    def first(self, begin: int, end: int) -> int | None:
        """Return the first true position from begin to end."""
        until = (*self.starts[1:], np.inf)
        for start, after, value in zip(self.starts, until, self.values, strict=True):
            if value and start <= end and begin < after and begin <= end:
                return max(begin, start)
        return None


def recorded(
    program: Program, rows: Sequence[RegionRows], last: int, end: End
) -> tuple[Runs, Runs]:
    """Return the smallest and the largest result on a trace; the same one if all is known."""
    worlds, (low, high) = _worlds(program, end)
    programs = variants_of(program)
    ends = [(programs[0], rows[0], low)]
    if len(rows) > 1 or low != high:
        ends.append((programs[-1], rows[-1], high))
    bounds = [_seen(variant, terms, last, worlds, world) for variant, terms, world in ends]
    return bounds[0], bounds[-1]


def with_robustness(
    program: Program, rows: Sequence[RegionRows], last: int, end: End
) -> tuple[Runs, Runs, Runs]:
    """Return robustness, lower and upper bound of the result on a trace and after it.

    The last run lasts for ever. A result that is a predicate has no run after the trace.
    """
    worlds, (low, high) = _worlds(program, end)
    programs = variants_of(program)
    # With uncertain values the last rows are the largest terms of the last program.
    variant = {0: programs[0], len(programs) - 1: programs[-1], len(rows) - 1: programs[-1]}
    if program.result < program.terms and not isinstance(
        program.instructions[program.result], Const
    ):
        runs = {
            i: dict.fromkeys((NOW, low, high), Runs(rows[i].positions, (rows[i].terms[v.result],)))
            for i, v in variant.items()
        }
    else:
        runs = {}
        for i, v in variant.items():
            regions = Regions(everywhere(v))
            regions.unfold(rows[i], last, worlds)
            runs[i] = {world: regions.seen(v.result, world) for world in {NOW, low, high}}
    return runs[len(programs) - 1][NOW], runs[0][low], runs[len(rows) - 1][high]


def _worlds(program: Program, end: End) -> tuple[Sequence[int], tuple[int, int]]:
    """Return the worlds to compute, and those of the lower and the upper bound."""
    if end == "complete" or not _looks_ahead(program):
        return (NOW,), (NOW, NOW)
    if end == "cut":
        windows = (i for i in program.instructions if isinstance(i, Window))
        # Only windows without an end read what an open trace has.
        bounded = all(window.hi is not None and not window.endless for window in windows)
        return (NOW, *CUT) if bounded else (*WORLDS, *CUT), (CUT_LOWER, CUT_UPPER)
    return WORLDS, (LOWER, UPPER)


def _seen(program: Program, rows: RegionRows, last: int, worlds: Sequence[int], world: int) -> Runs:
    instruction = program.instructions[program.result]
    if program.result < program.terms and not isinstance(instruction, Const):
        return Runs(rows.positions, (rows.terms[program.result],))
    regions = Regions(everywhere(program))
    regions.unfold(rows, last, worlds)
    return clipped(regions.seen(program.result, world), 0, last)


def _looks_ahead(program: Program) -> bool:
    windows = (i for i in program.instructions if isinstance(i, Window))
    return any(window.hi is None or window.hi > 0 for window in windows)


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def everywhere(program: Program) -> Placement:
    """Return a placement in which all registers are streams, except for terms of terms."""
    every = tuple(range(len(program.instructions)))
    read = {a for r in every[program.terms :] for a in program.formula(r).args} | {program.result}
    streams = tuple(r for r in every if r >= program.terms or r in read)
    return Placement(program, (), streams, ())


class DenseOutlook:
    """The bounds of all registers on a trace.

    Attributes:
        program: The program whose registers `undecided` takes.
    """

    def __init__(
        self, program: Program, rows: Sequence[RegionRows], last: int, *, cut: bool
    ) -> None:
        self.last = last
        self._worlds = CUT if cut else (LOWER, UPPER)
        self._readings = []
        programs = variants_of(program)
        greatest = programs[-1:] * (len(rows) - len(programs))
        for variant, terms in zip((*programs, *greatest), rows, strict=True):
            self.program = variant
            regions = Regions(everywhere(variant))
            regions.unfold(terms, last, (*WORLDS, *CUT) if cut else WORLDS)
            self._readings.append(regions)

    def undecided(self, register: int) -> Places:
        """Return the positions at which a register may have either sign."""
        low, high = self._worlds
        worst = self._readings[0].seen(register, low)
        best = self._readings[-1].seen(register, high)
        runs = joint([worst, best])
        differ = np.signbit(runs.values[0]) != np.signbit(runs.values[1])
        return Places(runs.starts.tolist(), differ.tolist())


class PythonDenseSigns:
    """The certain signs of a formula at the positions of a whole trace."""

    def __init__(
        self,
        regions: RegionProgram,
        reader: EventReader,
        given: Sequence[Given],
        trace: tuple[int, int],
        end: End,
        terms: FindBoth = (term_columns, term_ranges),
    ) -> None:
        counted = reader.counted(given, [-np.inf] * len(given), None)
        rows = rows_between(regions, counted, trace, reader, terms)
        self._last = 2 * (trace[1] - trace[0])
        self._least, self._greatest = recorded(regions.program, rows, self._last, end)

    def fails_at(self, instants: InstantRuns) -> Counted:
        fails = _Spans.of(np.signbit(self._greatest.last), self._greatest.starts, self._last)
        begins, ends = fails.within(instants)
        ticks = int(np.sum((ends + 1) // 2 - begins // 2))  # the odd positions
        return ticks, len(begins), int(begins[0]) if len(begins) else None

    def holds_at(self, instants: InstantRuns) -> bool:
        spans = _Spans.of(~np.signbit(self._least.last), self._least.starts, self._last)
        return spans.cover(instants, self._last)


class _Spans(NamedTuple):
    """Recorded runs of instants, in order (`rtamt.program.implications`).

    Attributes:
        begins: The first instant of each run.
        ends: The last instant.
    """

    begins: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, true: NDArray[np.bool_], starts: NDArray[np.int64] | None, last: int) -> _Spans:
        """Return the runs at which an array is true."""
        changes = np.flatnonzero(true[1:] != true[:-1]) + 1
        if true[0]:
            changes = np.concatenate([np.zeros(1, np.int64), changes])
        places = changes if starts is None else starts[changes]
        begins, after = places[::2], places[1::2]
        if len(after) < len(begins):
            after = np.append(after, last + 1)
        return cls(begins, after - 1)

    def within(self, instants: InstantRuns) -> _Spans:
        """Return the parts of the runs inside others."""
        if not len(self.begins):
            return self
        if len(instants) == 1:
            ((first, final),) = instants
            if first <= self.begins[0] and self.ends[-1] <= final:
                return self
        begins, ends = [], []
        for first, final in instants:
            low = int(np.searchsorted(self.ends, first))
            high = int(np.searchsorted(self.begins, final, "right"))
            begins.append(np.maximum(self.begins[low:high], first))
            ends.append(np.minimum(self.ends[low:high], final).astype(np.int64))
        if not begins:
            return _Spans(self.begins[:0], self.ends[:0])
        return _Spans(np.concatenate(begins), np.concatenate(ends))

    def cover(self, instants: InstantRuns, last: int) -> bool:
        """Return whether all instants are in the runs, and none is after the last recorded one."""
        if instants and instants[-1][1] > last:
            return False
        common = self.within(instants)
        length = int(np.sum(common.ends - common.begins + 1))
        return length == sum(int(final) - first + 1 for first, final in instants)
