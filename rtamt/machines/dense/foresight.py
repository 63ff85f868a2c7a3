"""Bounds of the robustness at the first time of a trace in dense time, from runs of machines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from rtamt.errors import Advice, Argument, InputError
from rtamt.inputs.event_reader import Column, EventReader
from rtamt.inputs.events import Given
from rtamt.machines.protocols import DenseMachine
from rtamt.machines.readout import verdict_of
from rtamt.program.dense_lowering import MAX_TICKS, DenseProgram, duration_text
from rtamt.program.dense_outlook import DenseOutlook, look_out_dense
from rtamt.program.program import Program

__all__ = ["DenseForesight", "MakeDense", "Steps"]

MakeDense = Callable[[DenseProgram, EventReader, Sequence[int]], DenseMachine]


class Steps(NamedTuple):
    """A step function of ticks: where it changes, and its values from there on."""

    ticks: Sequence[int]
    values: Sequence[bool]

    def first(self, begin: float, end: float) -> float | None:
        """The first tick from begin to end at which it is true."""
        until = (*self.ticks[1:], np.inf)
        for tick, after, value in zip(self.ticks, until, self.values, strict=True):
            if value and tick <= end and begin < after and begin <= end:
                return max(begin, tick)
        return None


class DenseForesight:
    """Bounds of the robustness at the first time of a trace, whatever comes after it.

    The trace begins at tick 0: its times are counted from its first.

    Args:
        whole: The program; its windows may have no end.
        machine: Makes the dense machines of a back-end.
        columns: The events of every variable, up to the last tick or later; the first is at 0.
        last: The last tick of the trace.
    """

    def __init__(
        self, whole: DenseProgram, machine: MakeDense, columns: Sequence[Column], last: int
    ) -> None:
        self.last = last
        self._whole, self._machine, self._columns = whole, machine, columns
        self._zeros = (-0.0, 0.0) if whole.program.neutral else (0.0, 0.0)

    def until(self, last: int) -> DenseForesight:
        """The bounds for the trace up to a tick."""
        return DenseForesight(self._whole, self._machine, self._columns, last)

    def bounds(self, *, cut: bool) -> tuple[float, float]:
        """The least and the greatest robustness if the trace was cut, or goes on for ever."""
        worst, best = self._zeros
        cuts = [cut, cut]
        if cut and self._whole.program.neutral:
            # Each zero makes a formula of its own: what the open reading decided of it stands.
            cuts = [
                verdict_of(
                    *(self._at_begin(zero, best=world, cut=False) for world in (False, True))
                )
                == 0
                for zero in self._zeros
            ]
        lower = self._at_begin(worst, best=False, cut=cuts[0])
        upper = self._at_begin(best, best=True, cut=cuts[1])
        return lower, upper

    def _at_begin(self, zero: float, *, best: bool, cut: bool) -> float:
        outlook = look_out_dense(self._whole, zero=zero, best=best, cut=cut)
        _, values = self._run(outlook, outlook.dense)
        return float(values[0])

    def program(self, *, cut: bool) -> Program:
        """The program whose registers `undecided` takes."""
        zero = self._zeros[0]
        return look_out_dense(self._whole, zero=zero, best=False, cut=cut).dense.program

    def undecided(self, register: int, *, cut: bool) -> Steps:
        """Where a register may be of either sign."""
        found = []
        for zero, best in zip(self._zeros, (False, True), strict=True):
            outlook = look_out_dense(self._whole, zero=zero, best=best, cut=cut)
            program = outlook.dense.program.restricted(register, {})
            part = DenseProgram(program, outlook.dense.resolution)
            found.append(self._run(outlook, part))
        ticks = np.unique(np.concatenate([times for times, _ in found]))
        low, high = (
            np.signbit(values[np.searchsorted(times, ticks, "right") - 1])
            for times, values in found
        )
        later = [int(tick) + self.last for tick in ticks[1:]]  # the begin may have been rounded
        return Steps([0, *later], (low != high).tolist())

    def _run(self, outlook: DenseOutlook, part: DenseProgram) -> Given:
        """The result of a part of a program; times are counted from the end of the trace."""
        plan = outlook.plan(self.last)
        if plan.end >= MAX_TICKS:
            resolution = coarser = self._whole.resolution
            while plan.end * resolution >= MAX_TICKS * coarser:
                coarser *= 10
            raise InputError(
                "expected a trace that lasts less than 2**62 ticks of "
                f"{duration_text(resolution)} with the bounds of the formula, got {plan.end}",
                Advice("; ", Argument("resolution", duration_text(coarser)), " would do"),
            )
        given: list[Given] = []
        for ticks, values in self._columns:
            count = int(np.searchsorted(ticks, self.last, "right"))
            given.append(
                (np.append(ticks[:count], plan.end), np.append(values[:count], values[count - 1]))
            )
        for mask in plan.masks:
            ticks = np.array([0, mask.last + 1, plan.end], np.int64)
            given.append((ticks, np.array([mask.value, -mask.value, -mask.value])))
        # Times come back as doubles: those near the end of a long trace are exact as well.
        shifted = [(ticks - self.last, values) for ticks, values in given]
        return self._machine(part, EventReader(part), ()).run(shifted)
