"""Whether truths of a `Graph` can be true together, asked of Z3.

Numbers are reals there, a model of doubles. Two readings of arithmetic differ in what they may get
wrong. Read exactly, nothing is rounded: what is found is tried on doubles. Read widely, a result
may be off by a rounding, and is anything once it overflows, so that whatever doubles can do, it can
do: what is not found there, there is not. In both the result of a function that is not linear is
any number, the same one for the same operands.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final, cast

from rtamt.checking.graph import FALSE, Atom, Graph, TermKey, Truth

__all__ = ["Solution", "Solver", "is_exact", "solver_library"]

_INFINITE: Final = Fraction(2) ** 1024
_LARGEST: Final = Fraction(2) ** 1023
_ROUNDING: Final = Fraction(1, 2**53)
_SMALLEST: Final = Fraction(1, 2**1074)


def solver_library() -> Any:  # noqa: ANN401 - z3 has no types
    """The module of Z3.

    Raises:
        ModuleNotFoundError: If it is not installed; names the extra.
    """
    try:
        return importlib.import_module("z3")
    except ModuleNotFoundError as error:
        msg = (
            "rtamt.check needs z3, which is not installed; "
            "from the checkout: pip install '.[check]'"
        )
        raise ModuleNotFoundError(msg, name="z3") from error


@dataclass(frozen=True, slots=True)
class Solution:
    """What the solver has answered.

    Attributes:
        possible: Whether the truths can be true together; None: it does not know.
        loads: If they can, values of variables, by variable and sample.
        core: If they cannot, which of them cannot, by place.
        free: The functions whose results were any number at all.
    """

    possible: bool | None
    loads: Mapping[tuple[str, int], float]
    core: tuple[int, ...] = ()
    free: frozenset[str] = frozenset()


def is_exact(graph: Graph, truths: Sequence[Truth]) -> bool:
    """Whether the truths compare samples and constants alone, where doubles are as reals are."""
    return all(
        part[0] in {"load", "const"}
        for node in reached(graph, truths)
        if (atom := _atom(graph, node)) is not None
        for part in atom[1:]
    )


def reached(graph: Graph, truths: Sequence[Truth]) -> list[int]:
    """The nodes on which truths depend, each after those on which it depends."""
    seen: set[int] = set()
    stack = [truth >> 1 for truth in truths]
    while stack:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            if _atom(graph, node) is None:
                stack += [part >> 1 for part in cast("tuple[Truth, ...]", graph.nodes[node] or ())]
    return sorted(seen)  # a node is made after its parts


def _atom(graph: Graph, node: int) -> Atom | None:
    found = graph.nodes[node]
    return found if found and isinstance(found[0], str) else None


class Solver:
    """Asks Z3 about the truths of a graph.

    Args:
        graph: The graph.
        whole: The variables that are whole numbers.
    """

    def __init__(self, graph: Graph, whole: Collection[str] = ()) -> None:
        self._graph, self._whole = graph, whole
        self._z3 = solver_library()

    def solve(self, truths: Sequence[Truth], deadline: float, *, wide: bool) -> Solution:
        """Whether truths can be true together.

        Args:
            truths: The truths.
            deadline: When to give up, as `time.monotonic` tells the time.
            wide: How arithmetic is read.
        """
        for place, truth in enumerate(truths):
            if truth == FALSE:
                return Solution(possible=False, loads={}, core=(place,))
        z3 = self._z3
        left = deadline - time.monotonic()
        if left <= 0:
            return Solution(possible=None, loads={})
        written = _Written(self._graph, truths, self._whole, wide=wide)
        solver = z3.Solver()
        solver.set("timeout", max(1, int(1000 * left)))
        solver.from_string(written.text)  # much faster than the same from objects of Python
        names = [z3.Bool(f"part{place}") for place in range(len(truths))]
        answer = solver.check(*names)
        free = frozenset(written.free)
        if answer == z3.sat:
            model = solver.model()
            loads = {}
            for key, name in written.loads.items():
                number = z3.Int(name) if key[0] in self._whole else z3.Real(name)
                value = model.eval(number)
                if z3.is_rational_value(value) or z3.is_int_value(value):
                    loads[key] = _double(Fraction(value.as_string()))
            return Solution(possible=True, loads=loads, free=free)
        if answer == z3.unsat:
            core = {str(each) for each in solver.unsat_core()}
            places = tuple(i for i, name in enumerate(names) if str(name) in core)
            return Solution(possible=False, loads={}, core=places, free=free)
        return Solution(possible=None, loads={}, free=free)


class _Written:
    """Truths in the language of solvers, SMT-LIB 2; each is implied by a constant ``partN``.

    Attributes:
        text: The text.
        loads: The names of values of variables.
        free: The functions whose results are any number at all.
    """

    def __init__(
        self, graph: Graph, truths: Sequence[Truth], whole: Collection[str], *, wide: bool
    ) -> None:
        self._whole, self._wide = whole, wide
        self.loads: dict[tuple[str, int], str] = {}
        self.free: set[str] = set()
        self._lines = ["(define-fun n0 () Bool false)"]
        self._numbers: dict[TermKey, str] = {}
        for node in reached(graph, truths):
            if node == 0:
                continue
            atom = _atom(graph, node)
            if atom is not None:
                x, y = self._number(atom[1]), self._number(atom[2])
                made = f"({'>=' if atom[0] == 'at_least' else '='} {x} {y})"
            else:
                parts = cast("tuple[Truth, ...]", graph.nodes[node])
                made = f"(and {' '.join(map(_named, parts))})"
            self._lines.append(f"(define-fun n{node} () Bool {made})")
        for place, truth in enumerate(truths):
            self._lines.append(f"(declare-const part{place} Bool)")
            self._lines.append(f"(assert (=> part{place} {_named(truth)}))")
        self.text = "\n".join(self._lines)

    def _number(self, number: TermKey) -> str:
        known = self._numbers.get(number)
        if known is None:
            known = self._numbers[number] = self._made(number)
        return known

    def _made(self, number: TermKey) -> str:
        function, *parts = number
        if function == "load":
            variable, sample = cast("tuple[str, int]", tuple(parts))
            whole = variable in self._whole
            name = self.loads[variable, sample] = f"v{len(self.loads)}"
            self._lines.append(f"(declare-const {name} {'Int' if whole else 'Real'})")
            return f"(to_real {name})" if whole else name
        if function == "const":
            value = cast("float", parts[0])
            return _written(Fraction(value) if math.isfinite(value) else _sign(value) * _INFINITE)
        operands = [cast("TermKey", part) for part in parts]
        x, y = (self._number(each) for each in (operands[0], operands[-1]))
        exact = _applied(cast("str", function), x, y, operands)
        if exact is None:
            self.free.add(cast("str", function))
            return self._declared()
        return self._rounded(exact) if self._wide and function in _ROUNDS else self._defined(exact)

    def _declared(self) -> str:
        name = f"r{len(self._lines)}"
        self._lines.append(f"(declare-const {name} Real)")
        return name

    def _defined(self, number: str) -> str:
        name = f"r{len(self._lines)}"
        self._lines.append(f"(define-fun {name} () Real {number})")
        return name

    def _rounded(self, number: str) -> str:
        """What doubles can make of an exact result."""
        exact, made = self._defined(number), self._declared()
        size = self._defined(f"(ite (< {exact} 0.0) (- {exact}) {exact})")
        slack = self._defined(f"(+ (* {size} {_written(_ROUNDING)}) {_written(_SMALLEST)})")
        near = f"(and (<= (- {made} {exact}) {slack}) (<= (- {exact} {made}) {slack}))"
        self._lines.append(f"(assert (or (>= {size} {_written(_LARGEST)}) {near}))")
        return made


def _applied(function: str, x: str, y: str, operands: Sequence[TermKey]) -> str | None:
    """The result of a function; None if it is not linear."""
    constant = [each[0] == "const" for each in operands]
    match function:
        case "neg":
            return f"(- {x})"
        case "abs":
            return f"(ite (< {x} 0.0) (- {x}) {x})"
        case "min":
            return f"(ite (<= {x} {y}) {x} {y})"
        case "max":
            return f"(ite (<= {x} {y}) {y} {x})"
        case "add" | "sub":
            return f"({'+' if function == 'add' else '-'} {x} {y})"
        case "mul" if any(constant):
            return f"(* {x} {y})"
        case "div" if constant[1] and operands[1][1] not in {0.0, math.inf, -math.inf}:
            return f"(/ {x} {y})"
    return None


_ROUNDS: Final = frozenset({"add", "sub", "mul", "div"})


def _named(truth: Truth) -> str:
    return f"(not n{truth >> 1})" if truth & 1 else f"n{truth >> 1}"


def _written(number: Fraction) -> str:
    text = f"{abs(number.numerator)}.0"
    if number.denominator != 1:
        text = f"(/ {text} {number.denominator}.0)"
    return f"(- {text})" if number < 0 else text


def _sign(value: float) -> int:
    return 1 if value > 0 else -1


def _double(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
