"""A compiled specification: a program of instructions with a latency for each register.

Each instruction writes the register of its index. The first `Program.terms` instructions are
arithmetic over the present sample; the others are formulas. At sample t, a register of latency L
has its value of time t - L; operands of a lower latency reach it through delay lines
(`Program.delay`). This is pastification (Nickovic and Yamaguchi, ATVA 2020) on numbers instead of
syntax trees.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

from rtamt.errors import Argument, Message
from rtamt.language.node import Node
from rtamt.program.algebra import FUNCTIONS, Range, range_of
from rtamt.program.instructions import (
    Const,
    Instruction,
    Load,
    Map,
    Window,
    latency_of,
    listed,
    operands,
)

if TYPE_CHECKING:
    from rtamt.language.specification import Specification


@dataclass(frozen=True, eq=False)
class Program:
    """A compiled specification."""

    instructions: tuple[Instruction, ...]  # every register is written before it is read
    terms: int  # the number of first instructions that are arithmetic over the present sample
    result: int  # the register of the robustness
    outputs: Mapping[str, int]  # the registers of the named formulas
    variables: tuple[str, ...]  # the inputs, in the order of samples
    sources: tuple[Node, ...]  # the node of each register, for errors and listings
    specification: Specification
    aligned: tuple[str, ...] = ()  # the texts of `timing.alignment` for rounded intervals
    rates: Mapping[str, str] = field(default_factory=dict)
    """The rates of change among the variables, which readers of samples compute, and the variable
    of each."""
    seconds: float = 1.0  # the time between samples, for rates

    @functools.cached_property
    def latencies(self) -> tuple[int | None, ...]:
        """The delay of each register in samples; None if it needs the whole future."""
        latencies: list[int | None] = []
        for instruction in self.instructions:
            latencies.append(latency_of(instruction, latencies, self.instructions))
        return tuple(latencies)

    @property
    def inputs(self) -> tuple[str, ...]:
        """The variables of callers: all but the rates."""
        if not self.rates:
            return self.variables
        return tuple(name for name in self.variables if name not in self.rates)

    @property
    def latency(self) -> int | None:
        """The delay of the robustness in samples; None if it needs the whole future."""
        return self.latencies[self.result]

    def term(self, register: int) -> Load | Const | Map:
        """Return the instruction of a register of the terms."""
        return cast("Load | Const | Map", self.instructions[register])

    def formula(self, register: int) -> Map | Window:
        """Return the instruction of a register after the terms."""
        return cast("Map | Window", self.instructions[register])

    def window(self, register: int) -> Window:
        """Return the instruction of a register that is a window."""
        return cast("Window", self.instructions[register])

    @property
    def windows(self) -> list[Window]:
        """The windows, in order."""
        return [i for i in self.instructions if isinstance(i, Window)]

    def delay(self, register: int, operand: int) -> int:
        """Return the number of samples by which a register with a latency delays an operand."""
        instruction = self.instructions[register]
        if isinstance(self.instructions[operand], Const):
            return 0
        windowed = isinstance(instruction, Window)
        read = self.start(register) if windowed else cast("int", self.latencies[register])
        return read - cast("int", self.latencies[operand])

    def start(self, register: int) -> int:
        """Return the first sample at which a window with a latency reads its operands."""
        return cast("int", self.latencies[register]) - cast("int", self.window(register).hi)

    def online(
        self, monitor: str = "Monitor", instead: str | Argument = "use EpisodeMonitor or evaluate()"
    ) -> Program:
        """Return the program for a monitor, in which every register has a latency.

        A top-level ``always p`` or ``eventually p`` without an end becomes the fold over all
        samples so far. Any other unbounded future is refused.
        """
        program = self.running(self.specification.formula)
        for register, instruction in enumerate(program.instructions):
            if isinstance(instruction, Window) and instruction.hi is None:
                source = program.sources[register]
                symbol = source.op.symbol if source.op else ""
                raise program.specification.error(
                    source,
                    f"'{symbol}' without an end needs the whole future, and {monitor} cannot wait "
                    "for it",
                    Message(f"write an end, as in {symbol}[0:10], or ", instead),
                )
        return program

    def running(self, *formulas: Node) -> Program:
        """Return the program in which formulas are judged as a whole trace of their own.

        Those that are ``always p`` or ``eventually p`` without an end become folds over all samples
        so far, as result and as output; inside other formulas they stay as they are.
        """
        instructions, sources = list(self.instructions), list(self.sources)
        folds: dict[int, int] = {}

        def judged(formula: Node, register: int) -> int:
            window = self.instructions[register]
            if not isinstance(window, Window) or window.hi is not None:
                return register
            if not (any(formula is other for other in formulas) and self._is_running(formula)):
                return register
            if register not in folds:
                folds[register] = len(instructions)
                instructions.append(Window(window.fold, None, 0, window.args))
                sources.append(self.sources[register])
            return folds[register]

        named = self.specification.formulas
        result = judged(self.specification.formula, self.result)
        outputs = {name: judged(named[name], register) for name, register in self.outputs.items()}
        if not folds:
            return self
        longer = replace(self, instructions=tuple(instructions), sources=tuple(sources))
        return longer.restricted(result, outputs)

    def _is_running(self, formula: Node) -> bool:
        """Return whether a formula is ``always p`` or ``eventually p`` without bounds.

        The instruction does not show it: ``eventually[0:0](eventually p)`` compiles to the same
        one.
        """
        op, (begin, end) = formula.op, self.specification.bounds(formula.interval)
        single = op is not None and op.future and len(formula.args) == 1
        return single and begin == 0 and end is None

    def restricted(self, result: int, outputs: Mapping[str, int]) -> Program:
        """Return the part of the program that computes this result and these outputs."""
        registers = sorted(self.needed(result, *outputs.values()))
        part = replace(self, result=result, outputs=outputs)
        return part.reordered(registers, sum(r < self.terms for r in registers))

    def read_first(self) -> frozenset[str]:
        """Return the variables whose value at sample 0 can affect the result."""
        times: dict[int, set[tuple[int, float]]] = {self.result: {(0, 0)}}
        variables = set[str]()
        for register in range(len(self.instructions) - 1, -1, -1):
            spans = times.pop(register, set())
            match self.instructions[register]:
                case Load(variable) if any(b <= (variable in self.rates) <= e for b, e in spans):
                    # a rate reads its variable one sample late
                    variables.add(self.rates.get(variable, variable))
                case Map(_, args):
                    for a in args:
                        times.setdefault(a, set()).update(spans)
                case Window(_, lo, hi, args):
                    for begin, end in spans:
                        last = math.inf if hi is None else end + hi
                        first = 0 if lo is None else max(0, begin + lo)
                        if last >= 0:  # nothing is read before sample 0
                            for a in args:
                                times.setdefault(a, set()).add((first, last))
                case Load() | Const():
                    pass
        return frozenset(variables)

    def needed(self, *registers: int) -> set[int]:
        """Return these registers and all that they are computed from."""
        needed: set[int] = set()
        stack = [*registers]
        while stack:
            register = stack.pop()
            if register not in needed:
                needed.add(register)
                stack.extend(operands(self.instructions[register]))
        return needed

    def reordered(self, order: list[int], terms: int) -> Program:
        """Return the program of these registers in this order, ``terms`` of them terms."""
        new = {old: i for i, old in enumerate(order)}
        instructions = tuple(_renumbered(self.instructions[r], new) for r in order)
        return replace(
            self,
            instructions=instructions,
            terms=terms,
            result=new[self.result],
            outputs={name: new[register] for name, register in self.outputs.items()},
            sources=tuple(self.sources[r] for r in order),
        )

    def changed(self, change: Callable[[Instruction], Instruction]) -> Program:
        """Return the program with each instruction changed."""
        return replace(self, instructions=tuple(map(change, self.instructions)))

    @property
    def neutral(self) -> bool:
        """Whether a predicate is neutral, so that a robustness of 0 may have no verdict."""
        return any(isinstance(i, Const) and i.neutral for i in self.instructions)

    def with_zero(self, zero: float) -> Program:
        """Return the program in which every neutral constant is this zero, which has a sign."""
        return self.changed(lambda i: Const(zero) if isinstance(i, Const) and i.neutral else i)

    def clamped(self, n: int) -> Program:
        """Return the program with bounds cut to n: equivalent on traces of n samples or less."""

        def cut(bound: int | None) -> int | None:
            return None if bound is None else max(-n, min(n, bound))

        return self.changed(
            lambda i: replace(i, lo=cut(i.lo), hi=cut(i.hi)) if isinstance(i, Window) else i
        )

    def mirrored(self) -> Program:
        """Return the program with time flipped, whose values on a reversed trace are reversed."""
        return self.changed(lambda i: i.mirrored() if isinstance(i, Window) else i)

    def __str__(self) -> str:
        """Return a listing, in columns: register, instruction, latency, source."""
        registers = [str(register) for register in range(len(self.instructions))]
        texts = [listed(instruction) for instruction in self.instructions]
        latencies = ["-" if late is None else str(late) for late in self.latencies]
        columns = (registers, texts, latencies)
        r, i, late = (max(map(len, column)) for column in columns)
        lines = [
            f"{register:>{r}}  {text:<{i}}  {latency:>{late}}  {source}"
            for register, text, latency, source in zip(*columns, self.sources, strict=True)
        ]
        names = {register: name for name, register in self.outputs.items()}
        lines.append(f"result {self.result}" + "".join(f", {n} = {r}" for r, n in names.items()))
        return "\n".join((*lines, *self.aligned))


def _renumbered(instruction: Instruction, new: Mapping[int, int]) -> Instruction:
    if isinstance(instruction, Load | Const):
        return instruction
    return replace(instruction, args=tuple(new[a] for a in instruction.args))


@dataclass(frozen=True, slots=True)
class Delay:
    """The operand, ``length`` samples late."""

    length: int
    operand: int


Scheduled = Map | Window | Delay


def schedule(program: Program) -> Iterator[tuple[int, Scheduled]]:
    """Yield the delay lines and instructions after the terms, with the slots that they write.

    The program's registers have the first slots, delay lines the next. A delay line comes before
    the first instruction that reads it.
    """
    slots: dict[tuple[int, int], int] = {}
    for register in range(program.terms, len(program.instructions)):
        instruction = program.formula(register)
        args = []
        for operand in instruction.args:
            length = program.delay(register, operand)
            slot = slots.get((operand, length), operand)
            if length and slot == operand:
                slot = slots[operand, length] = len(program.instructions) + len(slots)
                yield slot, Delay(length, operand)
            args.append(slot)
        yield register, replace(instruction, args=tuple(args))


def ranges_of(program: Program, variables: Sequence[Range]) -> list[Range]:
    """Return the ranges of a program's terms, up to the first term without a value."""
    ranges: list[Range] = []
    for instruction in program.instructions[: program.terms]:
        match instruction:
            case Load(variable):
                ranges.append(variables[program.variables.index(variable)])
            case Const(value):
                ranges.append(Range(value, value, known=True))
            case Map(name, args):
                row = FUNCTIONS[name]
                values = range_of(row.apply, row.rule, *(ranges[a] for a in args))
                if values is None:
                    break
                ranges.append(values)
            case Window():
                msg = "a window among the terms"
                raise AssertionError(msg)
    return ranges
