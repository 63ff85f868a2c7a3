"""The questions to Z3: can truths of a `Graph` be true together?

Z3 computes with reals, and two models connect them to doubles. The exact model does not round, so a
solution must be tried on doubles. In the wide model, a result may be off by a rounding error, and
is any number after an overflow. The wide model allows everything that doubles can do: without a
solution in it, doubles have no solution. In both models, a nonlinear function returns any number,
the same for the same operands. `PointChoices` offers values for these functions.
"""

from __future__ import annotations

import importlib
import itertools
import math
import random
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final, cast

from rtamt.checking.graph import FALSE, Atom, Graph, TermKey, Truth, atom_value, subterms

_INFINITE: Final = Fraction(2) ** 1024
_LARGEST: Final = Fraction(2) ** 1023
_ROUNDING: Final = Fraction(1, 2**53)
_SMALLEST: Final = Fraction(1, 2**1074)


def solver_library() -> Any:  # noqa: ANN401 - z3 has no types
    """Return the module of Z3; the error without it names the extra."""
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
    """The answer of the solver; ``possible`` is None if it is unknown.

    ``core`` has the places of truths that clash, ``free`` the functions that count as any number.
    """

    possible: bool | None
    loads: Mapping[tuple[str, int], float]
    core: tuple[int, ...] = ()
    free: frozenset[str] = frozenset()


def is_exact(graph: Graph, truths: Sequence[Truth]) -> bool:
    """Return whether truths compare only samples and constants, so that doubles act as reals."""
    return all(
        part[0] in {"load", "const", "minus"}
        for node in graph.reached(truths)
        if (atom := graph.atom_at(node)) is not None
        for part in atom[1:]
    )


class Solver:
    """Asks Z3 about the truths of a graph; the common parts of questions are built once."""

    def __init__(self, graph: Graph, integers: Collection[str]) -> None:
        self._z3 = solver_library()
        # The model that Z3 returns depends on the earlier questions of a context.
        self._context = self._z3.Context()
        calls = _Calls(self._z3, self._context)
        self._models = {
            wide: _Expressions(graph, calls, integers, wide=wide) for wide in (False, True)
        }

    def solve(self, truths: Sequence[Truth], deadline: float, *, wide: bool) -> Solution:
        """Return whether truths can be true together; ``wide`` selects the wide arithmetic."""
        for index, truth in enumerate(truths):
            if truth == FALSE:
                return Solution(possible=False, loads={}, core=(index,))
        z3 = self._z3
        left = deadline - time.monotonic()
        if left <= 0:
            return Solution(possible=None, loads={})
        solver = z3.SimpleSolver(ctx=self._context)
        solver.set("timeout", max(1, int(1000 * left)))
        names = [z3.Bool(f"part{index}", self._context) for index in range(len(truths))]
        variables, free = self._models[wide].add_to(solver, truths, names)
        answer = solver.check(*names)
        if answer == z3.sat:
            model = solver.model()
            loads = {}
            for key, number in variables.items():
                value = model.eval(number)
                if z3.is_rational_value(value) or z3.is_int_value(value):
                    loads[key] = _double(Fraction(value.as_string()))
            return Solution(possible=True, loads=loads, free=free)
        if answer == z3.unsat:
            core = {str(part) for part in solver.unsat_core()}
            places = tuple(i for i, name in enumerate(names) if str(name) in core)
            return Solution(possible=False, loads={}, core=places, free=free)
        return Solution(possible=None, loads={}, free=free)


