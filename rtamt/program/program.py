"""A compiled specification: a program of instructions with a latency for each register.

Each instruction writes the register of its index. The first `Program.terms` instructions are
arithmetic over the present sample; the others are formulas. At sample t, a register of latency L
has its value of time t - L; operands of a lower latency reach it through delay lines
(`Program.delay`). This is pastification (Nickovic and Yamaguchi, ATVA 2020) on numbers instead of
syntax trees.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, assert_never

from rtamt.errors import Argument, Message
from rtamt.language.node import Node
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import (
    Const,
    Instruction,
    Load,
    Map,
    Window,
    latencies_of,
    latency_of,
    listed,
    operands,
)
from rtamt.program.intervals import Range, range_of

if TYPE_CHECKING:
    from rtamt.language.specification import Specification


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Program:
    """A compiled specification.

    Attributes:
        instructions: Ordered so that every register is written before it is read.
        terms: The number of first instructions that are arithmetic over the present sample.
        latencies: The delay of each register in samples; None if it needs the whole future.
        result: Register of the robustness.
        outputs: Registers of the named formulas.
        variables: Names of the inputs, in the order of samples.
        sources: The node of each register, for errors and listings.
        specification: The specification that was compiled.
        aligned: The texts of `timing.alignment` for rounded intervals.
        rates: The rates of change among the variables, and the variable of each; readers of samples
            compute them (`rtamt.inputs.samples`).
        seconds: The time between samples, for rates.
    """

    instructions: tuple[Instruction, ...]
    terms: int
    latencies: tuple[int | None, ...]
    result: int
    outputs: Mapping[str, int]
    variables: tuple[str, ...]
    sources: tuple[Node, ...]
    specification: Specification
    aligned: tuple[str, ...] = ()
    rates: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 1.0

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
        instruction = self.instructions[register]
        if isinstance(instruction, Window):
            msg = f"register {register} is a window among the terms"
            raise AssertionError(msg)  # noqa: TRY004 - a bug of ours, not a type of the caller's
        return instruction

    def formula(self, register: int) -> Map | Window:
        """Return the instruction of a register after the terms."""
        instruction = self.instructions[register]
        if isinstance(instruction, Load | Const):
            msg = f"register {register} is an input after the terms"
            raise AssertionError(msg)  # noqa: TRY004 - a bug of ours, not a type of the caller's
        return instruction

    def window(self, register: int) -> Window:
        """Return the instruction of a register that is a window."""
        instruction = self.instructions[register]
        if not isinstance(instruction, Window):
            msg = f"register {register} is not a window"
            raise AssertionError(msg)  # noqa: TRY004 - a bug of ours, not a type of the caller's
        return instruction

    def delay(self, register: int, operand: int) -> int:
        """Return the number of samples by which a register delays an operand."""
        instruction = self.instructions[register]
        if isinstance(self.instructions[operand], Const):
            return 0
        read = self.latencies[register]
        if isinstance(instruction, Window):
            read = self.start(register)
        late = self.latencies[operand]
        if read is None or late is None:
            msg = f"register {register} needs the whole future"
            raise AssertionError(msg)
        return read - late

    def start(self, register: int) -> int:
        """Return the first sample at which a window reads its operands."""
        instruction, late = self.instructions[register], self.latencies[register]
        if not isinstance(instruction, Window) or instruction.hi is None or late is None:
            msg = f"register {register} is not a bounded window"
            raise AssertionError(msg)
        return late - instruction.hi

    def verify(self) -> None:
        """Check that the program is well formed."""
        count = len(self.instructions)
        for register, instruction in enumerate(self.instructions):
            self._check(register, instruction)
        for register in (self.result, *self.outputs.values()):
            self._require(0 <= register < count, register, "is not in the program")
        distinct = len(set(self.instructions[self.terms :]))
        self._require(distinct == count - self.terms, self.terms, "or a later one repeats another")

    def _check(self, register: int, instruction: Instruction) -> None:
        args = operands(instruction)
        self._require(
            all(0 <= a < register for a in args), register, "reads a register that is not written"
        )
        match instruction:
            case Load() | Const():
                self._require(register < self.terms, register, "is an input after the terms")
                known = isinstance(instruction, Const) or instruction.variable in self.variables
                self._require(known, register, "loads an unknown variable")
            case Map(function):
                self._require(FUNCTIONS[function].arity == len(args), register, "has wrong arity")
                if register < self.terms:
                    self._require(all(a < self.terms for a in args), register, "reads a formula")
            case Window(fold, lo, hi):
                self._require(register >= self.terms, register, "is a window among the terms")
                self._require(FOLDS[fold].width == len(args), register, "has wrong arity")
                past = hi is not None and hi <= 0
                future = lo is not None and lo >= 0
                self._require(past or future, register, "looks both ways")
                self._require(lo is None or hi is None or lo <= hi, register, "is empty")
            case _ as never:
                assert_never(never)
        late = latency_of(instruction, self.latencies, self.instructions)
        self._require(self.latencies[register] == late, register, f"has not latency {late}")

    @staticmethod
    def _require(condition: bool, register: int, what: str) -> None:  # noqa: FBT001
        if not condition:
            msg = f"register {register} {what}"
            raise AssertionError(msg)

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
        program = self.rewritten(
            instructions, sources=tuple(sources), result=result, outputs=outputs
        )
        return program.pruned()

    def _is_running(self, formula: Node) -> bool:
        """Return whether a formula is ``always p`` or ``eventually p`` without bounds.

        The instruction does not show it: ``eventually[0:0](eventually p)`` compiles to the same
        one.
        """
        op, (begin, end) = formula.op, self.specification.bounds(formula.interval)
        single = op is not None and op.future and len(formula.args) == 1
        return single and begin == 0 and end is None

    def pruned(self) -> Program:
        """Return the program without registers that neither the result nor an output needs."""
        return self.restricted(self.result, self.outputs)

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
                case _:
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
            latencies=tuple(self.latencies[r] for r in order),
            result=new[self.result],
            outputs={name: new[register] for name, register in self.outputs.items()},
            sources=tuple(self.sources[r] for r in order),
        )

    def rewritten(self, instructions: Iterable[Instruction], **changes: Any) -> Program:  # noqa: ANN401 - fields
        """Return the program with other instructions, and other fields."""
        written = tuple(instructions)
        return replace(self, instructions=written, latencies=latencies_of(written), **changes)

    @property
    def neutral(self) -> bool:
        """Whether a predicate is neutral, so that a robustness of 0 may have no verdict."""
        return any(isinstance(i, Const) and i.neutral for i in self.instructions)

    def with_zero(self, zero: float) -> Program:
        """Return the program in which every neutral constant is this zero, which has a sign."""
        return self.rewritten(
            Const(zero) if isinstance(i, Const) and i.neutral else i for i in self.instructions
        )

    def clamped(self, n: int) -> Program:
        """Return the program with bounds cut to n: equivalent on traces of n samples or less."""

        def cut(bound: int | None) -> int | None:
            return None if bound is None else max(-n, min(n, bound))

        return self.rewritten(
            replace(i, lo=cut(i.lo), hi=cut(i.hi)) if isinstance(i, Window) else i
            for i in self.instructions
        )

    def mirrored(self) -> Program:
        """Return the program with time flipped, whose values on a reversed trace are reversed."""
        return self.rewritten(
            i.mirrored() if isinstance(i, Window) else i for i in self.instructions
        )

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
    match instruction:
        case Load() | Const():
            return instruction
        case Map() | Window():
            return replace(instruction, args=tuple(new[a] for a in instruction.args))
        case _ as never:
            assert_never(never)


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
    return ranges
