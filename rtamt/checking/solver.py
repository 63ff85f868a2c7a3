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

__all__ = ["Solution", "Solver", "is_exact", "is_linear", "reached", "solver_library"]

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
            "a check or an example of a requirement needs z3, which is not installed; "
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
        part[0] in {"load", "const", "minus"}
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
    """Asks Z3 about the truths of a graph; what questions have in common is written once.

    Args:
        graph: The graph.
        whole: The variables that are whole numbers.
    """

    def __init__(self, graph: Graph, whole: Collection[str] = ()) -> None:
        self._graph = graph
        self._z3 = solver_library()
        # Which model is found depends on what else was asked in a context.
        self._context = self._z3.Context()
        calls = _Calls(self._z3, self._context)
        self._written = {wide: _Written(graph, calls, whole, wide=wide) for wide in (False, True)}

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
        written = self._written[wide]
        solver = z3.SimpleSolver(ctx=self._context)
        solver.set("timeout", max(1, int(1000 * left)))
        names = [z3.Bool(f"part{place}", self._context) for place in range(len(truths))]
        used = written.assert_in(solver, truths, names)
        answer = solver.check(*names)
        if answer == z3.sat:
            model = solver.model()
            loads = {}
            for key, number in used.loads.items():
                value = model.eval(number)
                if z3.is_rational_value(value) or z3.is_int_value(value):
                    loads[key] = _double(Fraction(value.as_string()))
            return Solution(possible=True, loads=loads, free=used.free)
        if answer == z3.unsat:
            core = {str(each) for each in solver.unsat_core()}
            places = tuple(i for i, name in enumerate(names) if str(name) in core)
            return Solution(possible=False, loads={}, core=places, free=used.free)
        return Solution(possible=None, loads={}, free=used.free)


class _Calls:
    """Makes expressions of Z3 by its C interface: its Python objects take ten times as long."""

    def __init__(self, z3: Any, own: Any) -> None:  # noqa: ANN401 - z3 has no types
        self._core, self._array = z3.z3core, z3.Ast
        self.z3, self.own, self.context = z3, own, own.ref()
        self.real, self.integer = z3.RealSort(own).ast, z3.IntSort(own).ast
        self.boolean = z3.BoolSort(own).ast
        self._numbers: dict[Fraction, Any] = {}

    def __call__(self, name: str, *args: Any) -> Any:  # noqa: ANN401
        """The expression that a function of the interface makes of some others."""
        return self._kept(getattr(self._core, f"Z3_mk_{name}")(self.context, *args))

    def many(self, name: str, parts: Sequence[Any]) -> Any:  # noqa: ANN401
        """The expression of a function that takes any number of others."""
        made = getattr(self._core, f"Z3_mk_{name}")
        return self._kept(made(self.context, len(parts), (self._array * len(parts))(*parts)))

    def constant(self, name: str, sort: Any) -> Any:  # noqa: ANN401
        """An unknown of some sort."""
        symbol = self._core.Z3_mk_string_symbol(self.context, name)
        return self._kept(self._core.Z3_mk_const(self.context, symbol, sort))

    def number(self, value: Fraction) -> Any:  # noqa: ANN401
        """A real number."""
        if value not in self._numbers:
            text = f"{value.numerator}/{value.denominator}"
            self._numbers[value] = self._kept(
                self._core.Z3_mk_numeral(self.context, text, self.real)
            )
        return self._numbers[value]

    def asserted(self, solver: Any, expression: Any) -> None:  # noqa: ANN401
        """Adds a truth to a solver."""
        self._core.Z3_solver_assert(self.context, solver.solver, expression)

    def _kept(self, expression: Any) -> Any:  # noqa: ANN401
        self._core.Z3_inc_ref(self.context, expression)
        return expression


@dataclass(frozen=True, slots=True)
class _Used:
    """What some truths depend on: values of variables, and functions of any result."""

    loads: Mapping[tuple[str, int], Any]
    free: frozenset[str]


@dataclass(slots=True)
class _Number:
    """A term as Z3 knows it.

    Attributes:
        written: Its expression.
        known: What is known of it, as expressions that are true.
        loads: The values of variables among its operands.
        free: The functions among it whose results are any number at all.
    """

    written: Any
    known: tuple[Any, ...] = ()
    loads: frozenset[tuple[str, int]] = frozenset()
    free: frozenset[str] = frozenset()