class _Calls:
    """Builds expressions with the C interface of Z3, ten times faster than its Python objects."""

    def __init__(self, z3: Any, own: Any) -> None:  # noqa: ANN401 - z3 has no types
        self._core, self._array = z3.z3core, z3.Ast
        self.z3, self.own, self.context = z3, own, own.ref()
        self.real, self.integer = z3.RealSort(own).ast, z3.IntSort(own).ast
        self._numbers: dict[Fraction, Any] = {}

    def __call__(self, name: str, *args: Any) -> Any:  # noqa: ANN401
        """Return the expression of a function with a fixed number of operands."""
        return self._referenced(getattr(self._core, f"Z3_mk_{name}")(self.context, *args))

    def many(self, name: str, parts: Sequence[Any]) -> Any:  # noqa: ANN401
        """Return the expression of a function with any number of operands."""
        function = getattr(self._core, f"Z3_mk_{name}")
        return self._referenced(
            function(self.context, len(parts), (self._array * len(parts))(*parts))
        )

    def constant(self, name: str, sort: Any) -> Any:  # noqa: ANN401
        """Return an unknown of a sort."""
        symbol = self._core.Z3_mk_string_symbol(self.context, name)
        return self._referenced(self._core.Z3_mk_const(self.context, symbol, sort))

    def number(self, value: Fraction) -> Any:  # noqa: ANN401
        """Return a real number."""
        if value not in self._numbers:
            text = f"{value.numerator}/{value.denominator}"
            self._numbers[value] = self._referenced(
                self._core.Z3_mk_numeral(self.context, text, self.real)
            )
        return self._numbers[value]

    def add(self, solver: Any, expression: Any) -> None:  # noqa: ANN401
        """Assert an expression in a solver."""
        self._core.Z3_solver_assert(self.context, solver.solver, expression)

    def _referenced(self, expression: Any) -> Any:  # noqa: ANN401
        self._core.Z3_inc_ref(self.context, expression)
        return expression


@dataclass(slots=True)
class _Number:
    """A term in Z3.

    Attributes:
        expression: Its expression.
        known: True expressions about the term.
        loads: The values of variables among its operands.
        free: The functions in it that the solver treats as any number.
    """

    expression: Any
    known: tuple[Any, ...] = ()
    loads: frozenset[tuple[str, int]] = frozenset()
    free: frozenset[str] = frozenset()


class _Expressions:
    """Truths as expressions of Z3, each built once."""

    def __init__(
        self, graph: Graph, calls: _Calls, integers: Collection[str], *, wide: bool
    ) -> None:
        self._graph, self._call, self._integers, self._wide = graph, calls, integers, wide
        self._kind = "w" if wide else "x"
        self._truths: dict[int, Any] = {0: calls("false")}
        self._sides: dict[int, tuple[_Number, _Number]] = {}
        self._numbers: dict[TermKey, _Number] = {}
        self._loads: dict[tuple[str, int], Any] = {}

    def add_to(
        self,
        solver: Any,  # noqa: ANN401
        truths: Sequence[Truth],
        names: Sequence[Any],
    ) -> tuple[Mapping[tuple[str, int], Any], frozenset[str]]:
        """Assert that names imply truths; return the variables and the free functions in them."""
        loads: set[tuple[str, int]] = set()
        free: set[str] = set()
        known: dict[int, Any] = {}
        for node in self._graph.reached(truths):
            if node not in self._truths:
                self._build(node)
            for number in self._sides.get(node, ()):
                loads |= number.loads
                free |= number.free
                known |= {id(expression): expression for expression in number.known}
        for expression in known.values():
            self._call.add(solver, expression)
        for truth, name in zip(truths, names, strict=True):
            self._call.add(solver, self._call("implies", name.ast, self._expression(truth)))
        # Sorted, because the order of reads from a model changes later models.
        return {key: self._loads[key] for key in sorted(loads)}, frozenset(free)

    def _build(self, node: int) -> None:
        atom = self._graph.atom_at(node)
        if atom is None:
            parts = [self._expression(part) for part in self._graph.parts(node)]
            self._truths[node] = self._call.many("and", parts)
            return
        x, y = self._number(atom[1]), self._number(atom[2])
        self._sides[node] = x, y
        comparison = "ge" if atom[0] == "at_least" else "eq"
        self._truths[node] = self._call(comparison, x.expression, y.expression)

    def _expression(self, truth: Truth) -> Any:  # noqa: ANN401
        expression = self._truths[truth >> 1]
        return self._call("not", expression) if truth & 1 else expression

    def _number(self, term: TermKey) -> _Number:
        if term not in self._numbers:
            self._numbers[term] = self._new_number(term)
        return self._numbers[term]

    def _new_number(self, term: TermKey) -> _Number:
        call = self._call
        function, *parts = term
        if function == "load":
            key = cast("tuple[str, int]", tuple(parts))
            integer = key[0] in self._integers
            unknown = call.constant(f"{key[0]}@{key[1]}", call.integer if integer else call.real)
            self._loads[key] = call.z3.ArithRef(unknown, call.own)
            loads = frozenset({key})
            return _Number(call("int2real", unknown) if integer else unknown, loads=loads)
        if function == "const":
            value = cast("float", parts[0])
            sign = 1 if value > 0 else -1
            return _Number(
                call.number(Fraction(value) if math.isfinite(value) else sign * _INFINITE)
            )
        keys = [cast("TermKey", part) for part in parts]
        operands = [self._number(key) for key in keys]
        loads = frozenset[tuple[str, int]]().union(*(x.loads for x in operands))
        free = frozenset[str]().union(*(x.free for x in operands))
        known = tuple(expression for x in operands for expression in x.known)
        exact = self._applied(cast("str", function), operands, keys)
        if exact is None:
            unknown = call.constant(f"{self._kind}{len(self._numbers)}", call.real)
            return _Number(unknown, known, loads, free | {cast("str", function)})
        if not (self._wide and function in _ROUNDS):
            return _Number(exact, known, loads, free)
        unknown = call.constant(f"{self._kind}{len(self._numbers)}", call.real)
        return _Number(unknown, (*known, self._near(exact, unknown)), loads, free)

    def _near(self, exact: Any, rounded: Any) -> Any:  # noqa: ANN401
        """Return the expression that doubles may round an exact result to a number."""
        call = self._call
        negative = call("lt", exact, call.number(Fraction(0)))
        size = call("ite", negative, call("unary_minus", exact), exact)
        share = call.many("mul", [size, call.number(_ROUNDING)])
        slack = call.many("add", [share, call.number(_SMALLEST)])
        above = call("le", call.many("sub", [rounded, exact]), slack)
        below = call("le", call.many("sub", [exact, rounded]), slack)
        near = call.many("and", [above, below])
        return call.many("or", [call("ge", size, call.number(_LARGEST)), near])

    def _applied(self, function: str, operands: Sequence[_Number], terms: Sequence[TermKey]) -> Any:  # noqa: ANN401
        """Return the result of a function, or None if it is not linear."""
        call, x, y = self._call, operands[0].expression, operands[-1].expression
        if not _linear(function, terms):
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


