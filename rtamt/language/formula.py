"""Formulas and terms in Python.

Equal formulas are one object. ``str`` prints with the fewest brackets that the parser needs:
``parse(str(f)).formula is f``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import cast

from rtamt.errors import InputTypeError, SpecificationError, brief
from rtamt.language.declarations import is_name
from rtamt.language.interval import Exact, Interval
from rtamt.language.node import Node, interned, too_long
from rtamt.language.operators import OPERATORS, Operator


class Term(Node):
    """Arithmetic over variables: ``(variable("x") - 3) * 2``; a comparison returns a formula.

    ``==`` compares trees; the formula ``x == y`` is ``x.equals(y)``.
    """

    __slots__ = ()

    def __add__(self, other: Term | float) -> Term:
        return _term("+", self, other)

    def __radd__(self, other: float) -> Term:
        return _term("+", other, self)

    def __sub__(self, other: Term | float) -> Term:
        return _term("-", self, other)

    def __rsub__(self, other: float) -> Term:
        return _term("-", other, self)

    def __mul__(self, other: Term | float) -> Term:
        return _term("*", self, other)

    def __rmul__(self, other: float) -> Term:
        return _term("*", other, self)

    def __truediv__(self, other: Term | float) -> Term:
        return _term("/", self, other)

    def __rtruediv__(self, other: float) -> Term:
        return _term("/", other, self)

    def __pow__(self, other: Term | float) -> Term:
        return _term("pow", self, other)

    def __neg__(self) -> Term:
        return _term("neg", self)

    def __abs__(self) -> Term:
        return _term("abs", self)

    def sqrt(self) -> Term:
        """Return the square root."""
        return _term("sqrt", self)

    def exp(self) -> Term:
        """Return e to the power of the term."""
        return _term("exp", self)

    def ln(self) -> Term:
        """Return the natural logarithm."""
        return _term("ln", self)

    def log(self, base: Term | float) -> Term:
        """Return the logarithm to a base."""
        return _term("log", self, base)

    def min(self, *others: Term | float) -> Term:
        """Return the minimum of this and the others."""
        return _term("min", self, *others)

    def max(self, *others: Term | float) -> Term:
        """Return the maximum of this and the others."""
        return _term("max", self, *others)

    def __lt__(self, other: Term | float) -> Formula:
        return _comparison("<", self, other)

    def __le__(self, other: Term | float) -> Formula:
        return _comparison("<=", self, other)

    def __gt__(self, other: Term | float) -> Formula:
        return _comparison(">", self, other)

    def __ge__(self, other: Term | float) -> Formula:
        return _comparison(">=", self, other)

    def equals(self, other: Term | float) -> Formula:
        """Return the formula ``self == other``."""
        return _comparison("==", self, other)

    def differs(self, other: Term | float) -> Formula:
        """Return the formula ``self != other``."""
        return _comparison("!=", self, other)

    def formula(self) -> Formula:
        """Return the formula that has the value of the term as its robustness."""
        return cast("Formula", make("value", (self,)))


class Formula(Node):
    """A formula of signal temporal logic.

    Temporal methods take the bounds ``begin`` and ``end`` of the interval, both included. The end
    may have a unit (``always(0, "500ms")``); None: the interval is unbounded.

    Example:
        >>> x = variable("x")
        >>> f = (x > 0).always(0, 5) | ~(x + 1 > 3)
        >>> print(f)
        always[0:5](x > 0) or not (x + 1 > 3)
    """

    __slots__ = ()

    def __bool__(self) -> bool:
        msg = f"a formula has no truth value; use & | ~ instead of and, or, not: {self}"
        raise InputTypeError(msg)

    def __and__(self, other: Formula) -> Formula:
        return conjunction((self, other))

    def __or__(self, other: Formula) -> Formula:
        return disjunction((self, other))

    def __invert__(self) -> Formula:
        return self._with("not")

    def implies(self, other: Formula) -> Formula:
        """Return ``self implies other``."""
        return self._with("implies", other)

    def iff(self, other: Formula) -> Formula:
        """Return ``self iff other``."""
        return self._with("iff", other)

    def xor(self, other: Formula) -> Formula:
        """Return ``self xor other``."""
        return self._with("xor", other)

    def in_words(self, names: Mapping[str, str] | None = None, *, unit: str | None = None) -> str:
        """Return the formula in plain English, as `Specification.in_words` does.

        Example:
            >>> from rtamt import variable
            >>> (variable("speed") < 120).always().in_words({"speed": "the speed"})
            'the speed stays below 120 at all times'
        """
        from rtamt.language.words import in_words

        return in_words(self, names, unit=unit)

    def always(self, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``always[begin:end] self``."""
        return self._with("always", interval=Interval.of(begin, end))

    def eventually(self, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``eventually[begin:end] self``."""
        return self._with("eventually", interval=Interval.of(begin, end))

    def historically(self, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``historically[begin:end] self``."""
        return self._with("historically", interval=Interval.of(begin, end))

    def once(self, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``once[begin:end] self``."""
        return self._with("once", interval=Interval.of(begin, end))

    def until(self, other: Formula, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``self until[begin:end] other``."""
        return self._with("until", other, interval=Interval.of(begin, end))

    def since(self, other: Formula, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``self since[begin:end] other``."""
        return self._with("since", other, interval=Interval.of(begin, end))

    def unless(self, other: Formula, begin: Exact = 0, end: Exact | None = None) -> Formula:
        """Return ``self unless[begin:end] other``."""
        return self._with("unless", other, interval=Interval.of(begin, end))

    def next(self, *, strong: bool = False) -> Formula:
        """Return ``next self``; strong: -inf instead of +inf after the last sample."""
        return self._with("s_next" if strong else "next")

    def prev(self, *, strong: bool = False) -> Formula:
        """Return ``prev self``; strong: -inf instead of +inf before the first sample."""
        return self._with("s_prev" if strong else "prev")

    def rise(self) -> Formula:
        """Return ``rise(self)``."""
        return self._with("rise")

    def fall(self) -> Formula:
        """Return ``fall(self)``."""
        return self._with("fall")

    def _with(self, name: str, *others: Formula, interval: Interval | None = None) -> Formula:
        return cast("Formula", make(name, (self, *others), interval))


def variable(name: str) -> Term:
    """Return the term of a variable: ``speed``, or ``scan.ranges[0]`` in a message.

    Raises:
        SpecificationError: If the name has another form, or is a reserved word such as ``always``.
            The name of a function, such as ``min``, may name a variable too.
    """
    if not isinstance(name, str):
        msg = f"expected the name of a variable as text, got {type(name).__name__} {brief(name)}"
        raise InputTypeError(msg)
    if msg := too_long(name):
        raise SpecificationError(msg)
    if not is_name(name):
        msg = f"expected a name of letters, digits, '_' and dots, got '{name}'"
        raise SpecificationError(msg)
    if msg := OPERATORS.refusal(name.partition("[")[0]):
        raise SpecificationError(msg)
    return interned(Term, None, leaf=name)


def number(value: float) -> Term:
    """Return the term of a finite number."""
    argument: object = value
    wrong = isinstance(argument, complex | str) or not hasattr(argument, "__float__")
    double = None if wrong or getattr(argument, "ndim", None) else _float(value)
    if double is None:
        msg = f"expected a real number, got {type(value).__name__} {brief(value)}"
        raise InputTypeError(msg)
    if not math.isfinite(double):
        msg = f"expected a finite number in a term, got {brief(value)}"
        raise SpecificationError(f"{msg}; write true or false for +-inf")
    return interned(Term, None, leaf=double)


def _float(value: float) -> float | None:
    try:
        return float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return None


def conjunction(formulas: Iterable[Formula]) -> Formula:
    """Return the ``and`` of one formula or more, as one node."""
    return _junction("and", formulas)


def disjunction(formulas: Iterable[Formula]) -> Formula:
    """Return the ``or`` of one formula or more, as one node."""
    return _junction("or", formulas)


def make(name: str, args: tuple[Node, ...], interval: Interval | None = None) -> Term | Formula:
    """Return the node of any operator: ``make("always", (p,), Interval.of(0, 5))``.

    Raises:
        SpecificationError: If the kind or number of operands is wrong, if the operator takes no
            interval, or if the tree is too deep or too large.
    """
    op = OPERATORS[name]
    kind: type[Node] = Term if op.operands == "term" else Formula
    args = tuple(_as_kind(op, kind, arg) for arg in args)
    if op.grouping == "flat":
        args = tuple(part for arg in args for part in (arg.args if arg.op is op else (arg,)))
    elif op.grouping == "left-flat" and args[0].op is op:
        args = args[0].args + args[1:]
    elif name == "neg" and args[0].op is None and type(args[0].leaf) is float:
        return number(-args[0].leaf)  # the program negates a traced number
    least, most = op.arity
    if len(args) < least or (most is not None and len(args) > most):
        expected = f"{least}" if most == least else f"{least} or more"
        operands = "operand" if most == 1 else "operands"
        msg = f"expected {expected} {operands} for '{op.symbol}', got {len(args)}"
        raise SpecificationError(msg)
    if name == "rate" and not isinstance(args[0].leaf, str):
        msg = f"expected a variable in rate(x), got '{args[0]}'"
        raise SpecificationError(msg)
    if interval is not None and not op.timed:
        msg = f"'{op.symbol}' takes no interval, got {interval}"
        raise SpecificationError(msg)
    result: type[Term | Formula] = Term if op.result == "term" else Formula
    return interned(result, op, args, interval)


def replaced(formula: Formula, instead: Mapping[Node, Node]) -> Formula:
    """Return the formula with some of its nodes replaced everywhere.

    Example:
        >>> x = variable("x")
        >>> print(replaced((x > 3).always() & (x > 3), {x > 3: x > 4}))
        always(x > 4) and x > 4
    """
    new = {**instead}
    for node in formula.nodes():
        if node not in new:
            new[node] = with_operands(node, [new[arg] for arg in node.args])
    return cast("Formula", new[formula])


def with_operands(node: Node, args: Sequence[Node]) -> Node:
    """Return the node with other operands; the node itself if they are its own."""
    if node.op is None or all(a is b for a, b in zip(args, node.args, strict=True)):
        return node
    return make(node.op.name, tuple(args), node.interval)


def predicates(formula: Formula) -> tuple[Formula, ...]:
    """Return the comparisons, and the terms that are formulas, as `Specification.predicates`."""
    nodes = (node for node in formula.nodes() if isinstance(node, Formula))
    return tuple(node for node in nodes if node.args and isinstance(node.args[0], Term))


def scaled(formula: Formula, scales: Mapping[Formula, float]) -> Formula:
    """Return the formula with predicates divided by scales, as `Specification.scaled`."""
    known = set(predicates(formula))
    divided: dict[Node, Node] = {}
    for predicate, scale in scales.items():
        if predicate not in known:
            raise SpecificationError(f"expected scales of predicates of {formula}, got {predicate}")
        if cast("float", number(scale).leaf) <= 0:
            raise SpecificationError(
                f"expected a positive scale of {predicate}, got {brief(scale)}"
            )
        name = predicate.op.name if predicate.op else ""
        left, *right = (cast("Term", arg) for arg in predicate.args)
        if right:  # differences keep the sign
            args: tuple[Term, ...] = ((left - right[0]) / scale, number(0.0))
        else:
            args = (left / scale,)
        divided[predicate] = make(name, args)
    return replaced(formula, divided)


def _junction(name: str, formulas: Iterable[Formula]) -> Formula:
    argument: object = formulas
    if not isinstance(argument, Iterable) or getattr(argument, "ndim", 1) == 0:
        msg = f"expected formulas in a list or the like for '{name}', got {brief(argument)}"
        raise InputTypeError(msg)
    parts = tuple(formulas)
    if len(parts) == 1:
        return cast("Formula", _as_kind(OPERATORS[name], Formula, parts[0]))
    return cast("Formula", make(name, parts))


def _term(name: str, *args: Term | float) -> Term:
    return cast("Term", make(name, tuple(_as_term(a) for a in args)))


def _comparison(name: str, x: Term, y: Term | float) -> Formula:
    return cast("Formula", make(name, (x, _as_term(y))))


def _as_term(value: Term | float) -> Term:
    return value if isinstance(value, Node) else number(value)


def _as_kind(op: Operator, kind: type[Node], arg: Node) -> Node:
    if kind is Formula and isinstance(arg, Term):
        return arg.formula()
    # A term that was read as a formula is still a term: `x` in `f = x` and then `f > 3`.
    if kind is Term and isinstance(arg, Formula) and arg.op is OPERATORS["value"]:
        return arg.args[0]
    if not isinstance(arg, kind):
        got = (
            f"the formula {arg}"
            if isinstance(arg, Formula)
            else f"{type(arg).__name__} {brief(arg)}"
        )
        msg = f"expected a {kind.__name__.lower()} as operand of '{op.symbol}', got {got}"
        raise SpecificationError(msg)
    return arg