class _Written:
    """Truths as expressions of Z3, each made once."""

    def __init__(self, graph: Graph, calls: _Calls, whole: Collection[str], *, wide: bool) -> None:
        self._graph, self._call, self._whole, self._wide = graph, calls, whole, wide
        self._kind = "w" if wide else "x"
        self._truths: dict[int, Any] = {0: calls("false")}
        self._used: dict[int, tuple[_Number, _Number]] = {}
        self._numbers: dict[TermKey, _Number] = {}
        self._loads: dict[tuple[str, int], Any] = {}

    def assert_in(self, solver: Any, truths: Sequence[Truth], names: Sequence[Any]) -> _Used:  # noqa: ANN401
        """Asserts that names imply truths, and what is known of the numbers in them."""
        loads: set[tuple[str, int]] = set()
        free: set[str] = set()
        known: dict[int, Any] = {}
        for node in reached(self._graph, truths):
            if node not in self._truths:
                self._write(node)
            for number in self._used.get(node, ()):
                loads |= number.loads
                free |= number.free
                known |= {id(each): each for each in number.known}
        for each in known.values():
            self._call.asserted(solver, each)
        for truth, name in zip(truths, names, strict=True):
            self._call.asserted(solver, self._call("implies", name.ast, self._named(truth)))
        return _Used({key: self._loads[key] for key in loads}, frozenset(free))

    def _write(self, node: int) -> None:
        atom = _atom(self._graph, node)
        if atom is None:
            parts = cast("tuple[Truth, ...]", self._graph.nodes[node])
            self._truths[node] = self._call.many("and", [self._named(part) for part in parts])
            return
        x, y = self._number(atom[1]), self._number(atom[2])
        self._used[node] = x, y
        comparison = "ge" if atom[0] == "at_least" else "eq"
        self._truths[node] = self._call(comparison, x.written, y.written)

    def _named(self, truth: Truth) -> Any:  # noqa: ANN401
        made = self._truths[truth >> 1]
        return self._call("not", made) if truth & 1 else made

    def _number(self, number: TermKey) -> _Number:
        known = self._numbers.get(number)
        if known is None:
            known = self._numbers[number] = self._made(number)
        return known

    def _made(self, number: TermKey) -> _Number:
        call = self._call
        function, *parts = number
        if function == "load":
            key = cast("tuple[str, int]", tuple(parts))
            whole = key[0] in self._whole
            made = call.constant(f"{key[0]}@{key[1]}", call.integer if whole else call.real)
            self._loads[key] = call.z3.ArithRef(made, call.own)
            return _Number(call("int2real", made) if whole else made, loads=frozenset({key}))
        if function == "const":
            value = cast("float", parts[0])
            exact = Fraction(value) if math.isfinite(value) else _sign(value) * _INFINITE
            return _Number(call.number(exact))
        keys = [cast("TermKey", part) for part in parts]
        operands = [self._number(each) for each in keys]
        loads = frozenset[tuple[str, int]]().union(*(each.loads for each in operands))
        free = frozenset[str]().union(*(each.free for each in operands))
        known = tuple(each for operand in operands for each in operand.known)
        exact = self._applied(cast("str", function), operands, keys)
        if exact is None:
            made = call.constant(f"{self._kind}{len(self._numbers)}", call.real)
            return _Number(made, known, loads, free | {cast("str", function)})
        if not (self._wide and function in _ROUNDS):
            return _Number(exact, known, loads, free)
        made = call.constant(f"{self._kind}{len(self._numbers)}", call.real)
        return _Number(made, (*known, self._near(exact, made)), loads, free)

    def _near(self, exact: Any, made: Any) -> Any:  # noqa: ANN401
        """Whether a double is what they can make of an exact result."""
        call = self._call
        negative = call("lt", exact, call.number(Fraction(0)))
        size = call("ite", negative, call("unary_minus", exact), exact)
        share = call.many("mul", [size, call.number(_ROUNDING)])
        slack = call.many("add", [share, call.number(_SMALLEST)])
        above = call("le", call.many("sub", [made, exact]), slack)
        below = call("le", call.many("sub", [exact, made]), slack)
        near = call.many("and", [above, below])
        return call.many("or", [call("ge", size, call.number(_LARGEST)), near])

    def _applied(self, function: str, operands: Sequence[_Number], keys: Sequence[TermKey]) -> Any:  # noqa: ANN401
        """The result of a function; None if it is not linear."""
        call, x, y = self._call, operands[0].written, operands[-1].written
        if not _linear(function, keys):
            return None
        match function:
            case "neg":
                return call("unary_minus", x)
            case "abs":
                negative = call("lt", x, call.number(Fraction(0)))
                return call("ite", negative, call("unary_minus", x), x)
            case "min":
                return call("ite", call("le", x, y), x, y)
            case "max":
                return call("ite", call("le", x, y), y, x)
            case "add" | "mul":
                return call.many(function, [x, y])
            case "sub" | "minus":
                return call.many("sub", [x, y])
            case _:
                return call("div", x, y)


_ROUNDS: Final = frozenset({"add", "sub", "mul", "div"})
_LINEAR: Final = frozenset({"neg", "abs", "min", "max", "add", "sub", "minus"})


def is_linear(term: TermKey) -> bool:
    """Whether the solver knows all functions of a term."""
    function, *parts = term
    if function in {"load", "const"}:
        return True
    keys = [cast("TermKey", part) for part in parts]
    return _linear(cast("str", function), keys) and all(map(is_linear, keys))


def _linear(function: str, keys: Sequence[TermKey]) -> bool:
    """Whether the solver knows a function of some terms."""
    constant = [each[0] == "const" for each in keys]
    match function:
        case "mul":
            return any(constant)
        case "div":
            return constant[1] and keys[1][1] not in {0.0, math.inf, -math.inf}
    return function in _LINEAR


def _sign(value: float) -> int:
    return 1 if value > 0 else -1


def _double(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
