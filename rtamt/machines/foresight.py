"""Bounds of the robustness at the first sample of a whole trace, found with discrete machines.

It reads the end as `rtamt.machines.episode.machine` does; here the samples are all there. A window
without end that is read at time 0 alone is folded over settled values once, and from there over
what differs from world to world.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.offline import MakeMachine, without_nan
from rtamt.machines.protocols import End
from rtamt.machines.ranges import FindRanges
from rtamt.machines.signals import (
    BOUNDS,
    ENDED,
    LOWER,
    UNSEEN,
    UPPER,
    FoldPass,
    Pass,
    Settled,
    Values,
    WholeSignal,
    WindowPass,
    lasting,
    same,
)
from rtamt.machines.windows import fold_all
from rtamt.program.algebra import FOLDS, FUNCTIONS, Element
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.memory import limit_beyond
from rtamt.program.outlook import (
    Outlook,
    at_unseen,
    initial,
    look_out,
    looks_ahead,
    nested,
    otherwise_read,
    outputs_among,
    planned,
    read_beyond,
    sufficient,
    throughout,
    together,
    unending,
)
from rtamt.program.program import Program

__all__ = ["Flags", "Foresight"]

Array = NDArray[np.float64]


class Flags(NamedTuple):
    """Whether something is the case at each time; the last one stays."""

    values: NDArray[np.bool_]

    def at(self, time: int) -> bool:
        return bool(self.values[min(time, len(self.values) - 1)])

    def first(self, begin: int, end: int) -> int | None:
        """The first time from begin to end at which it is."""
        found = np.flatnonzero(self.values[begin : max(0, end + 1)])
        if len(found):
            return begin + int(found[0])
        last = len(self.values) - 1
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
    """Bounds of the robustness at the first sample of a trace, however it ends.

    Args:
        worst: The programs for the lower bound.
        best: The programs for the upper bound and the robustness; others with neutral predicates.
        machine: Makes the discrete machines of a back-end.
        least: For every variable of the formulas its n values, the least ones of what is not known.
        greatest: The greatest ones; the same object if all are known.
        n: Length of the trace, 1 or more.

    Attributes:
        outlook: The programs for the lower bound.
        machine: As it was given.
        n: As it was given.
    """

    def __init__(
        self,
        worst: Outlook,
        best: Outlook,
        machine: MakeMachine,
        least: Sequence[Array],
        greatest: Sequence[Array],
        n: int,
    ) -> None:
        self.outlook = worst
        self.machine = machine
        self.n = n
        self._arguments = worst, best, machine
        self._predicates = least, greatest
        self._worst = _Reading(worst, machine, least, n)
        self._given = self._worst if best is worst else _Reading(best, machine, least, n)
        self._best = self._given if greatest is least else _Reading(best, machine, greatest, n)

    @classmethod
    def of(
        cls,
        program: Program,
        reader: SampleReader,
        machine: MakeMachine,
        ranges: FindRanges,
        columns: tuple[Sequence[Array], Sequence[Array]],
        n: int,
        *,
        everywhere: bool = False,
    ) -> Foresight:
        """The bounds for a program, whose windows may have no end, and a trace.

        Args:
            program: The program.
            reader: Raises the errors of terms that are nan.
            machine: Makes the discrete machines of a back-end.
            ranges: Finds the terms of samples that are not known.
            columns: For every variable its n least and its n greatest values; the same object if
                all are known, nan among them as the reader allows.
            n: Length of the trace, 1 or more.
            everywhere: Whether `fails` and `holds` will be asked for, about every sample.
        """
        bound = sufficient(program, n)
        lower, upper = columns
        limit_beyond(program.clamped(bound), n, unknown=upper is not lower)
        worst = look_out(program, bound, best=False)
        best = look_out(program, bound, best=True) if program.neutral else worst
        needed = n if everywhere else min(n, worst.needed or n)
        terms = worst.predicates
        observed = tuple(terms.outputs.values())
        least: list[Array] = []
        if terms.outputs and upper is not lower:
            least, greatest = (
                [column[:needed] for column in found]
                for found in ranges(terms, reader, observed, lower, upper, n)
            )
            return cls(worst, best, machine, least, greatest, needed)
        if terms.outputs:
            made = machine(terms, SampleReader(terms), observed)
            found = without_nan(reader, lower, lambda known: made.evaluate(known, n))
            least = [column[:needed] for column in found]
        return cls(worst, best, machine, least, least, needed)

    def part(self, program: Program) -> Foresight:
        """The bounds for another program on the trace, which reads no other predicates.

        It has the semantics and the variables of this one's program.
        """
        bound = sufficient(program, self.n)
        worst = look_out(program, bound, best=False)
        best = look_out(program, bound, best=True) if program.neutral else worst
        places = outputs_among(worst.predicates, self.outlook.predicates)
        least, greatest = self._predicates
        low = [least[place] for place in places]
        high = low if greatest is least else [greatest[place] for place in places]
        return Foresight(worst, best, self._arguments[2], low, high, self.n)

    def predicates(self, *, best: bool) -> Sequence[Array]:
        """The greatest or the least values of the predicates, the outputs of `outlook`'s."""
        return self._predicates[best]

    def fails(self, end: End) -> NDArray[np.bool_]:
        """Whether the result fails for certain, at every sample."""
        return np.signbit(self._best.recorded(UPPER, end))

    def holds(self, end: End) -> NDArray[np.bool_]:
        """Whether the result holds for certain, at every sample."""
        return ~np.signbit(self._worst.recorded(LOWER, end))

    def until(self, n: int) -> Foresight:
        """The bounds for the first n samples."""
        least, greatest = self._predicates
        low = [column[:n] for column in least]
        high = low if greatest is least else [column[:n] for column in greatest]
        return Foresight(*self._arguments, low, high, n)

    def robustness(self) -> float:
        """The robustness if the trace is complete, the least one of what is not known."""
        return self._given.at_zero(ENDED, cut=False)

    def bounds(self, end: End) -> tuple[float, float]:
        """The least and the greatest robustness that a reading of the end leaves possible.

        If the trace is complete both are its robustness, but for two zeros if it hangs on neutral
        predicates, and for what is not known.
        """
        worlds = (ENDED, ENDED) if end == "complete" else BOUNDS
        lower, upper = (
            its.at_zero(world, cut=end == "cut")
            for its, world in zip((self._worst, self._best), worlds, strict=True)
        )
        return lower, upper

    def undecided(self, registers: tuple[int, ...], end: End) -> list[Flags]:
        """Where some registers of the formulas may be of either sign; for a trace that goes on."""
        lower, low = self._worst.inputs(registers, LOWER, cut=end == "cut")
        upper, high = self._best.inputs(registers, UPPER, cut=end == "cut")
        both = zip(
            low.signals(lower, LOWER, self.n), high.signals(upper, UPPER, self.n), strict=True
        )
        return [
            Flags(np.concatenate([_differ(*pair) for pair in zip(*signals, strict=True)]))
            for signals in both
        ]


