"""Truths about a trace of unknown samples: comparisons, conjunctions and negations."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Final, cast

from rtamt.program.algebra import FOLDS, FUNCTIONS
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.program import Program

Truth = int
"""0 is false, 1 is true, others are ``2 * node``; the last bit negates."""

TermKey = tuple[object, ...]
"""A term at a sample: ``("load", name, sample)``, ``("const", value)``, ``(function, *terms)``."""

Atom = tuple[str, TermKey, TermKey]
"""``("at_least", x, y)`` or ``("equal", x, y)``; all comparisons are built from these."""

FALSE: Final = 0
TRUE: Final = 1

TruthElement = tuple[Truth, ...]
"""The operands of a window at one time."""

TermTruths = Callable[[Program, int, int], Truth]
"""Returns whether the sign bit of a program's register is clear at a sample."""


class Graph:
    """Truths built from atoms by conjunction and negation; equal nodes are stored once.

    A node is None (false), an `Atom`, or the truths of a conjunction.
    """

    def __init__(self) -> None:
        self.nodes: list[Atom | tuple[Truth, ...] | None] = [None]
        self._known: dict[Atom | tuple[Truth, ...], Truth] = {}

    def atom(self, atom: Atom) -> Truth:
        """Return the truth of a comparison."""
        return self._truth(atom)

    @staticmethod
    def no(truth: Truth) -> Truth:
        """Return the negation."""
        return truth ^ 1

    def all(self, truths: Iterable[Truth]) -> Truth:
        """Return the conjunction."""
        parts = {*truths}
        parts.discard(TRUE)
        if FALSE in parts or any(part ^ 1 in parts for part in parts):
            return FALSE
        if len(parts) < 2:
            return parts.pop() if parts else TRUE
        return self._truth(tuple(sorted(parts)))

    def any(self, truths: Iterable[Truth]) -> Truth:
        """Return the disjunction."""
        return self.all(truth ^ 1 for truth in truths) ^ 1

    def fold(self, name: str) -> Callable[[TruthElement, TruthElement], TruthElement]:
        """Return a fold of `rtamt.program.algebra` on truths."""
        return FOLDS[name].made(lambda x, y: self.all([x, y]), lambda x, y: self.any([x, y]))

    def atom_at(self, node: int) -> Atom | None:
        """Return the atom of a node, or None if the node is not an atom."""
        content = self.nodes[node]
        return content if content and isinstance(content[0], str) else None

    def parts(self, node: int) -> tuple[Truth, ...]:
        """Return the truths of a conjunction; empty for other nodes."""
        content = self.nodes[node]
        return () if not content or isinstance(content[0], str) else content

    def reached(self, truths: Iterable[Truth]) -> list[int]:
        """Return all nodes that truths depend on; a node comes after its parts."""
        seen: set[int] = set()
        stack = [truth >> 1 for truth in truths]
        while stack:
            node = stack.pop()
            if node not in seen:
                seen.add(node)
                stack += [part >> 1 for part in self.parts(node)]
        return sorted(seen)  # a node is created after its parts

    def _truth(self, content: Atom | tuple[Truth, ...]) -> Truth:
        if content not in self._known:
            self._known[content] = 2 * len(self.nodes)
            self.nodes.append(content)
        return self._known[content]


def subterms(term: TermKey) -> Iterator[TermKey]:
    """Yield a term and all terms below it."""
    yield term
    if term[0] not in {"load", "const"}:
        for part in term[1:]:
            yield from subterms(cast("TermKey", part))


def term_value(term: TermKey, load: Callable[[str, int], float]) -> float | Fraction:
    """Return the value of a term; ``load`` returns the value of a variable at a sample."""
    function, *parts = term
    if function == "load":
        return load(*cast("tuple[str, int]", tuple(parts)))
    if function == "const":
        return cast("float", parts[0])
    operands = (term_value(cast("TermKey", part), load) for part in parts)
    return function_of(cast("str", function))(*operands)


def atom_value(atom: Atom, load: Callable[[str, int], float]) -> bool | None:
    """Return whether an atom holds; None if a term is nan."""
    x, y = term_value(atom[1], load), term_value(atom[2], load)
    if math.isnan(x) or math.isnan(y):
        return None
    return x >= y if atom[0] == "at_least" else x == y


