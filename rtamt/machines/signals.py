"""Registers as signals over a whole trace and what comes after it, found with discrete machines.

A signal is what was recorded, and what comes after it: its last value there stays for ever. Values
that depend on recorded samples alone are settled, and the same in every world.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.offline import MakeMachine
from rtamt.machines.protocols import DiscreteMachine, MachineState
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Load
from rtamt.program.outlook import (
    past,
    reaches,
)
from rtamt.program.passes import Folded
from rtamt.program.program import Program

__all__ = [
    "BOUNDS",
    "ENDED",
    "UNSEEN",
    "FoldPass",
    "Pass",
    "Settled",
    "Values",
    "WholeSignal",
    "WindowPass",
    "lasting",
    "same",
]

Array = NDArray[np.float64]

LOWER, UPPER, ENDED = range(3)
"""The worlds: unseen predicates are -inf, or +inf; or there are none, since the trace is complete.
"""
BOUNDS = LOWER, UPPER

_BLOCK = 65536  # samples of which nothing but a fold is kept, in memory that is at hand

UNSEEN = tuple(np.array([value]) for value in (-math.inf, math.inf, math.nan))


class WholeSignal(NamedTuple):
    """The values of a register at all times; the last of those beyond the trace stays for ever."""

    recorded: Array
    beyond: Array


class Values(NamedTuple):
    """The values of a register: settled ones, which hold in every world, and those after them.

    Attributes:
        source: Gives the settled values.
        place: Which output of the source it is.
        settled: How many values are settled.
        rest: The values after them in one world; the last one stays for ever.
    """

    source: Settled
    place: int
    settled: int
    rest: Array

    def at(self, time: int) -> float:
        """The value of a time."""
        if time < self.settled:
            return float(self.source.between(time, time + 1)[self.place][0])
        return float(self.rest[min(time - self.settled, len(self.rest) - 1)])

    def signal(self) -> WholeSignal:
        """The values of all times."""
        known = self.source.n - self.settled
        (recorded, rest) = self.source.between(0, self.settled)[self.place], self.rest
        if known:
            recorded = np.concatenate([recorded, rest[:known]])
        return WholeSignal(recorded, rest[known:])

    def rests(self, begin: int, end: int) -> Array:
        """The values of times begin to end, of which few are settled."""
        first = self.rest[:0]
        if begin < self.settled:
            first = self.source.between(begin, self.settled)[self.place]
        return lasting(np.concatenate([first, self.rest]), end + 1 - begin)


class Settled:
    """Outputs of a program for recorded columns of its variables, at times that are settled.

    Args:
        program: The program; one that computes nothing needs no machine.
        machine: Runs it.
        columns: For every variable its n values.
        n: Length of the trace.
    """

    def __init__(
        self, program: Program, machine: DiscreteMachine, columns: Sequence[Array], n: int
    ) -> None:
        self.columns = columns
        self.n = n
        self._machine = machine
        self._variables = _variables(program)
        self._past = past(program)
        self._late = max(program.latencies[r] or 0 for r in program.outputs.values())
        self._whole: list[Array] | None = None
        self.block = max(_BLOCK, 4 * (self._late + (self._past or 0)))

    def between(self, begin: int, end: int) -> list[Array]:
        """The outputs at times from begin to before end."""
        if self._variables is not None:
            return [self.columns[i][begin:end] for i in self._variables]
        past, most = self._past, max(self.block, self.n // 2)
        if self._whole is None and past is not None and end - begin <= most:
            # Only the samples on which these values depend.
            first, last = max(0, begin - past), min(self.n, end + self._late)
            found = self._machine.evaluate([c[first:last] for c in self.columns], last - first)
            return [values[begin - first : end - first] for values in found]
        if self._whole is None:
            self._whole = self._machine.evaluate(self.columns, self.n)
        return [values[begin:end] for values in self._whole]


class Pass:
    """A machine, and what it gave for the signals that came so far."""

    def __init__(self, program: Program, machine: MakeMachine) -> None:
        self._program = program
        self._registers = tuple(program.outputs.values())
        self._machine = machine(program, SampleReader(program), self._registers)
        self._late = [program.latencies[r] or 0 for r in self._registers]
        self._past = past(program)
        self._settled: list[Settled] = []
        self._ends: list[tuple[list[Array], list[Array], MachineState]] = []
        self._signals: list[tuple[list[Array], bool, list[WholeSignal]]] = []

    def signals(self, signals: Sequence[WholeSignal], world: int, n: int) -> list[WholeSignal]:
        """The outputs at all times; the same arrays for the same arrays."""
        variables = _variables(self._program)
        if variables is not None:
            return [signals[i] for i in variables]
        arrays = [array for signal in signals for array in signal]
        ended = world == ENDED
        for before, its, found in self._signals:
            if its == ended and same(before, arrays):
                return found
        found = [its.signal() for its in self.values(signals, world, n)]
        self._signals.append((arrays, ended, found))
        return found

    def values(self, signals: Sequence[WholeSignal], world: int, n: int) -> list[Values]:
        """The outputs for signals of the program's variables."""
        source = self._source([signal.recorded for signal in signals], n)
        settled = [max(0, n - late) for late in self._late]
        if world == ENDED:
            begin = min(settled)
            found = source.between(begin, n)
            rests = [found[i][place - begin :] for i, place in enumerate(settled)]
        else:
            rests = self._rests(signals, settled, n)
        rows = enumerate(zip(settled, rests, strict=True))
        return [Values(source, i, place, rest) for i, (place, rest) in rows]

    def _source(self, columns: list[Array], n: int) -> Settled:
        for source in self._settled:
            if same(source.columns, columns):
                return source
        self._settled.append(Settled(self._program, self._machine, columns, n))
        return self._settled[-1]

    def _rests(self, signals: Sequence[WholeSignal], settled: Sequence[int], n: int) -> list[Array]:
        """The values after the settled ones if the trace goes on."""
        ahead = [len(signal.beyond) - 1 for signal in signals]
        reach = reaches(self._program, dict(zip(self._program.variables, ahead, strict=True)))
        after = [reach[r] for r in self._registers]
        length = max(late + last + 1 for late, last in zip(self._late, after, strict=True))
        # The samples on which these values depend; the first of them is sample 0 of the machine.
        start = 0 if self._past is None else max(0, min(settled) - self._past)
        ends, state = self._end([signal.recorded for signal in signals], start, n)
        self._machine.restore(state)
        found = self._machine.run([lasting(signal.beyond, length) for signal in signals], length)
        rests = []
        for i, (begin, late) in enumerate(zip(settled, self._late, strict=True)):
            values = np.concatenate([ends[i], found[i]])[begin - start + late :]
            rests.append(values[: n + after[i] + 1 - begin])
        return rests

    def _end(self, columns: list[Array], start: int, n: int) -> tuple[list[Array], MachineState]:
        """The outputs after each sample from a start on, and the machine's state at the end."""
        for before, found, state in self._ends:
            if same(before, columns):
                return found, state
        self._machine.reset()
        found = self._machine.run([column[start:] for column in columns], n - start)
        state = self._machine.state()
        self._ends.append((columns, found, state))
        return found, state


