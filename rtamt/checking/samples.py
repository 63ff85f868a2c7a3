"""The terms of a program at the samples of a trace: unknown, or doubles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Protocol, cast

from rtamt.checking.graph import FALSE, TRUE, Graph, TermKey, Truth
from rtamt.program.algebra import FUNCTIONS
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.program import Program

__all__ = ["TermTruths", "function_of", "known_samples", "unknown_samples"]


class TermTruths(Protocol):
    """Tells whether a term that is read as a formula holds at a sample."""

    def __call__(self, program: Program, register: int, sample: int) -> Truth:
        """Whether the sign bit of the term is clear."""


def unknown_samples(graph: Graph) -> TermTruths:
    """TermTruths whose values are unknown: comparisons are atoms of a graph."""
    return _Unknown(graph)


class _Unknown:
    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._numbers: dict[tuple[Program, int, int], TermKey] = {}

    def __call__(self, program: Program, register: int, sample: int) -> Truth:
        instruction = program.term(register)
        if isinstance(instruction, Const):
            return TRUE if _clear(instruction.value) else FALSE
        function, args = cast("Map", instruction).function, cast("Map", instruction).args
        if function == "neg":
            return self._graph.no(self(program, args[0], sample))
        x, *others = (self._number(program, a, sample) for a in args)
        y = others[0] if others else ("const", 0.0)
        return self._compared(function, x, y)

    def _compared(self, function: str, x: TermKey, y: TermKey) -> Truth:
        graph = self._graph
        match function:
            case "at_least" | "ge" | "nonnegative":
                return graph.atom(("at_least", x, y))
            case "above" | "gt":
                return graph.no(graph.atom(("at_least", y, x)))
            case "equal" | "eq":
                return graph.atom(("equal", x, y))
            case "unequal" | "ne":
                return graph.no(graph.atom(("equal", x, y)))
        msg = f"{function} is read as a formula"
        raise AssertionError(msg)

    def _number(self, program: Program, register: int, sample: int) -> TermKey:
        key = program, register, sample
        if key not in self._numbers:
            match program.term(register):
                case Load(variable):
                    number: TermKey = ("load", variable, sample)
                case Const(value):
                    number = ("const", value)
                case Map(function, args):
                    number = (function, *(self._number(program, a, sample) for a in args))
            self._numbers[key] = number
        return self._numbers[key]


def known_samples(columns: Mapping[str, Sequence[float]]) -> TermTruths:
    """TermTruths whose values are known.

    Raises:
        ValueError: When it is asked for a term that is nan.
    """

    def value(program: Program, register: int, sample: int) -> float:
        match program.term(register):
            case Load(variable):
                return columns[variable][sample]
            case Const(found):
                return found
            case Map(function, args):
                found = FUNCTIONS[function].apply(*(value(program, a, sample) for a in args))
                if math.isnan(found):
                    msg = f"'{program.sources[register]}' is nan at sample {sample}"
                    raise ValueError(msg)
                return found

    def holds(program: Program, register: int, sample: int) -> Truth:
        return TRUE if _clear(value(program, register, sample)) else FALSE

    return holds


def function_of(name: str) -> Callable[..., float | Fraction]:
    """What a function of terms gives for doubles; ``"minus"`` is a difference that is not rounded.

    Example:
        >>> function_of("sub")(2.0**53, -1.0) == function_of("minus")(2.0**53, -1.0)
        False
    """
    return _minus if name == "minus" else FUNCTIONS[name].apply


def _minus(x: float, y: float) -> float | Fraction:
    return Fraction(x) - Fraction(y) if math.isfinite(x) and math.isfinite(y) else math.nan


def _clear(value: float) -> bool:
    return math.copysign(1.0, value) > 0
