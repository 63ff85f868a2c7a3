"""The undecided registers of a formula, over a trace in dense time and beyond it."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given
from rtamt.machines.dense.episode import Regions
from rtamt.machines.dense.rows import FindBoth, RegionRows, rows_of, values_between
from rtamt.machines.dense.runs import Runs, clipped, joint
from rtamt.machines.episode.streams import (
    CUT,
    CUT_LOWER,
    CUT_UPPER,
    LOWER,
    NOW,
    UPPER,
    WORLDS,
)
from rtamt.machines.protocols import End
from rtamt.machines.segments import FOREVER, PlaceRuns
from rtamt.machines.terms import term_columns, term_ranges
from rtamt.program.dense_lowering import RegionProgram
from rtamt.program.implications import Counted, InstantRuns
from rtamt.program.instructions import Const, Window
from rtamt.program.placement import Placement, variants_of
from rtamt.program.program import Program


def dense_values(
    regions: RegionProgram,
    reader: EventReader,
    given: Sequence[Given],
    trace: tuple[int, int],
    end: End,
    beyond: bool = False,  # noqa: FBT001, FBT002 - an argument of a back-end
    terms: FindBoth = (term_columns, term_ranges),
) -> tuple[Runs, Runs, Runs]:
    """Return robustness, lower and upper bound of the result on a trace and after it.

    They are one object if the values are known. The bounds may start at the first position at which
    they may differ from the robustness. The last run lasts for ever. A result that is a predicate
    may have no run after the trace. Without ``beyond``, values after the trace are not read, and a
    result that does not look ahead has no bounds of its own.
    """
    values = values_between(reader.counted(given), trace)
    rows, last = rows_of(regions.program, values, reader, terms), 2 * (trace[1] - trace[0])
    return with_robustness(regions.program, rows, last, end, beyond=beyond)


def with_robustness(
    program: Program, rows: Sequence[RegionRows], last: int, end: End, *, beyond: bool = False
) -> tuple[Runs, Runs, Runs]:
    """Return the values of `dense_values` from the terms."""
    worlds, (low, high) = _worlds(program, end, beyond=beyond)
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


def bound_worlds(program: Program, end: End, *, beyond: bool = False) -> tuple[int, int]:
    """Return the worlds of the lower and the upper bound."""
    if end == "complete" or not (beyond or _looks_ahead(program)):
        return NOW, NOW
    return (CUT_LOWER, CUT_UPPER) if end == "cut" else (LOWER, UPPER)


def _worlds(
    program: Program, end: End, *, beyond: bool = False
) -> tuple[Sequence[int], tuple[int, int]]:
    """Return the worlds to compute, and those of the lower and the upper bound."""
    low, high = bound_worlds(program, end, beyond=beyond)
    if low == high:
        return (NOW,), (NOW, NOW)
    if end == "cut":
        windows = (i for i in program.instructions if isinstance(i, Window))
        # Only windows without an end read what an open trace has.
        bounded = all(window.hi is not None and not window.endless for window in windows)
        return (NOW, *CUT) if bounded else (*WORLDS, *CUT), (low, high)
    return WORLDS, (low, high)


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
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
    """The bounds of all registers of ``program`` on a trace."""

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

    def undecided(self, register: int) -> PlaceRuns:
        """Return the positions at which a register may have either sign."""
        low, high = self._worlds
        worst = self._readings[0].seen(register, low)
        best = self._readings[-1].seen(register, high)
        runs = joint([worst, best])
        differ = np.signbit(runs.values[0]) != np.signbit(runs.values[1])
        return PlaceRuns.where(differ, runs.starts, FOREVER)


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
        last = self._last = 2 * (trace[1] - trace[0])
        _, *bounds = dense_values(regions, reader, given, trace, end, terms=terms)
        self._least, self._greatest = (clipped(bound, 0, last) for bound in bounds)

    def fails_at(self, instants: InstantRuns) -> Counted:
        greatest = self._greatest
        fails = PlaceRuns.where(np.signbit(greatest.last), greatest.starts, self._last)
        runs = fails.within(instants)
        return runs.length(2), len(runs.first), int(runs.first[0]) if len(runs.first) else None

    def holds_at(self, instants: InstantRuns) -> bool:
        if instants[-1][1] > self._last:
            return False
        holds = PlaceRuns.where(~np.signbit(self._least.last), self._least.starts, self._last)
        length = sum(int(final) - first + 1 for first, final in instants)
        return holds.within(instants).length(1) == length