def _variables(program: Program) -> list[int] | None:
    """The places of the outputs among the variables, if the program computes nothing."""
    places = []
    for register in program.outputs.values():
        instruction = program.instructions[register]
        if not isinstance(instruction, Load):
            return None
        places.append(program.variables.index(instruction.variable))
    return places


class WindowPass:
    """A window with an end, which reads unseen elements otherwise than a machine does.

    In the open reading it is a window that skips them; in the cut reading, a part of an operator
    without end.

    Attributes:
        needs_open: Whether its values in the cut reading need its values in the open one.
    """

    def __init__(self, folded: Folded, machine: MakeMachine) -> None:
        self._window = folded.window
        self._operands = Pass(folded.operands, machine)
        self._fold = Pass(folded.fold, machine)
        self.needs_open = folded.window.endless

    def signal(
        self,
        signals: Sequence[WholeSignal],
        world: int,
        n: int,
        opened: WholeSignal | None,
        *,
        cut: bool,
    ) -> WholeSignal:
        """The folds at all times.

        Args:
            signals: The signals of the variables of its operands.
            world: The world, of a trace that is not complete.
            n: Length of the trace.
            opened: If the trace was cut and `needs_open`, the folds of the open reading.
            cut: Whether the trace was cut.
        """
        window, operands = self._window, self._operands.signals(signals, world, n)
        if not cut and window.skips(best=world == UPPER):
            (found,) = self._fold.signals(operands, ENDED, n)
            nothing = np.array(FOLDS[window.fold].identity[-1:])
            return WholeSignal(found.recorded, nothing if window.lo else operands[-1].beyond)
        (found,) = self._fold.signals(operands, world, n)
        if opened is None or not window.endless:
            return found
        at = max(0, n - window.begin)
        return WholeSignal(
            np.concatenate([found.recorded[:at], opened.recorded[at:]]), opened.beyond
        )


