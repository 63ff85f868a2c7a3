"""The table of operators: one row says how an operator is written and what it means.

The parser, the printer, the compiler and the documentation read the rows. A meaning is a function
over a `Builder`: sugar is one line over the core (`map` of a function, a lattice fold over a window
of offsets from now). Definitions follow the robust semantics of STL (Fainekos and Pappas 2009;
Donze and Maler 2010) as used by Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors
from STL", ATVA 2020.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

__all__ = [
    "OPERATORS",
    "RESERVED",
    "SPELLINGS",
    "Bounds",
    "Builder",
    "Meaning",
    "Operator",
]

Bounds = tuple[int, int | None]
"""Bounds of an interval in samples; None is no upper bound."""


class Builder(Protocol):
    """What a meaning is written in. A register is whatever the builder hands out."""

    def constant(self, value: float) -> int:
        """The same value at every sample, seen or not."""

    def map(self, function: str, *args: int) -> int:
        """The function of the operands' values now."""

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        """The fold over offsets lo to hi from now, cut to the trace; None is unbounded."""

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        """Half-open until: p holds from now on up to, not at, the moment q holds."""

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        """Half-open since: p holds from just after the moment q held."""


Meaning = Callable[..., int]
Kind = Literal["term", "formula"]
Notation = Literal["prefix", "infix", "call", "atom"]
Grouping = Literal["flat", "left-flat", "left", "none"]


@dataclass(frozen=True, slots=True)
class Operator:
    """One row.

    Attributes:
        name: The key of the row.
        spellings: Every spelling that the parser takes; `str` prints the first.
        notation: ``p op q``, ``op p``, ``op(p, ...)`` or a constant by itself.
        precedence: Binding strength; higher binds tighter.
        operands: Whether the operands are terms or formulas.
        result: Whether the whole is a term or a formula.
        arity: Least and greatest number of operands; None is any.
        grouping: For infix operators: ``flat`` associates and is one node of many operands,
            ``left-flat`` likewise but only on the left (floating-point sums), ``left`` nests to the
            left, ``none`` does not chain.
        timed: Whether an interval may follow the operator.
        future: Whether the value depends on later samples.
        sampled: Whether it speaks of neighbouring samples, which dense time has not.
        holds: For predicates: +inf where they hold, -inf where not; over a builder and registers.
        meaning: The robustness, over a builder and the operands' registers (after the bounds).
        doc: The robustness at sample i, in one line.
    """

    name: str
    spellings: tuple[str, ...]
    notation: Notation
    precedence: int
    operands: Kind
    result: Kind
    arity: tuple[int, int | None]
    meaning: Meaning
    doc: str
    grouping: Grouping = "none"
    timed: bool = False
    future: bool = False
    sampled: bool = False
    holds: Meaning | None = None

    def __post_init__(self) -> None:
        """Check the row against itself."""
        infix = self.notation == "infix"
        well_formed = (
            len(self.spellings) > 0
            and (infix or self.grouping == "none")
            and (not infix or self.arity[0] == 2)
            and (self.notation != "prefix" or self.arity == (1, 1))
            and (not self.timed or self.operands == "formula")
        )
        if not well_formed:
            msg = f"the row of {self.name} contradicts itself"
            raise AssertionError(msg)

    @property
    def symbol(self) -> str:
        """The canonical spelling."""
        return self.spellings[0]

    def __reduce__(self) -> tuple[Callable[[str], Operator], tuple[str]]:
        return _row, (self.name,)

    def __repr__(self) -> str:
        return f"<operator {self.name}>"


def _row(name: str) -> Operator:
    return OPERATORS[name]


def _fold(function: str) -> Meaning:
    def meaning(b: Builder, first: int, *rest: int) -> int:
        for operand in rest:
            first = b.map(function, first, operand)
        return first

    return meaning


def _swapped(function: str) -> Meaning:
    return lambda b, x, y: b.map(function, y, x)


def _ahead(fold: str) -> Meaning:
    return lambda b, bounds, p: b.window(fold, bounds[0], bounds[1], p)


def _back(fold: str) -> Meaning:
    return lambda b, bounds, p: b.window(fold, _minus(bounds[1]), -bounds[0], p)


def _step(fold: str, offset: int) -> Meaning:
    # A window of one sample is that sample; outside the trace it is the identity of the fold:
    # +inf of min is the weak form, -inf of max the strong one.
    return lambda b, p: b.window(fold, offset, offset, p)


