"""The machine of `EpisodeMonitor` in Python: the whole episode's robustness and its bounds.

It computes the value at time 0 in three worlds. In ``NOW`` the episode ended with the last sample.
In ``LOWER`` and ``UPPER`` it goes on, and every predicate is -inf or +inf at every unseen sample.
But an unseen sample may not be there: in ``UPPER`` a minimum over the future skips it, in ``LOWER``
a maximum, except for the sample of the window's own time, which is there whenever it is read. What
has to hold before a witness of ``until`` is there too if the witness is
(`rtamt.program.instructions.Window`). The program has no negations (`rtamt.program.polarity`), so
every register is monotone in the predicates, and the last two values are the bounds over all
continuations and all ends.

A trace that was cut (``finish(end="cut")``) has two worlds more. There the unseen samples of
windows with an end are there, and windows without end fold what was recorded; where nothing of
their operator was recorded, they have the values of ``LOWER`` and ``UPPER``.

Take a register whose value depends on H samples of the future and E samples of the past. After
sample t it has

* settled values up to time t - H, which are the same in all worlds;
* open values of times t - H + 1 to t + E (in ``NOW`` to t), an array for each world;
* a tail: one number for each world, its value at all later times.

A window without end inside another operator never settles. Its value u at the first open time is
an unknown, and values before that are lattice polynomials in the unknowns: monotone functions max
over S of min(c_S, u_i for i in S), stored by their values at the corners u in {-inf, +inf}. Folds
act corner by corner. A sample that settles replaces u by op(sample, u); a world replaces u by its
value. Every settled array has an axis of length 2 for each unknown, in front.

Operators that are read at time 0 alone keep one fold each (`rtamt.machines.episode.initial`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NoReturn, assert_never, cast

import numpy as np

from rtamt.errors import StateError
from rtamt.inputs.samples import SampleReader
from rtamt.machines.episode.initial import InitialFold
from rtamt.machines.episode.streams import (
    CUT,
    OPEN,
    WORLDS,
    Constant,
    Pointwise,
    Polynomials,
    Predicate,
    Sliding,
    Stream,
    UnboundedFuture,
    UnboundedPast,
)
from rtamt.machines.protocols import End
from rtamt.machines.readout import moved
from rtamt.machines.terms import PythonSampleMachine, Registers
from rtamt.program.algebra import FUNCTIONS
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import place
from rtamt.program.program import Program

__all__ = ["PythonEpisodeMachine", "refuse_finish", "refuse_update"]


def refuse_update() -> NoReturn:
    """Raise the error of an update after `finish`."""
    msg = "the episode is finished; call reset() before the next update"
    raise StateError(msg)


def refuse_finish() -> NoReturn:
    """Raise the error of a finish before any sample."""
    msg = "finish() needs at least one sample, got none since reset"
    raise StateError(msg)


class PythonEpisodeMachine(PythonSampleMachine):
    """Runs a program, future without end included, and bounds its value at time 0."""

    STATE = ("samples", "inputs", "finished", "_first", "robustness", "lower", "upper", "_keepers")
    finished: bool
    _first: Registers

    def __init__(self, program: Program, reader: SampleReader) -> None:
        placement = place(program)
        super().__init__(placement.program, reader)
        self._initial = placement.initial
        self._axes = {register: axis for axis, register in enumerate(placement.unknowns)}
        self._streams: dict[int, Stream] = {}
        for register in placement.streams:
            self._streams[register] = self._made(register)
        self._folds: dict[int, InitialFold] = {}
        for register in placement.initial:
            instruction = self.program.instructions[register]
            if isinstance(instruction, Window):
                streams = [self._streams[a] for a in instruction.args]
                self._folds[register] = InitialFold(instruction, streams)
        self._keepers: list[Polynomials] = [*self._streams.values(), *self._folds.values()]
        # The value of every unknown, a row for each world.
        self._values_of_unknowns = np.zeros((5, len(self._axes)))
        self.reset()

    def _made(self, register: int) -> Stream:
        instruction = self.program.instructions[register]
        corners = (2,) * len(self._axes)
        if isinstance(instruction, Const):
            return Constant(corners, instruction.value)
        if register < self.program.terms:
            return Predicate(corners, register)
        match self.program.formula(register):
            case Map(function, args):
                return Pointwise(function, [self._streams[a] for a in args])
            case Window(_, lo, hi, args) as window:
                streams = [self._streams[a] for a in args]
                if hi is None:
                    return UnboundedFuture(window, self._axes[register], streams)
                return (UnboundedPast if lo is None else Sliding)(window, streams)
            case _ as never:
                assert_never(never)

    def take(self, terms: Registers, values: list[float]) -> None:
        self.inputs = values
        self.samples += 1
        self._advance(terms)

    def _advance(self, terms: Registers) -> None:
        t = self.samples - 1
        for stream in self._streams.values():
            if isinstance(stream, Predicate):
                stream.take(terms)
            value = stream.settle(t)
            if isinstance(stream, UnboundedFuture) and value is not None:
                for keeper in self._keepers:
                    keeper.substitute(stream.axis, value)
            if value is not None:
                stream.append(value, t)
            stream.look(t, self._values_of_unknowns)
        if t == 0:
            self._first = terms
        for fold in self._folds.values():
            fold.settle(t)
        self._conclude(t)

    def _conclude(self, t: int) -> None:
        self.robustness, self.lower, self.upper = self._results(t, WORLDS)
        if t < 0:
            self.robustness = math.nan

    def _results(self, t: int, worlds: Sequence[int]) -> list[float]:
        """The value at time 0 in some worlds after sample t."""
        found: dict[int, list[float]] = {}
        for register in self._initial:
            found[register] = self._at_zero(register, found, t, worlds)
        return found[self.program.result]

    def _at_zero(
        self, register: int, found: dict[int, list[float]], t: int, worlds: Sequence[int]
    ) -> list[float]:
        instruction = self.program.instructions[register]
        if isinstance(instruction, Const):
            return [instruction.value] * len(worlds)
        if register < self.program.terms:
            if t >= 0:
                return [self._first[register]] * len(worlds)
            return [math.nan, -math.inf, math.inf]
        fold = self._folds.get(register)
        if fold is not None:
            return [fold.value(world, t, self._values_of_unknowns) for world in worlds]
        function, args = cast("Map", instruction).function, cast("Map", instruction).args
        choose = FUNCTIONS[function].apply
        return [choose(*values) for values in zip(*(found[a] for a in args), strict=True)]

    def finish(self, end: End = "complete") -> float:
        if self.samples == 0:
            refuse_finish()
        if not self.finished:
            if end == "complete":
                self.lower = self.upper = self.robustness
            elif end == "cut":
                self._cut()
                self.robustness = moved(self.robustness, self.lower, self.upper)
            self.finished = True
        return self.robustness

    def _cut(self) -> None:
        t, worlds = self.samples - 1, [*OPEN.values(), *CUT]
        for stream in self._streams.values():
            stream.look(t, self._values_of_unknowns, worlds)
        self.lower, self.upper = self._results(t, CUT)

    def reset(self) -> None:
        super().reset()
        self.finished = False
        self._first = []
        for keeper in self._keepers:
            keeper.reset()
        for stream in self._streams.values():
            stream.look(-1, self._values_of_unknowns)
        self._conclude(-1)
