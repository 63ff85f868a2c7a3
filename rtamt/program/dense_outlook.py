"""The programs that bound the robustness of a trace in dense time, whatever comes after it.

They have no negations (`rtamt.program.polarity`), so every register is monotone in the predicates.
They run on a trace that is held beyond its last time. From the next tick on, a mask makes every
predicate -inf in the worst world, +inf in the best: times and bounds are whole ticks and windows
are closed, so at whole ticks nothing tells that from an unknown that begins at once. All masks are
variables, so that one program serves all traces.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from rtamt.language.interval import UNITS
from rtamt.language.node import Node
from rtamt.program.algebra import FOLDS
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.instructions import Const, Instruction, Load, Map, Window, latencies_of
from rtamt.program.polarity import positive
from rtamt.program.program import Program

__all__ = ["DenseOutlook", "Mask", "Plan", "look_out_dense"]


@dataclass(frozen=True, slots=True)
class Mask:
    """A variable that has one value up to a tick, and the opposite from the next one on.

    Attributes:
        value: The first value, +inf or -inf.
        last: The last tick at which it has that value.
    """

    value: float
    last: int


@dataclass(frozen=True, slots=True)
class Plan:
    """What a program for bounds needs beside the signals of a trace that begins at tick 0.

    Attributes:
        masks: For every variable that is no signal, in order.
        end: The tick to which signals and masks last.
    """

    masks: tuple[Mask, ...]
    end: int


@dataclass(frozen=True, eq=False, slots=True)
class DenseOutlook:
    """A program for one bound; its times are ticks.

    Attributes:
        dense: The program. Its variables are the specification's, then the masks.
        best: Whether the program is for the upper bound.
        cut: Whether windows without end stop at the end of the trace.
    """

    dense: DenseProgram
    best: bool
    cut: bool
    _folds: Mapping[int, tuple[int, int]]  # window without end: its masks from +inf, from -inf

    def plan(self, last: int) -> Plan:
        """The masks and the end for a trace that lasts from tick 0 to a tick.

        Beyond that tick every register is computed as far as the result at tick 0 depends on it;
        a window without end needs its operands until they keep their values.
        """
        program = self.dense.program
        settled = self._settled(last)
        needed = [0] * len(program.instructions)
        lasts: dict[int, int] = {}
        for register in range(len(needed) - 1, program.terms - 1, -1):
            match program.formula(register):
                case Map(_, args):
                    until = needed[register]
                case Window(_, _, None, args):
                    until = max(needed[register], *(settled[a] for a in args))
                    until = last if self.cut else until
                    lasts.update(dict.fromkeys(self._folds[register], until))
                case Window(_, _, hi, args):
                    until = needed[register] + (hi or 0)
            for a in args:
                needed[a] = max(needed[a], until)
        sign = math.inf if self.best else -math.inf
        count = 1 + 2 * len(self._folds)
        masks = [Mask(-sign, last)]
        masks += [Mask(math.inf if i % 2 else -math.inf, lasts[i]) for i in range(1, count)]
        return Plan(tuple(masks), max(last, *needed) + 2)

    def _settled(self, last: int) -> list[int]:
        """The tick from which on each register keeps its value."""
        program = self.dense.program
        settled = [last + 1] * program.terms
        for register in range(program.terms, len(program.instructions)):
            match program.formula(register):
                case Map(_, args):
                    settled.append(max(settled[a] for a in args))
                case Window(_, _, None, args):
                    settled.append(last + 1 if self.cut else max(settled[a] for a in args))
                case Window(_, lo, hi, args):
                    # Folds are idempotent: a window without begin needs a lasting value at its end.
                    begin = hi if lo is None else lo
                    settled.append(max(0, max(settled[a] for a in args) - (begin or 0)))
        return settled


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def look_out_dense(whole: DenseProgram, *, zero: float, best: bool, cut: bool) -> DenseOutlook:
    """The program that bounds the result of a program.

    Args:
        whole: The program.
        zero: What neutral predicates count, -0.0 or 0.0.
        best: Whether it is the upper bound.
        cut: Whether future operators without end speak of the recorded time alone; else the time
            after it has no end.
    """
    program = positive(whole.result_alone().program).reading(zero)
    writer = _Writer(program, best=best, cut=cut)
    masked = replace(
        program,
        instructions=tuple(writer.instructions),
        terms=writer.terms,
        latencies=latencies_of(writer.instructions),
        result=writer.new[program.result],
        variables=(*program.variables, *writer.masks),
        sources=tuple(writer.sources),
    )
    # A tick is one unit of time.
    dense = DenseProgram(masked, UNITS[program.specification.unit])
    return DenseOutlook(dense, best, cut, writer.folds)


class _Writer:
    """Writes the instructions of a program with masks."""

    def __init__(self, program: Program, *, best: bool, cut: bool) -> None:
        self.instructions: list[Instruction] = list(program.instructions[: program.terms])
        self.sources: list[Node] = list(program.sources[: program.terms])
        self.new = {r: r for r in range(program.terms)}
        self.masks: list[str] = []
        self.folds: dict[int, tuple[int, int]] = {}
        behind = range(program.terms, len(program.instructions))
        endless = [r for r in behind if _is_endless(program.formula(r))]
        source = program.sources[program.result]
        unknown, unseen = "max" if best else "min", self._mask(source)
        loads = {r: (self._mask(source), self._mask(source)) for r in endless}
        read = {a for r in behind for a in program.formula(r).args} | {program.result}
        for r in sorted(r for r in read if r < program.terms):
            # The constants stay: they keep their value at unseen times.
            if not isinstance(program.instructions[r], Const):
                self.new[r] = self._emit(Map(unknown, (r, unseen)), program.sources[r])
        self.terms = len(self.instructions)
        for r in behind:
            source = program.sources[r]
            instruction = program.formula(r)
            args = tuple(self.new[a] for a in instruction.args)
            if r not in loads:
                self.new[r] = self._emit(replace(instruction, args=args), source)
                continue
            args = self._until_lasting(program.window(r), args, loads[r], source)
            written = self._emit(replace(instruction, args=args), source)
            place = 1 + 2 * len(self.folds)
            self.folds[written] = place, place + 1
            # In a trace that was cut nothing is known of it after the end.
            self.new[r] = self._emit(Map(unknown, (written, unseen)), source) if cut else written

    def _until_lasting(
        self, window: Window, args: tuple[int, ...], masks: tuple[int, int], source: Node
    ) -> tuple[int, ...]:
        """Masks the operands of a window without end: in the end they are its fold's identity."""
        to_least, to_greatest = masks
        return tuple(
            self._emit(
                Map("max", (a, to_greatest)) if empty > 0 else Map("min", (a, to_least)), source
            )
            for a, empty in zip(args, FOLDS[window.fold].identity, strict=True)
        )

    def _mask(self, source: Node) -> int:
        self.masks.append(f"#{len(self.masks)}")  # no variable of a specification
        return self._emit(Load(self.masks[-1]), source)

    def _emit(self, instruction: Instruction, source: Node) -> int:
        self.instructions.append(instruction)
        self.sources.append(source)
        return len(self.instructions) - 1


def _is_endless(instruction: Map | Window) -> bool:
    return isinstance(instruction, Window) and instruction.hi is None