def _minus(bound: int | None) -> int | None:
    return None if bound is None else -bound


def _apart(b: Builder, x: int, y: int) -> int:
    return b.map("abs", b.map("sub", x, y))


def _implies(b: Builder, p: int, q: int) -> int:
    return b.map("max", b.map("neg", p), q)


def _iff(b: Builder, p: int, q: int) -> int:
    return b.map("min", _implies(b, p, q), _implies(b, q, p))


def _unless(b: Builder, bounds: Bounds, p: int, q: int) -> int:
    return b.map("max", b.window("min", 0, bounds[1], p), b.until(bounds, p, q))


def _rise(b: Builder, p: int) -> int:
    return b.map("min", b.window("min", -1, -1, b.map("neg", p)), p)


def _term(
    name: str,
    precedence: int,
    arity: tuple[int, int | None],
    meaning: Meaning,
    doc: str,
    notation: Notation = "call",
    grouping: Grouping = "none",
    spellings: tuple[str, ...] = (),
) -> Operator:
    return Operator(
        name,
        spellings or (name,),
        notation,
        precedence,
        "term",
        "term",
        arity,
        meaning,
        doc,
        grouping,
    )


def _atom(
    name: str, arity: tuple[int, int], meaning: Meaning, doc: str, holds: Meaning | None = None
) -> Operator:
    spellings = (name,) if arity == (0, 0) else ("",)
    return Operator(
        name, spellings, "atom", 14, "term", "formula", arity, meaning, doc, holds=holds
    )


def _compare(name: str, meaning: Meaning, holds: Meaning, doc: str, *others: str) -> Operator:
    spellings = (name, *others)
    return Operator(
        name, spellings, "infix", 9, "term", "formula", (2, 2), meaning, doc, holds=holds
    )


def _temporal(name: str, others: str, meaning: Meaning, doc: str, *, future: bool) -> Operator:
    return Operator(
        name,
        (name, *others.split()),
        "prefix",
        7,
        "formula",
        "formula",
        (1, 1),
        meaning,
        doc,
        timed=True,
        future=future,
    )


def _neighbour(name: str, other: str, meaning: Meaning, doc: str, *, future: bool) -> Operator:
    return Operator(
        name,
        (name, other),
        "prefix",
        7,
        "formula",
        "formula",
        (1, 1),
        meaning,
        doc,
        future=future,
        sampled=True,
    )


def _edge(name: str, meaning: Meaning, doc: str) -> Operator:
    return Operator(
        name, (name,), "call", 13, "formula", "formula", (1, 1), meaning, doc, sampled=True
    )


def _binary(
    name: str,
    others: str,
    precedence: int,
    meaning: Meaning,
    doc: str,
    grouping: Grouping = "none",
    *,
    timed: bool = False,
    future: bool = False,
) -> Operator:
    arity = (2, None if grouping == "flat" else 2)
    return Operator(
        name,
        (name, *others.split()),
        "infix",
        precedence,
        "formula",
        "formula",
        arity,
        meaning,
        doc,
        grouping,
        timed,
        future,
    )


def _unary(function: str) -> Meaning:
    return lambda b, p: b.map(function, p)


