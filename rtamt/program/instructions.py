"""The four instructions of a compiled specification.

=======================  =====================================================================
``LOAD variable``        the variable's sample
``CONST value``          one value at every sample
``MAP f args``           a function of the registers' values at one time
``WINDOW f lo hi args``  a lattice fold over offsets lo to hi from now, cut to the trace
=======================  =====================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import assert_never

from rtamt.language.interval import number_text
from rtamt.program.algebra import FOLDS


@dataclass(frozen=True, slots=True)
class Load:
    """The variable's sample."""

    variable: str


@dataclass(frozen=True, slots=True)
class Const:
    """One value at every sample, seen or not.

    A neutral one is a predicate that counts 0 under interface-aware semantics: it neither holds nor
    fails, so its bounds are -0.0 and +0.0.
    """

    value: float
    neutral: bool = False


@dataclass(frozen=True, slots=True)
class Map:
    """A function of the operands' values at one time."""

    function: str
    args: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Window:
    """A lattice fold over offsets ``lo`` to ``hi`` from now; None is unbounded.

    The last two fields matter only to machines that compute bounds.
    """

    fold: str
    lo: int | None
    hi: int | None
    args: tuple[int, ...]
    # whether it must hold before a witness of ``until``, or of its dual. If the witness is there,
    # so is everything before it; other windows of the future may lack unseen elements
    guard: bool = False
    endless: bool = False  # whether it is part of an operator without an end that starts at `begin`

    @property
    def length(self) -> int | None:
        """The number of samples that it covers; None is unbounded."""
        return None if self.lo is None or self.hi is None else self.hi - self.lo + 1

    @property
    def ahead(self) -> bool:
        """True if the window reads later elements."""
        return self.hi is None or self.hi > 0

    @property
    def begin(self) -> int:
        """The offset at which the operator of an ``endless`` window starts."""
        return (self.hi or 0) + 1 if self.guard else self.lo or 0

    def skips(self, *, best: bool) -> bool:
        """Return whether a bound ignores unseen elements, because they may not exist.

        The upper bound of minima and the lower bound of maxima do, except for the window's own
        time.
        """
        return self.ahead and not self.guard and (FOLDS[self.fold].identity[-1] > 0) == best

    def mirrored(self) -> Window:
        """Return the same window with time flipped: future is past."""
        lo = None if self.hi is None else -self.hi
        hi = None if self.lo is None else -self.lo
        return replace(self, fold=FOLDS[self.fold].mirror, lo=lo, hi=hi)


Instruction = Load | Const | Map | Window


def operands(instruction: Instruction) -> tuple[int, ...]:
    """Return the registers that the instruction reads."""
    match instruction:
        case Load() | Const():
            return ()
        case Map() | Window():
            return instruction.args
        case _ as never:
            assert_never(never)


def listed(instruction: Instruction) -> str:
    """Return the text of an instruction in a listing."""
    match instruction:
        case Load(variable):
            return f"LOAD {variable}"
        case Const(value, neutral):
            return f"CONST {number_text(value)}{', neutral' if neutral else ''}"
        case Map(function, args):
            return " ".join(["MAP", function, *map(str, args)])
        case Window(fold, lo, hi, args):
            bounds = f"[{'-inf' if lo is None else lo}, {'inf' if hi is None else hi}]"
            marks = [", guard"] * instruction.guard + [", endless"] * instruction.endless
            return " ".join(["WINDOW", fold, bounds, *map(str, args)]) + "".join(marks)
        case _ as never:
            assert_never(never)


def latency_of(
    instruction: Instruction,
    latencies: Sequence[int | None],
    instructions: Sequence[Instruction],
) -> int | None:
    """Return the latency of an instruction, from the previous instructions and latencies."""
    late = 0
    for operand in operands(instruction):
        if not isinstance(instructions[operand], Const):
            of_operand = latencies[operand]
            if of_operand is None:
                return None
            late = max(late, of_operand)
    if isinstance(instruction, Window):
        return None if instruction.hi is None else max(0, late + instruction.hi)
    return late