def _linear(function: str, terms: Sequence[TermKey]) -> bool:
    """Return whether a function of some terms is linear, as the solver requires."""
    constant = [term[0] == "const" for term in terms]
    match function:
        case "mul":
            return any(constant)
        case "div":
            return constant[1] and terms[1][1] not in {0.0, math.inf, -math.inf}
    return function in _LINEAR


def _is_linear(term: TermKey) -> bool:
    return all(
        part[0] in {"load", "const"}
        or _linear(cast("str", part[0]), cast("Sequence[TermKey]", part[1:]))
        for part in subterms(term)
    )


def _double(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


_TRIES: Final = 500
"""The maximum number of points to try until predicates have new values."""

_MAX_ROOTS: Final = 1000
"""The maximum number of points that consist of roots."""

_MAX_POINTS: Final = 32
"""The maximum number of points that the solver can choose from."""

_Point = Mapping[str, float]


class PointChoices:
    """Points that give the solver values for nonlinear terms.

    A predicate reads one sample, so a few points suffice to give the predicates all their values.
    The points come from the numbers in the predicates: where a difference is 0, and near there.
    """

    def __init__(
        self, graph: Graph, integers: frozenset[str], ranges: Mapping[str, tuple[float, float]]
    ) -> None:
        self._graph, self._integers, self._ranges = graph, integers, ranges
        self._known: dict[tuple[Atom, ...], list[_Point]] = {}

    def choices(self, truths: Sequence[Truth]) -> list[Truth]:
        """Return a truth per sample: the variables of nonlinear terms are at one of the points."""
        by_sample: dict[int, list[tuple[Truth, Atom]]] = {}
        for node in self._graph.reached(truths):
            atom = self._graph.atom_at(node)
            if atom is not None:
                samples = {sample for _, sample in _loads(atom)}
                if len(samples) == 1:
                    by_sample.setdefault(samples.pop(), []).append((2 * node, atom))
        return [
            self._choice(sample, group)
            for sample, atoms in by_sample.items()
            for group in _groups(atoms)
        ]

    def _choice(self, sample: int, atoms: Sequence[tuple[Truth, Atom]]) -> Truth:
        graph = self._graph
        bare = tuple(_without_sample(atom) for _, atom in atoms)
        if bare not in self._known:
            self._known[bare] = self._points(bare)
        choices = []
        for point in self._known[bare]:
            parts = [
                graph.atom(("equal", ("load", name, sample), ("const", value)))
                for name, value in point.items()
            ]
            parts += [
                truth if _holds(atom, point) else graph.no(truth)
                for (truth, _), atom in zip(atoms, bare, strict=True)
            ]
            choices.append(graph.all(parts))
        return graph.any(choices)

    def _points(self, atoms: Sequence[Atom]) -> list[_Point]:
        points: dict[tuple[bool | None, ...], _Point] = {}
        left = _TRIES
        for point in self._candidates(atoms, points):
            values = tuple(_holds(atom, point) for atom in atoms)
            if None not in values and values not in points:
                points[values] = point
                left = _TRIES
            left -= 1
            if not left or len(points) == _MAX_POINTS:
                break
        return [*points.values()]

    def _candidates(
        self, atoms: Sequence[Atom], points: Mapping[tuple[bool | None, ...], _Point]
    ) -> Iterator[_Point]:
        """Yield points that consist of roots, then points near them."""
        names = sorted({name for atom in atoms for name, _ in _loads(atom)})
        roots: dict[str, dict[float, None]] = {name: {} for name in names}
        numbers = {0.0, 1.0}
        for part in (part for atom in atoms for term in atom[1:] for part in subterms(term)):
            if part[0] == "const" and math.isfinite(cast("float", part[1])):
                numbers.add(abs(cast("float", part[1])))
            for name, value in _root(part):
                roots[name][value] = None
        zeros = [[*(roots[name] or {0.0: None})] for name in names]
        chance = random.Random(0)  # the same points each time
        if math.prod(map(len, zeros)) <= _MAX_ROOTS:
            yield from (self._point(names, values) for values in itertools.product(*zeros))
        sizes = sorted(numbers)
        while True:
            base = [chance.choice(values) for values in zeros]
            near = [*points.values()]
            if near and chance.random() < 0.5:
                base = [*chance.choice(near).values()]
            yield self._point(
                names,
                [
                    value
                    if chance.random() < 0.5
                    else value + chance.choice((-1, 1)) * chance.choice(sizes) * chance.random() * 2
                    for value in base
                ],
            )

    def _point(self, names: Sequence[str], values: Sequence[float]) -> _Point:
        point = {}
        for name, value in zip(names, values, strict=True):
            lower, upper = self._ranges.get(name, (-math.inf, math.inf))
            near = float(f"{value:.3g}")
            near = float(round(near)) if name in self._integers else near
            point[name] = min(max(near, lower), upper) + 0.0
        return point


def _groups(atoms: Sequence[tuple[Truth, Atom]]) -> list[list[tuple[Truth, Atom]]]:
    """Group the predicates of one sample that share variables of nonlinear terms."""
    groups: list[set[str]] = []
    for _, atom in atoms:
        if all(map(_is_linear, atom[1:])):
            continue
        names = _names(atom)
        joined = [group for group in groups if group & names]
        groups = [group for group in groups if not group & names]
        groups.append(names.union(*joined))
    return [[pair for pair in atoms if _names(pair[1]) <= group] for group in groups]


def _loads(atom: Atom) -> Iterator[tuple[str, int]]:
    for part in (part for term in atom[1:] for part in subterms(term)):
        if part[0] == "load":
            yield cast("tuple[str, int]", part[1:])


def _names(atom: Atom) -> set[str]:
    return {name for name, _ in _loads(atom)}


def _root(term: TermKey) -> Iterator[tuple[str, float]]:
    """Yield a variable and its value that makes its sum or difference with a number 0."""
    if term[0] not in {"add", "sub"}:
        return
    x, y = cast("tuple[TermKey, TermKey]", term[1:])
    if x[0] == "const":
        x, y = y, x
    if x[0] == "load" and y[0] == "const" and math.isfinite(cast("float", y[1])):
        sign = -1.0 if term[0] == "add" else 1.0
        yield cast("str", x[1]), sign * cast("float", y[1])


def _without_sample(atom: Atom) -> Atom:
    def without(term: TermKey) -> TermKey:
        if term[0] == "load":
            return "load", term[1], 0
        if term[0] == "const":
            return term
        return (term[0], *(without(cast("TermKey", part)) for part in term[1:]))

    return atom[0], without(atom[1]), without(atom[2])


def _holds(atom: Atom, point: _Point) -> bool | None:
    return atom_value(atom, lambda name, _: point[name])