class _Reading:
    """The values of one outlook's formulas; `Foresight` documents the arguments."""

    def __init__(
        self, outlook: Outlook, machine: MakeMachine, predicates: Sequence[Array], n: int
    ) -> None:
        self._outlook = outlook
        self._machine = machine
        self._n = n
        self._signals = [
            [WholeSignal(column, unseen) for column in predicates] for unseen in UNSEEN
        ]
        self._passes: dict[tuple[object, ...], _Passes] = {}
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

    def recorded(self, world: int, end: End) -> Array:
        """The result at every recorded time, in a world of a reading of the end."""
        program = self._outlook.formulas
        instruction = program.instructions[program.result]
        if isinstance(instruction, Load):
            place = program.variables.index(instruction.variable)
            return self._signals[world][place].recorded
        if isinstance(instruction, Const):
            return np.full(self._n, instruction.value)
        world = ENDED if end == "complete" else world
        signals, last = self._inputs(program, (program.result,), world, cut=end == "cut")
        return last.signals(signals, world, self._n)[0].recorded

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
                case Window(_, _, None, args) as window:  # it begins now: a later begin is a shift
                    key = program, register
                    if key not in self._roots:
                        self._roots[key] = _Root(program, register, self._machine)
                    operands = self._values(program, args, world, cut=cut)
                    recorded = cut or world == ENDED or window.skips(best=world == UPPER)
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
    ) -> tuple[list[WholeSignal], Pass]:
        """The pass that finds some registers of the formulas, and the signals that it needs.

        They are found at unseen times too.
        """
        return self._inputs(self._outlook.formulas, registers, world, cut=cut, beyond=True)

    def _inputs(
        self,
        program: Program,
        registers: tuple[int, ...],
        world: int,
        *,
        cut: bool,
        beyond: bool = False,
    ) -> tuple[list[WholeSignal], Pass]:
        others = read = frozenset[int]()
        if world != ENDED:
            read = read_beyond(program, registers, also=beyond or not cut)
            others = otherwise_read(program, registers, best=world == UPPER, cut=cut, read=read)
        key = program, registers, world, others, read
        if key not in self._passes:
            self._passes[key] = _Passes(program, registers, world, others, read, self._machine)
        passes = self._passes[key]
        return passes.signals(self._signals[world], self._n, cut=cut), passes.last


class _Passes:
    """The passes that find some registers of a program in a world.

    Attributes:
        last: The last one; those before it find variables that it needs.
    """

    def __init__(
        self,
        program: Program,
        registers: tuple[int, ...],
        world: int,
        others: frozenset[int],
        read: frozenset[int],
        machine: MakeMachine,
    ) -> None:
        windows, last = planned(program, registers, others)
        unread = float(UNSEEN[world][0])
        beyond = [
            value if register in read else unread
            for register, value in enumerate(at_unseen(program, best=world == UPPER))
        ]
        self._world = world
        self._windows = [
            WindowPass(each, machine)
            if each.window.hi is not None
            else FoldPass(each, machine, beyond[each.register])
            for each in windows
        ]
        self.last = Pass(last, machine)

    def signals(self, known: Sequence[WholeSignal], n: int, *, cut: bool) -> list[WholeSignal]:
        """The variables of the last pass, of which the first ones are known."""
        signals, opened = [*known], [*known]
        needs_open = cut and any(window.needs_open for window in self._windows)
        for window in self._windows:
            its = None
            if needs_open:
                its = window.signal(opened, self._world, n, None, cut=False)
                opened.append(its)
            signals.append(window.signal(signals, self._world, n, its, cut=cut))
        return signals


def _differ(low: Array, high: Array) -> NDArray[np.bool_]:
    """Where the sign bits differ; the last values stay."""
    length = max(len(low), len(high))
    differ: NDArray[np.bool_] = np.signbit(lasting(low, length)) != np.signbit(
        lasting(high, length)
    )
    return differ