class FoldPass:
    """A window without end, folded backwards, and what it gave for signals so far.

    Args:
        folded: The window.
        machine: Makes the discrete machines of a back-end.
        beyond: Its value at all unseen times of the open reading, if it is known.

    Attributes:
        needs_open: Whether its values in the cut reading need its values in the open one.
    """

    def __init__(self, folded: Folded, machine: MakeMachine, beyond: float | None) -> None:
        self._window = folded.window
        self._operands = Pass(folded.operands, machine)
        fold = folded.fold
        self._machine = machine(fold, SampleReader(fold), tuple(fold.outputs.values()))
        self._beyond = beyond
        self._found: list[tuple[list[Array], Array]] = []
        self.needs_open = beyond is None

    def signal(
        self,
        signals: Sequence[WholeSignal],
        world: int,
        n: int,
        opened: WholeSignal | None,
        *,
        cut: bool,
    ) -> WholeSignal:
        """The fold of the operands from every time on; `WindowPass` documents the arguments."""
        operands = self._operands.signals(signals, world, n)
        recorded = [operand.recorded for operand in operands]
        if world == ENDED:
            return WholeSignal(self._folded(recorded), UNSEEN[world])
        if cut:  # it speaks of recorded times alone
            known = np.array([self._beyond]) if opened is None else opened.beyond
            return WholeSignal(self._folded(recorded), known)
        # Of what comes later, the fold reads the last operand alone (`rtamt.program.algebra`).
        last = operands[-1].beyond
        nothing = FOLDS[self._window.fold].identity[-1]
        if self._window.skips(best=world == UPPER) or (len(last) == 1 and last[0] == nothing):
            return WholeSignal(self._folded(recorded), last)
        length = max(len(operand.beyond) for operand in operands)
        whole = [np.concatenate([o.recorded, lasting(o.beyond, length)]) for o in operands]
        folded = self._folded(whole)
        return WholeSignal(folded[:n], folded[n:])

    def _folded(self, columns: list[Array]) -> Array:
        for before, found in self._found:
            if same(before, columns):
                return found
        (found,) = self._machine.evaluate(columns, len(columns[0]), backwards=True)
        self._found.append((columns, found))
        return found


def same(some: Sequence[Array], others: Sequence[Array]) -> bool:
    """Whether these are the same arrays."""
    return len(some) == len(others) and all(map(operator.is_, some, others))


def lasting(values: Array, length: int) -> Array:
    """The values up to a length; the last one stays."""
    missing = length - len(values)
    if missing <= 0:
        return values[:length]
    return np.concatenate([values, np.full(missing, values[-1])])