class KnownTrace:
    """A trace that gives each truth of a graph a value: true, false or unknown.

    ``load`` returns the value of a variable at a sample.
    """

    def __init__(self, graph: Graph, load: Callable[[str, int], float]) -> None:
        self._graph, self._load = graph, load
        self._known: dict[int, bool | None] = {0: False}

    def fulfils(self, truths: Iterable[Truth]) -> bool:
        """Return whether all truths are certainly true on the trace."""
        return all(self._at(truth) is True for truth in truths)

    def _at(self, truth: Truth) -> bool | None:
        if truth >> 1 not in self._known:
            self._evaluate(truth >> 1)
        known = self._known[truth >> 1]
        return known if known is None or not truth & 1 else not known

    def _evaluate(self, node: int) -> None:
        stack = [node]  # depth first, without recursion
        while stack:
            atom, parts = self._graph.atom_at(stack[-1]), self._graph.parts(stack[-1])
            missing = [part >> 1 for part in parts if part >> 1 not in self._known]
            if missing:
                stack += missing
            elif atom is not None:
                self._known[stack.pop()] = atom_value(atom, self._load)
            else:
                values = [self._at(part) for part in parts]
                known = False if False in values else None if None in values else True
                self._known[stack.pop()] = known


def function_of(name: str) -> Callable[..., float | Fraction]:
    """Return the function of a term on doubles; ``"minus"`` is a difference without rounding."""
    return _minus if name == "minus" else FUNCTIONS[name].apply


def _minus(x: float, y: float) -> float | Fraction:
    return Fraction(x) - Fraction(y) if math.isfinite(x) and math.isfinite(y) else math.nan


def unknown_samples(graph: Graph) -> TermTruths:
    """Return terms of unknown samples; their comparisons are atoms of a graph."""

    @functools.cache
    def number(program: Program, register: int, sample: int) -> TermKey:
        match program.term(register):
            case Load(variable):
                return "load", variable, sample
            case Const(value):
                return "const", value
            case Map(function, args):
                return (function, *(number(program, a, sample) for a in args))

    def holds(program: Program, register: int, sample: int) -> Truth:
        instruction = program.term(register)
        if isinstance(instruction, Const):
            return TRUE if _is_clear(instruction.value) else FALSE
        function, args = cast("Map", instruction).function, cast("Map", instruction).args
        if function == "neg":
            return graph.no(holds(program, args[0], sample))
        x, *others = (number(program, a, sample) for a in args)
        return _comparison(graph, function, x, others[0] if others else ("const", 0.0))

    return holds


def _comparison(graph: Graph, function: str, x: TermKey, y: TermKey) -> Truth:
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
    msg = f"'{function}' is not a comparison"
    raise AssertionError(msg)


def known_samples(columns: Mapping[str, Sequence[float]]) -> TermTruths:
    """Return terms of known samples; a term that is nan raises ValueError."""

    def value(program: Program, register: int, sample: int) -> float:
        match program.term(register):
            case Load(variable):
                return columns[variable][sample]
            case Const(number):
                return number
            case Map(function, args):
                result = FUNCTIONS[function].apply(*(value(program, a, sample) for a in args))
                if math.isnan(result):
                    msg = f"'{program.sources[register]}' is nan at sample {sample}"
                    raise ValueError(msg)
                return result

    return lambda program, register, sample: int(_is_clear(value(program, register, sample)))


def _is_clear(value: float) -> bool:
    return math.copysign(1.0, value) > 0


def exact_sides(x: TermKey, y: TermKey) -> tuple[TermKey, TermKey]:
    """Return two terms that compare as x and y do, for all doubles, with fewer operations.

    The difference of unequal doubles never rounds to 0, so its sign is the sign of the comparison.
    A product with a power of two is exact, except where it overflows or is close to 0.

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
    """Return both sides of a comparison with a number without one exact operation of the term.

    The last value is whether the sides change places. None if no operation is exact.
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
    """Return whether a product with a factor never rounds to the other side of a number."""
    smaller, larger = sorted((abs(factor.numerator), factor.denominator))
    if smaller != 1 or larger & (larger - 1):
        return False  # not a power of two
    # A product that is rounded because it is close to 0 is less than 2**-1022.
    return abs(factor) >= 1 or abs(number) >= 2.0**-1021


def _is_double(value: Fraction) -> bool:
    try:
        return Fraction(float(value)) == value
    except OverflowError:
        return False
