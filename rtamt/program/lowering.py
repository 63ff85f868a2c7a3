"""Compiles a specification: every node once, by the meaning in its operator's row."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, Concatenate, ParamSpec, TypeVar, assert_never, cast

from rtamt.language.formula import Term
from rtamt.language.interval import applied
from rtamt.language.node import Node
from rtamt.language.operators import Bounds, Meaning
from rtamt.language.specification import Specification
from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import (
    Const,
    Instruction,
    Load,
    Map,
    Window,
    latency_of,
    listed,
)
from rtamt.program.interface import STANDARD, Interface
from rtamt.program.program import Program
from rtamt.program.timing import Align, alignment, samples

_P = ParamSpec("_P")
_R = TypeVar("_R")


class ProgramBuilder:
    """Writes the instructions of a specification; equal ones share a register."""

    def __init__(
        self,
        specification: Specification,
        period: Fraction | None,
        interface: Interface,
        align: Align | None = None,
    ) -> None:
        self.specification = specification
        self.period = period
        self.align = align
        self.aligned: dict[str, None] = {}  # in the order of the nodes, each once
        self.interface = interface
        self.instructions: list[Instruction] = []
        self.latencies: list[int | None] = []
        self.sources: list[Node] = []
        self.is_term: list[bool] = []
        self.registers: dict[tuple[Instruction, bool, str], int] = {}
        self.rates: dict[str, str] = {}
        self.node: Node
        self.term = False

    def program(self) -> Program:
        """Return the program of the whole specification."""
        specification = self.specification
        known: dict[Node, int] = {}
        for node in specification.nodes():
            known[node] = self.lower(node, known)
        raw = Program(
            instructions=tuple(self.instructions),
            terms=sum(self.is_term),
            result=known[specification.formula],
            outputs={name: known[f] for name, f in specification.formulas.items()},
            variables=(*specification.variables, *self.rates),
            sources=tuple(self.sources),
            specification=specification,
            aligned=tuple(self.aligned),
            rates=self.rates,
            seconds=1.0 if self.period is None else float(self.period),
        )
        needed = sorted(raw.needed(raw.result, *raw.outputs.values()))
        needed.sort(key=lambda register: not self.is_term[register])
        return raw.reordered(needed, sum(self.is_term[register] for register in needed))

    def lower(self, node: Node, known: Mapping[Node, int]) -> int:
        """Write one node; its operands are already written."""
        self.node = node
        self.term = isinstance(node, Term) or (node.op is not None and node.op.operands == "term")
        if node.op is None:
            if isinstance(node.leaf, str):
                return self.emit(Load(node.leaf), term=True)
            return self.constant(cast("float", node.leaf))
        args = [known[a] for a in node.args]
        if node.op.timed:
            return node.op.meaning(self, self.bounds(node), *args)
        if node.op.holds is not None:
            return self._predicate(node, node.op.meaning, node.op.holds, args)
        return node.op.meaning(self, *args)

    def bounds(self, node: Node) -> Bounds:
        """Return the bounds of an operator's interval, in samples."""
        error = functools.partial(self.specification.error, node)
        unit = self.specification.unit
        bounds = samples(node.interval, self.period, unit, error, self.align)
        if self.align is not None:
            became = alignment(node.interval, self.period, unit, bounds)
            self.aligned.update({} if became is None else {became: None})
        return bounds

    def _predicate(self, node: Node, value: Meaning, sign: Meaning, args: Sequence[int]) -> int:
        match self.interface.reading(node):
            case "value":
                return value(self, *args)
            case "sign":
                return sign(self, *args)
            case "zero":
                return self.emit(Const(0.0, neutral=True), term=True)
            case _ as never:
                assert_never(never)

    def emit(self, instruction: Instruction, *, term: bool = False) -> int:
        """Return the register of an instruction."""
        # A term and a formula of the same shape have registers of their own: at an unseen sample
        # a term is unknown as a whole, a formula operand by operand. The text
        # distinguishes 0.0 from -0.0.
        key = (instruction, term, listed(instruction))
        register = self.registers.get(key)
        if register is None:
            register = self.registers[key] = len(self.instructions)
            self.latencies.append(latency_of(instruction, self.latencies, self.instructions))
            self.instructions.append(instruction)
            self.sources.append(self.node)
            self.is_term.append(term)
        return register

    def constant(self, value: float) -> int:
        """Return the same value at every sample, seen or not."""
        return self.emit(Const(value), term=True)

    def map(self, function: str, *args: int) -> int:
        """Return the function of the operands' values now; a constant if all operands are.

        A neutral constant has two values, so it is not folded.
        """
        self._require(len(args) == FUNCTIONS[function].arity, f"{function} has wrong arity")
        operands = [self.instructions[a] for a in args]
        values = [i.value for i in operands if isinstance(i, Const) and not i.neutral]
        if len(values) == len(args):
            value = applied(function, FUNCTIONS[function].apply, *values)
            if value != value:  # noqa: PLR0124 - nan
                raise self.specification.error(self.node, f"{self.node} is not a number")
            return self.constant(value)
        return self.emit(Map(function, args), term=self.term)

    def rate(self, x: int) -> int:
        """Return the rate of change of a variable, which readers of samples compute."""
        loaded = self.instructions[x]
        if not isinstance(loaded, Load):
            msg = f"register {x} is not a variable"
            raise AssertionError(msg)  # noqa: TRY004 - a bug of ours, not a type of the caller's
        name = f"rate({loaded.variable})"
        self.rates[name] = loaded.variable
        return self.emit(Load(name), term=True)

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        """Return the fold over offsets lo to hi; if both are 0, the last operand itself."""
        if fold not in FOLDS:
            msg = (
                f"'{fold}' is not a lattice fold: expected {', '.join(FOLDS)}; for others see "
                "the laws in rtamt/program/algebra.py"
            )
            raise AssertionError(msg)
        self._require(len(args) == FOLDS[fold].width, f"{fold} has wrong arity")
        if lo == hi == 0:
            return args[-1]
        one_side = (hi is not None and hi <= 0) or (lo is not None and lo >= 0)
        self._require(one_side, f"the window of {fold} looks both ways")
        self._require(lo is None or hi is None or lo <= hi, f"the window of {fold} is empty")
        return self.emit(Window(fold, lo, hi, args))

    def _require(self, condition: bool, problem: str) -> None:  # noqa: FBT001
        """Check what a row of operators has written."""
        if not condition:
            msg = f"{problem} in the meaning of {self.node}"
            raise AssertionError(msg)

    def _guard(self, begin: int, p: int, *, endless: bool) -> int:
        """Return the condition before the window of ``until``."""
        if begin == 1 and not endless:
            return p
        return self.emit(Window("min", 0, begin - 1, (p,), guard=True, endless=endless))

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        """Since: the fold up to the start of the interval, and p from there to now."""
        begin, end = bounds
        fold = self.window("since", None if end is None else -end, -begin, p, q)
        if begin == 0:
            return fold
        return self.map("min", self.window("min", 1 - begin, 0, p), fold)

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        """Until: p from now to the start of the interval, and the fold from there."""
        begin, end = bounds
        late_p, late_q = self.latencies[p], self.latencies[q]
        if begin == end:
            fold = self.window("max", begin, begin, q)
        elif end is None or late_p is None or late_q is None or late_p <= late_q:
            fold = self.window("until", begin, end, p, q)
        else:
            # p is needed only up to the sample before the witness, so it may come one sample
            # later than q: pair q with the sample of p before it.
            held = self.window("min", -1, -1, p)
            later = self.window("until", begin + 1, end, held, self.map("min", held, q))
            fold = self.map("max", self.window("max", begin, begin, q), later)
        if begin == 0:
            return fold
        return self.map("min", self._guard(begin, p, endless=end is None), fold)


