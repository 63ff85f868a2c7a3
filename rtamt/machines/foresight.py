"""Bounds of the robustness at the first sample of a whole trace, found with discrete machines.

The readings of the end are those of `rtamt.machines.episode.machine`; here the samples are all
there. A window without end that is read at time 0 alone is folded over settled values once, and
from there over what differs from world to world.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.offline import MakeMachine, without_nan
from rtamt.machines.readout import verdict_of
from rtamt.machines.signals import (
    BOUNDS,
    ENDED,
    LOWER,
    UNSEEN,
    UPPER,
    FoldPass,
    Pass,
    Settled,
    Signal,
    Values,
    lasting,
    same,
)
from rtamt.machines.windows import fold_all
from rtamt.program.algebra import FOLDS, FUNCTIONS, Element
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.memory import limit_beyond
from rtamt.program.outlook import (
    Outlook,
    initial,
    look_out,
    looks_ahead,
    nested,
    planned,
    sufficient,
    throughout,
    together,
    unending,
)
from rtamt.program.program import Program

__all__ = ["Flags", "Foresight"]

Array = NDArray[np.float64]


class Flags(NamedTuple):
    """Whether something is the case at each time: not before ``start``, and the last one stays."""

    start: int
    values: NDArray[np.bool_]

    def at(self, time: int) -> bool:
        place = min(time - self.start, len(self.values) - 1)
        return place >= 0 and bool(self.values[place])

    def first(self, begin: int, end: int) -> int | None:
        """The first time from begin to end at which it is."""
        last = self.start + len(self.values) - 1
        low = max(begin, self.start)
        found = np.flatnonzero(self.values[low - self.start : max(0, end + 1 - self.start)])
        if len(found):
            return low + int(found[0])
        return max(begin, last) if end > last and self.values[-1] else None


class _Root:
    """A window without end that is read at time 0 alone."""

    def __init__(self, program: Program, register: int, machine: MakeMachine) -> None:
        part = throughout(program, register)
        self._fold = FOLDS[program.window(register).fold]
        self._machine = machine(part, SampleReader(part), tuple(part.outputs.values()))
        self._found: list[tuple[list[Array], Element]] = []

    def value(self, operands: Sequence[Values], *, recorded: bool) -> float:
        """The fold of the operands at recorded times, or at all."""
        settled = min(operand.settled for operand in operands)
        total = self._settled(operands[0].source, settled)
        last = operands[0].source.n - 1
        if not recorded:
            last = max(operand.settled + len(operand.rest) for operand in operands) - 1
        if last >= settled:
            rest = tuple(operand.rests(settled, last) for operand in operands)
            newer = tuple(a.item() for a in fold_all(self._fold, rest))
            total = self._fold.combine(total, newer)
        return total[-1]

    def _settled(self, source: Settled, n: int) -> Element:
        """The fold over the first n samples, which is the same in all worlds."""
        for before, found in self._found:
            if same(before, source.columns):
                return found
        element = self._fold.identity
        for end in range(n, 0, -source.block):
            begin = max(0, end - source.block)
            parts = source.between(begin, end)
            folded = self._machine.evaluate(parts, end - begin, backwards=True)
            older = tuple(values[0].item() for values in folded)
            element = self._fold.combine(older, element)
        self._found.append((list(source.columns), element))
        return element


class Foresight:
    """Bounds of the robustness at the first sample of a trace, whatever comes after it.

    Args:
        worst: The programs for the lower bound.
        best: Those for the upper bound and the robustness; others if there are neutral predicates.
        machine: Makes the discrete machines of a back-end.
        predicates: For every variable of the formulas its n values.
        n: Length of the trace, 1 or more.
    """

    def __init__(
        self,
        worst: Outlook,
        best: Outlook,
        machine: MakeMachine,
        predicates: Sequence[Array],
        n: int,
    ) -> None:
        self.outlook = worst
        self.n = n
        self._arguments = worst, best, machine
        self._predicates = predicates
        self._worst = _Reading(worst, machine, predicates, n)
        self._best = self._worst if best is worst else _Reading(best, machine, predicates, n)

    @classmethod
    def of(
        cls,
        program: Program,
        reader: SampleReader,
        machine: MakeMachine,
        columns: Sequence[Array],
        n: int,
    ) -> Foresight:
        """The bounds for a program, whose windows may have no end, and a trace.

        Args:
            program: The program.
            reader: Raises the errors of terms that are nan.
            machine: Makes the discrete machines of a back-end.
            columns: For every variable its n values, nan among them as the reader allows.
            n: Length of the trace, 1 or more.
        """
        bound = sufficient(program, n)
        limit_beyond(program.clamped(bound), n)
        worst = look_out(program, bound, best=False)
        best = look_out(program, bound, best=True) if program.neutral else worst
        needed = min(n, worst.needed or n)
        terms = worst.predicates
        predicates: list[Array] = []
        if terms.outputs:
            made = machine(terms, SampleReader(terms, reader.nan), tuple(terms.outputs.values()))
            found = without_nan(reader, columns, lambda known: made.evaluate(known, n))
            predicates = [column[:needed] for column in found]
        return cls(worst, best, machine, predicates, needed)

    def until(self, n: int) -> Foresight:
        """The bounds for the first n samples."""
        known = [column[:n] for column in self._predicates]
        return Foresight(*self._arguments, known, n)

    def robustness(self) -> tuple[float, float]:
        """The robustness if the trace is complete: two zeros if it hangs on neutral predicates."""
        return self._worst.at_zero(ENDED, cut=False), self._best.at_zero(ENDED, cut=False)

    def bounds(self, *, cut: bool) -> tuple[float, float]:
        """The least and the greatest robustness if the trace was cut, or goes on for ever."""
        pair = self._worst, self._best
        if cut and self._worst is not self._best:
            # Each is an episode of its own (`rtamt.machines.neutral`): what it decided stands.
            going_on = [[its.at_zero(world, cut=False) for world in BOUNDS] for its in pair]
            cuts = [verdict_of(*bounds) == 0 for bounds in going_on]
        else:
            cuts = [cut, cut]
        lower, upper = (
            its.at_zero(world, cut=its_cut)
            for its, world, its_cut in zip(pair, BOUNDS, cuts, strict=True)
        )
        return lower, upper

    def undecided(self, registers: tuple[int, ...], *, cut: bool) -> list[Flags]:
        """Where some registers of the formulas may be of either sign."""
        lower, low = self._worst.inputs(registers, LOWER, cut=cut)
        upper, high = self._best.inputs(registers, UPPER, cut=cut)
        if low is high and same(
            *([signal.recorded for signal in signals] for signals in (lower, upper))
        ):
            pairs = zip(
                low.values(lower, LOWER, self.n), high.values(upper, UPPER, self.n), strict=True
            )
            return [Flags(low.settled, _differ(low.rest, high.rest)) for low, high in pairs]
        both = zip(
            low.signals(lower, LOWER, self.n), high.signals(upper, UPPER, self.n), strict=True
        )
        return [
            Flags(0, np.concatenate([_differ(*pair) for pair in zip(*signals, strict=True)]))
            for signals in both
        ]


class _Reading:
    """The values of one outlook's formulas; the arguments are those of `Foresight`."""

    def __init__(
        self, outlook: Outlook, machine: MakeMachine, predicates: Sequence[Array], n: int
    ) -> None:
        self._outlook = outlook
        self._machine = machine
        self._n = n
        self._signals = [[Signal(column, unseen) for column in predicates] for unseen in UNSEEN]
        self._passes: dict[tuple[Program, tuple[int, ...]], tuple[list[FoldPass], Pass]] = {}
        self._roots: dict[tuple[Program, int], _Root] = {}
        self._at_once: dict[str, float] = {}

    def at_zero(self, world: int, *, cut: bool) -> float:
        """The result at time 0 in a world."""
        program = self._outlook.formulas
        if world != ENDED and not cut:
            open_end = unending(program, float(UNSEEN[world][0]))
            result = open_end.instructions[open_end.result]
            if isinstance(result, Const):
                return result.value
            if together(program) is None:
                return self._walked(open_end, world, cut=False)
        elif world != ENDED and looks_ahead(program):
            return self._walked(program, world, cut=True)
        else:  # where only windows without an end look ahead, a cut trace is like a complete one
            world = ENDED
        if not self._at_once:
            joint = together(program)
            if joint is not None:
                self._at_once = self._fused(joint)
            elif nested(program):
                self._at_once = self._fused(
                    program.restricted(program.result, {"nan": program.result})
                )
            else:
                self._at_once = {"nan": self._walked(program, ENDED, cut=False)}
        return self._at_once[str(UNSEEN[world][0])]

    def _fused(self, program: Program) -> dict[str, float]:
        """The outputs at time 0 if there is nothing after the trace, in one pass backwards."""
        program = program.mirrored()
        machine = self._machine(program, SampleReader(program), tuple(program.outputs.values()))
        columns = [signal.recorded for signal in self._signals[ENDED]]
        found = machine.evaluate(columns, self._n, backwards=True)
        return {name: float(values[0]) for name, values in zip(program.outputs, found, strict=True)}

    def _walked(self, program: Program, world: int, *, cut: bool) -> float:
        """The result at time 0 in a world, from what is read at time 0 alone."""
        found: dict[int, float] = {}
        for register in initial(program):
            match program.instructions[register]:
                case Const(value):
                    found[register] = value
                case Load(variable):
                    column = self._signals[world][program.variables.index(variable)].recorded
                    found[register] = float(column[0])
                case Map(function, args):
                    apply = FUNCTIONS[function].apply
                    found[register] = functools.reduce(apply, (found[a] for a in args))
                case Window(_, _, None, args):  # it begins now: a later begin is a shift
                    key = program, register
                    if key not in self._roots:
                        self._roots[key] = _Root(program, register, self._machine)
                    operands = self._values(program, args, world, cut=cut)
                    recorded = cut or world == ENDED
                    found[register] = self._roots[key].value(operands, recorded=recorded)
                case Window():
                    (its,) = self._values(program, (register,), world, cut=cut)
                    found[register] = its.at(0)
        return found[program.result]

    def _values(
        self, program: Program, registers: tuple[int, ...], world: int, *, cut: bool
    ) -> list[Values]:
        """The values of some registers in a world."""
        signals, last = self._inputs(program, registers, world, cut=cut)
        return last.values(signals, world, self._n)

    def inputs(
        self, registers: tuple[int, ...], world: int, *, cut: bool
    ) -> tuple[list[Signal], Pass]:
        """The pass that finds some registers of the formulas, and the signals that it needs."""
        return self._inputs(self._outlook.formulas, registers, world, cut=cut)

    def _inputs(
        self, program: Program, registers: tuple[int, ...], world: int, *, cut: bool
    ) -> tuple[list[Signal], Pass]:
        key = program, registers
        if key not in self._passes:
            folded, last = planned(program, registers)
            folds = [FoldPass(window, self._machine) for window in folded]
            self._passes[key] = folds, Pass(last, self._machine)
        folds, final = self._passes[key]
        signals = self._signals[world][:]
        for fold in folds:
            signals.append(fold.signal(signals, world, self._n, cut=cut))
        return signals, final


def _differ(low: Array, high: Array) -> NDArray[np.bool_]:
    """Where the sign bits differ; the last values stay."""
    length = max(len(low), len(high))
    differ: NDArray[np.bool_] = np.signbit(lasting(low, length)) != np.signbit(
        lasting(high, length)
    )
    return differ
