"""Where the registers of a formula are undecided, over a trace in dense time and beyond it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rtamt.machines.dense.episode import Regions
from rtamt.machines.dense.regions import CUT, LOWER, NOW, UPPER, WORLDS
from rtamt.machines.dense.rows import RegionRows, readings_of
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.protocols import End
from rtamt.program.instructions import Const, Window
from rtamt.program.placement import Placement
from rtamt.program.program import Program

__all__ = ["DenseOutlook", "Places", "everywhere", "recorded"]


class Places(NamedTuple):
    """Runs of positions, and in which of them something is so."""

    starts: Sequence[int]
    values: Sequence[bool]

    def first(self, begin: int, end: int) -> int | None:
        """The first position from begin to end at which it is so."""
        until = (*self.starts[1:], np.inf)
        for start, after, value in zip(self.starts, until, self.values, strict=True):
            if value and start <= end and begin < after and begin <= end:
                return max(begin, start)
        return None


def recorded(
    program: Program, rows: Sequence[RegionRows], last: int, end: End
) -> tuple[Runs, Runs]:
    """The least and the greatest result on a trace; the same one if all is known.

    Args:
        program: The program over regions.
        rows: The terms at the positions of the trace, as `rows_of` gives them.
        last: The last position.
        end: The reading of the end.
    """
    low, high = (NOW, NOW) if end == "complete" or not _looks_ahead(program) else (LOWER, UPPER)
    worlds: Sequence[int] = (NOW,) if low == NOW else WORLDS
    if low != NOW and end == "cut":
        (low, high), worlds = CUT, (*WORLDS, *CUT)
    programs = readings_of(program)
    ends = [(programs[0], rows[0], low)]
    if len(rows) > 1 or low != high:
        ends.append((programs[-1], rows[-1], high))
    found = [_seen(each, its, last, worlds, world) for each, its, world in ends]
    return found[0], found[-1]


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
    """A placement in which every register that is no term of a term is a stream."""
    every = tuple(range(len(program.instructions)))
    read = {a for r in every[program.terms :] for a in program.formula(r).args} | {program.result}
    streams = tuple(r for r in every if r >= program.terms or r in read)
    return Placement(program, (), streams, ())


class DenseOutlook:
    """The bounds of all registers on a trace.

    Args:
        program: The program over regions.
        rows: The terms at the positions of the trace, as `rows_of` gives them.
        last: The last position.
        cut: Whether the trace was cut; else anything may follow, nothing too.

    Attributes:
        program: The program whose registers `undecided` takes.
    """

    def __init__(
        self, program: Program, rows: Sequence[RegionRows], last: int, *, cut: bool
    ) -> None:
        self.last = last
        self._worlds = CUT if cut else (LOWER, UPPER)
        self._readings = []
        programs = readings_of(program)
        greatest = programs[-1:] * (len(rows) - len(programs))
        for each, its in zip((*programs, *greatest), rows, strict=True):
            self.program = each
            regions = Regions(everywhere(each))
            regions.unfold(its, last, (*WORLDS, *CUT) if cut else WORLDS)
            self._readings.append(regions)

    def undecided(self, register: int) -> Places:
        """Where a register may be of either sign."""
        low, high = self._worlds
        worst = self._readings[0].seen(register, low)
        best = self._readings[-1].seen(register, high)
        runs = joint([worst, best])
        differ = np.signbit(runs.values[0]) != np.signbit(runs.values[1])
        return Places(runs.starts.tolist(), differ.tolist())