def cached_by_text(
    compiler: Callable[Concatenate[Specification, _P], _R],
) -> Callable[Concatenate[Specification, _P], _R]:
    """Cache programs: equal specifications may differ in their text, and errors point at it."""
    build: Callable[..., _R] = compiler

    def compile_text(text: str, spec: Specification, **options: Any) -> _R:  # noqa: ANN401, ARG001 - the text is a key of the cache
        return build(spec, **options)

    cached: Callable[..., _R] = functools.lru_cache(maxsize=512)(compile_text)
    parameters = [*inspect.signature(compiler).parameters.values()][1:]
    names = [parameter.name for parameter in parameters]
    defaults = {parameter.name: parameter.default for parameter in parameters}

    @functools.wraps(compiler)
    def compiled(spec: Specification, /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        # One key of the cache for each way to write a call.
        options = {**defaults, **kwargs}
        options.update(zip(names, args, strict=False))
        return cached(spec.text, spec, **options)

    return compiled


@cached_by_text
def compile_program(
    specification: Specification,
    period: Fraction | None = None,
    *,
    interface: Interface = STANDARD,
    align: Align | None = None,
    online: bool = False,
) -> Program:
    """Return the program of a specification over samples."""
    if online:
        return compile_program(specification, period, interface=interface, align=align).online()
    return ProgramBuilder(specification, period, interface, align).program()


def refuse_rates(specification: Specification, reader: str) -> None:
    """Check that a specification reads no rate of change."""
    for node in specification.nodes():
        if node.op is not None and node.op.name == "rate":
            raise specification.error(
                node,
                f"{reader} does not support '{node}'",
                "declare the rate as a variable, and give its values",
            )
