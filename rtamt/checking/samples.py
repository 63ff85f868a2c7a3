"""The terms of a program at the samples of a trace: unknown, or doubles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Final, Protocol, cast

from rtamt.checking.graph import FALSE, TRUE, Graph, TermKey, Truth
from rtamt.program.algebra import FUNCTIONS
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.program import Program

__all__ = ["TermTruths", "exact_sides", "function_of", "known_samples", "unknown_samples"]


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
        x, y = exact_sides(x, y)
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


def exact_sides(x: TermKey, y: TermKey) -> tuple[TermKey, TermKey]:
    """Return two terms that compare as x and y do, for all doubles, with fewer operations.

    The difference of unequal doubles never rounds to 0, so its sign is that of the comparison. A
    product with a power of two is exact, except where it overflows or is close to 0.

    Example:
        >>> x, y = ("load", "x", 0), ("load", "y", 0)
        >>> exact_sides(("sub", x, y), ("const", 0.0))
        (('load', 'x', 0), ('load', 'y', 0))
        >>> exact_sides(("const", 1.0), ("mul", ("const", -2.0), x))
        (('load', 'x', 0), ('const', -0.5))
    """
    while True:
        turned = y[0] != "const"
        term, number = (y, x) if turned else (x, y)
        reduced = _reduced(term, cast("float", number[1])) if number[0] == "const" else None
        if reduced is None:
            return x, y
        term, other, flips = reduced
        x, y = (other, term) if turned != flips else (term, other)


def _reduced(term: TermKey, number: float) -> tuple[TermKey, TermKey, bool] | None:
    """Take one exact operation off a term that is compared with a number.

    Returns:
        The two sides, and whether they change places; None if no operation is exact.
    """
    function, *parts = term
    keys = [cast("TermKey", part) for part in parts] if function in _EXACT else []
    if function == "neg":
        return keys[0], ("const", -number), True
    if function in ("sub", "add") and number == 0.0:
        return keys[0], keys[1] if function == "sub" else ("neg", keys[1]), False
    if function == "mul" and keys[0][0] == "const":
        keys.reverse()
    if function not in ("mul", "div") or keys[1][0] != "const":
        return None
    value = cast("float", keys[1][1])
    if value == 0.0 or not (math.isfinite(value) and math.isfinite(number)):
        return None
    factor = Fraction(value) if function == "mul" else 1 / Fraction(value)
    quotient = Fraction(number) / factor
    if not _scales_exactly(factor, number) or not _is_double(quotient):
        return None
    return keys[0], ("const", float(quotient)), factor < 0


_EXACT: Final = frozenset({"neg", "sub", "add", "mul", "div"})


def _scales_exactly(factor: Fraction, number: float) -> bool:
    """Whether a product with a factor never rounds to the other side of a number."""
    least, greatest = sorted((abs(factor.numerator), factor.denominator))
    if least != 1 or greatest & (greatest - 1):
        return False  # no power of two
    # A product that is rounded because it is close to 0 is less than 2**-1022.
    return abs(factor) >= 1 or abs(number) >= 2.0**-1021


def _is_double(value: Fraction) -> bool:
    try:
        return Fraction(float(value)) == value
    except OverflowError:
        return False


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