OPERATORS: Mapping[str, Operator] = {
    row.name: row
    for row in (
        # atoms
        _atom("true", (0, 0), lambda b: b.constant(math.inf), "+inf"),
        _atom("false", (0, 0), lambda b: b.constant(-math.inf), "-inf"),
        # A term by itself is a formula; it has no symbol of its own.
        _atom(
            "value",
            (1, 1),
            lambda _, x: x,
            "the value of the term",
            lambda b, x: b.map("ge", x, b.constant(0.0)),
        ),
        # terms
        _term("abs", 13, (1, 1), _unary("abs"), "absolute value"),
        _term("sqrt", 13, (1, 1), _unary("sqrt"), "square root"),
        _term("exp", 13, (1, 1), _unary("exp"), "e to the power of x"),
        _term("ln", 13, (1, 1), _unary("ln"), "natural logarithm"),
        _term("pow", 13, (2, 2), _fold("pow"), "pow(x, y): x to the power of y"),
        _term("log", 13, (2, 2), _fold("log"), "log(x, base): ln(x) / ln(base)"),
        _term("min", 13, (2, None), _fold("min"), "the least of two terms or more"),
        _term("max", 13, (2, None), _fold("max"), "the greatest of two terms or more"),
        _term("neg", 12, (1, 1), _unary("neg"), "unary minus", "prefix", spellings=("-",)),
        _term("*", 11, (2, None), _fold("mul"), "product", "infix", "left-flat"),
        _term(
            "/",
            11,
            (2, 2),
            _fold("div"),
            "quotient; x / 0 is +inf or -inf",
            "infix",
            "left",
        ),
        _term("+", 10, (2, None), _fold("add"), "sum", "infix", "left-flat"),
        _term("-", 10, (2, 2), _fold("sub"), "difference", "infix", "left"),
        # comparisons: terms to a formula
        _compare(">=", _fold("sub"), _fold("ge"), "x - y"),
        _compare(">", _fold("sub"), _fold("gt"), "x - y"),
        _compare("<=", _swapped("sub"), _swapped("ge"), "y - x"),
        _compare("<", _swapped("sub"), _swapped("gt"), "y - x"),
        _compare("==", lambda b, x, y: b.map("neg", _apart(b, x, y)), _fold("eq"), "-abs(x - y)"),
        _compare("!=", _apart, _fold("ne"), "abs(x - y)", "!=="),
        # Boolean
        Operator(
            "not",
            ("not", "!"),
            "prefix",
            8,
            "formula",
            "formula",
            (1, 1),
            _unary("neg"),
            "-p(i)",
        ),
        _binary("and", "& &&", 5, _fold("min"), "min of the operands at i", "flat"),
        _binary("or", "| ||", 4, _fold("max"), "max of the operands at i", "flat"),
        _binary("implies", "->", 3, _implies, "max(-p, q)"),
        _binary("iff", "<->", 2, _iff, "min(max(-p, q), max(-q, p))", "left"),
        _binary(
            "xor",
            "",
            1,
            lambda b, p, q: b.map("neg", _iff(b, p, q)),
            "max(min(p, -q), min(-p, q))",
            "left",
        ),
        # the past
        _temporal(
            "historically",
            "H",
            _back("min"),
            "min of p over [i-b, i-a] cut to the trace; empty: +inf",
            future=False,
        ),
        _temporal(
            "once",
            "O",
            _back("max"),
            "max of p over [i-b, i-a] cut to the trace; empty: -inf",
            future=False,
        ),
        _binary(
            "since",
            "S",
            6,
            lambda b, bounds, p, q: b.since(bounds, p, q),
            "max over j in [i-b, i-a] of min(q(j), min of p over (j, i])",
            timed=True,
        ),
        _neighbour(
            "prev",
            "Y",
            _step("min", -1),
            "p(i-1); at the first sample +inf",
            future=False,
        ),
        _neighbour(
            "s_prev",
            "sY",
            _step("max", -1),
            "p(i-1); at the first sample -inf",
            future=False,
        ),
        _edge("rise", _rise, "min(-p(i-1), p(i)); the first sample has no neighbour: p(i)"),
        _edge(
            "fall",
            lambda b, p: _rise(b, b.map("neg", p)),
            "min(p(i-1), -p(i)); first: -p(i)",
        ),
        # the future
        _temporal(
            "always",
            "G alw",
            _ahead("min"),
            "min of p over [i+a, i+b] cut to the trace; empty: +inf",
            future=True,
        ),
        _temporal(
            "eventually",
            "F ev",
            _ahead("max"),
            "max of p over [i+a, i+b] cut to the trace; empty: -inf",
            future=True,
        ),
        _binary(
            "until",
            "U",
            6,
            lambda b, bounds, p, q: b.until(bounds, p, q),
            "max over j in [i+a, i+b] of min(q(j), min of p over [i, j))",
            timed=True,
            future=True,
        ),
        _binary(
            "unless",
            "W",
            6,
            _unless,
            "always[0:b] p or p until[a:b] q",
            timed=True,
            future=True,
        ),
        _neighbour("next", "X", _step("min", 1), "p(i+1); at the last sample +inf", future=True),
        _neighbour(
            "s_next",
            "sX",
            _step("max", 1),
            "p(i+1); at the last sample -inf",
            future=True,
        ),
    )
}

SPELLINGS: Mapping[tuple[str, Notation], Operator] = {
    (spelling, row.notation): row for row in OPERATORS.values() for spelling in row.spellings
}
"""(spelling, notation) to its row; ``-`` is a prefix and an infix operator."""

RESERVED = frozenset(
    {s for row in OPERATORS.values() for s in row.spellings if s.isidentifier()}
    | {"inf", "const", "input", "output", "specification", "from", "import"}
)
"""Words that cannot name a variable."""
