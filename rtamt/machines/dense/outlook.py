"""Where the registers of a formula are undecided, over a trace in dense time and beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rtamt.machines.dense.episode import Regions
from rtamt.machines.dense.regions import CUT, LOWER, NOW, UPPER, WORLDS
from rtamt.machines.dense.rows import RegionRows, readings_of
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.protocols import End
from rtamt.program.placement import Placement
from rtamt.program.program import Program

__all__ = ["DenseOutlook", "Places"]


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
            every = tuple(range(len(each.instructions)))
            read = {a for r in every[each.terms :] for a in each.formula(r).args} | {each.result}
            streams = tuple(r for r in every if r >= each.terms or r in read)
            regions = Regions(Placement(each, (), streams, ()))
            regions.unfold(its, last, (*WORLDS, *CUT) if cut else WORLDS)
            self._readings.append(regions)

    def result(self, end: End) -> tuple[Runs, Runs]:
        """The least and the greatest result on the trace, for a reading of its end."""
        low, high = (NOW, NOW) if end == "complete" else self._worlds
        worst, best = self._readings[0], self._readings[-1]
        found = worst.seen(worst.program.result, low), best.seen(best.program.result, high)
        lower, upper = (clipped(runs, 0, self.last) for runs in found)
        return lower, upper

    def undecided(self, register: int) -> Places:
        """Where a register may be of either sign."""
        low, high = self._worlds
        worst = self._readings[0].seen(register, low)
        best = self._readings[-1].seen(register, high)
        runs = joint([worst, best])
        differ = np.signbit(runs.values[0]) != np.signbit(runs.values[1])
        return Places(runs.starts.tolist(), differ.tolist())
