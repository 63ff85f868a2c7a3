"""The rows of the table of operators: how each is written and what it means.

The parser, the printer, the compiler and the documentation read the rows. A meaning is a function
over a `Builder`: sugar is one line over the core (`map` of a function, a lattice fold over a window
of offsets from now). Definitions follow the robust semantics of STL (Fainekos and Pappas 2009;
Donze and Maler 2010) as used by Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors
from STL", ATVA 2020.

To add an operator that other operators define, such as a weak next:

1. Add a row to `OPERATORS`. The scanner finds its words there. A symbol, prefix or infix, also
   needs an alternative of ``SYMBOL`` in ``rtamt/language/grammar/Stl.g4``; then run
   ``rtamt/language/grammar/generate.py``.
2. Add the words for sentences: see `rtamt.language.phrases`.
3. Define the row again in the oracles of the tests: a ``case`` in ``tests/support/oracle.py`` (the
   value, and the horizon if it looks ahead), in ``boolean_oracle.py``, and in ``dense_oracle.py``
   unless the row is ``sampled``. Add an operator with an interval to the three errors in
   ``tests/rtamt/language/parse_errors.txt`` that list such operators.
4. List the words in the first table of ``docs/language.md``.

Explanations follow from the row (`rtamt.monitors.origins`). A method of `Formula` or `Term` is
optional: `make` in `rtamt.language.formula` makes the node of any row.

To add a function, such as ``tanh``:

1. Add a row to `OPERATORS`: ``_function("tanh", "hyperbolic tangent")``.
2. Add a row to `FUNCTIONS` in `rtamt.program.algebra`. It names the rule of
   `rtamt.program.intervals` for unknown operands; ``everything`` is right for every function.
3. In C++, add a line to the X-macro in ``rtamt/native/core/functions.hpp``, and the same rule under
   the same name in ``rtamt/native/core/intervals.hpp``.
4. For arrays, add a row to `FUNCTIONS` in `rtamt_arrays.functions`. If the row needs a function of
   the library, add it to `Operations` in `rtamt_arrays.operations` and to ``operations.py`` of both
   ``rtamt_arrays/jax`` and ``rtamt_arrays/torch``.
5. Add the words, and list the function in ``docs/language.md``, as for an operator. An error in
   ``tests/rtamt/language/parse_errors.txt`` lists all functions.
6. In ``tests/support``, define the function in ``oracle.py``. Add it to ``_GUARDS`` of
   ``strategies.py`` if it is not defined everywhere, and to ``ROUNDED`` of ``array_cases.py`` if
   libraries round it differently.
"""

from __future__ import annotations

import math
from typing import Literal

from rtamt.language.table import Bounds, Builder, Grouping, Meaning, Operator, OperatorTable

__all__ = ["OPERATORS"]


# Meanings. ---------------------------------------------------------------------------------------


def _apply(function: str) -> Meaning:
    return lambda b, *operands: b.map(function, *operands)


def _swapped(function: str) -> Meaning:
    return lambda b, x, y: b.map(function, y, x)


def _chained(function: str) -> Meaning:
    def meaning(b: Builder, first: int, *rest: int) -> int:
        for operand in rest:
            first = b.map(function, first, operand)
        return first

    return meaning


def _ahead(fold: str) -> Meaning:
    return lambda b, bounds, p: b.window(fold, *bounds, p)


def _back(fold: str) -> Meaning:
    def meaning(b: Builder, bounds: Bounds, p: int) -> int:
        begin, end = bounds
        return b.window(fold, None if end is None else -end, -begin, p)

    return meaning


def _implies(b: Builder, p: int, q: int) -> int:
    return b.map("max", b.map("neg", p), q)


def _iff(b: Builder, p: int, q: int) -> int:
    return b.map("min", _implies(b, p, q), _implies(b, q, p))


def _xor(b: Builder, p: int, q: int) -> int:
    return b.map("neg", _iff(b, p, q))


def _unless(b: Builder, bounds: Bounds, p: int, q: int) -> int:
    return b.map("max", b.window("min", 0, bounds[1], p), b.until(bounds, p, q))


def _rise(b: Builder, p: int) -> int:
    return b.map("min", b.window("min", -1, -1, b.map("neg", p)), p)


def _fall(b: Builder, p: int) -> int:
    return _rise(b, b.map("neg", p))


# Shapes of rows. ---------------------------------------------------------------------------------


def _function(name: str, doc: str, least: int = 1, most: int | None = 1) -> Operator:
    """A function that has the same name in the algebra."""
    meaning = _apply(name) if most == 1 else _chained(name)
    return Operator((name,), "call", 13, doc, meaning, (least, most), "term", "term")


def _arithmetic(
    symbol: str, precedence: int, doc: str, function: str, grouping: Grouping
) -> Operator:
    arity = (2, None if grouping == "left-flat" else 2)
    meaning = _chained(function)
    return Operator((symbol,), "infix", precedence, doc, meaning, arity, "term", "term", grouping)


def _comparison(
    spellings: tuple[str, ...], doc: str, difference: Meaning, holds: Meaning
) -> Operator:
    return Operator(spellings, "infix", 9, doc, difference, (2, 2), "term", "formula", holds=holds)


def _junction(spellings: tuple[str, ...], precedence: int, doc: str, function: str) -> Operator:
    meaning = _chained(function)
    return Operator(spellings, "infix", precedence, doc, meaning, (2, None), grouping="flat")


def _timed(
    spellings: tuple[str, ...],
    notation: Literal["prefix", "infix"],
    doc: str,
    meaning: Meaning,
    *,
    future: bool = False,
) -> Operator:
    """An operator that takes an interval."""
    precedence, operands = (7, 1) if notation == "prefix" else (6, 2)
    arity = (operands, operands)
    return Operator(spellings, notation, precedence, doc, meaning, arity, timed=True, future=future)


def _neighbour(spellings: tuple[str, ...], doc: str, offset: int, fold: str) -> Operator:
    """The sample next to this one; outside the trace it is the identity of the fold.

    min has the identity +inf, which makes the weak operator, max has -inf, which makes the strong
    one.
    """

    def meaning(b: Builder, p: int) -> int:
        return b.window(fold, offset, offset, p)

    return Operator(spellings, "prefix", 7, doc, meaning, sampled=True, future=offset > 0)


# The rows. ---------------------------------------------------------------------------------------

_ROWS = (
    # atoms
    Operator(("true",), "atom", 14, "+inf", lambda b: b.constant(math.inf), (0, 0), "term"),
    Operator(("false",), "atom", 14, "-inf", lambda b: b.constant(-math.inf), (0, 0), "term"),
    # A term by itself is a formula; it has no symbol of its own.
    Operator(
        ("",),
        "atom",
        14,
        "the value of the term",
        _apply("nonnegative"),
        operands="term",
        holds=lambda b, x: b.map("ge", x, b.constant(0.0)),
        name="value",
    ),
    # terms
    _function("abs", "absolute value"),
    _function("sqrt", "square root"),
    _function("exp", "e to the power of x"),
    _function("ln", "natural logarithm"),
    _function("pow", "pow(x, y): x to the power of y", 2, 2),
    _function("log", "log(x, base): ln(x) / ln(base)", 2, 2),
    _function("min", "the least of two terms or more", 2, None),
    _function("max", "the greatest of two terms or more", 2, None),
    Operator(
        ("rate",),
        "call",
        13,
        "the change of a variable since the sample before, per second; 0 at the first sample",
        lambda b, x: b.rate(x),
        operands="term",
        result="term",
        sampled=True,
    ),
    Operator(
        ("-",), "prefix", 12, "unary minus", _apply("neg"), (1, 1), "term", "term", name="neg"
    ),
    _arithmetic("*", 11, "product", "mul", "left-flat"),
    _arithmetic("/", 11, "quotient; x / 0 is +inf or -inf", "div", "left"),
    _arithmetic("+", 10, "sum", "add", "left-flat"),
    _arithmetic("-", 10, "difference", "sub", "left"),
    # comparisons
    _comparison((">=",), "x - y", _apply("at_least"), _apply("ge")),
    _comparison((">",), "x - y", _apply("above"), _apply("gt")),
    _comparison(("<=",), "y - x", _swapped("at_least"), _swapped("ge")),
    _comparison(("<",), "y - x", _swapped("above"), _swapped("gt")),
    _comparison(("==",), "-abs(x - y)", _apply("equal"), _apply("eq")),
    _comparison(("!=", "!=="), "abs(x - y)", _apply("unequal"), _apply("ne")),
    # Boolean
    Operator(("not", "!"), "prefix", 8, "-p(i)", _apply("neg")),
    _junction(("and", "&", "&&"), 5, "min of the operands at i", "min"),
    _junction(("or", "|", "||"), 4, "max of the operands at i", "max"),
    Operator(("implies", "->"), "infix", 3, "max(-p, q)", _implies, (2, 2)),
    Operator(
        ("iff", "<->"), "infix", 2, "min(max(-p, q), max(-q, p))", _iff, (2, 2), grouping="left"
    ),
    Operator(("xor",), "infix", 1, "max(min(p, -q), min(-p, q))", _xor, (2, 2), grouping="left"),
    # the past
    _timed(
        ("historically", "H"),
        "prefix",
        "min of p over [i-b, i-a] cut to the trace; empty: +inf",
        _back("min"),
    ),
    _timed(
        ("once", "O"),
        "prefix",
        "max of p over [i-b, i-a] cut to the trace; empty: -inf",
        _back("max"),
    ),
    _timed(
        ("since", "S"),
        "infix",
        "max over j in [i-b, i-a] of min(q(j), min of p over (j, i])",
        lambda b, bounds, p, q: b.since(bounds, p, q),
    ),
    _neighbour(("prev", "Y"), "p(i-1); at the first sample +inf", -1, "min"),
    _neighbour(("s_prev", "sY"), "p(i-1); at the first sample -inf", -1, "max"),
    Operator(
        ("rise",),
        "call",
        13,
        "min(-p(i-1), p(i)); the first sample has no neighbour: p(i)",
        _rise,
        sampled=True,
    ),
    Operator(
        ("fall",),
        "call",
        13,
        "min(p(i-1), -p(i)); the first sample has no neighbour: -p(i)",
        _fall,
        sampled=True,
    ),
    # the future
    _timed(
        ("always", "G", "alw"),
        "prefix",
        "min of p over [i+a, i+b] cut to the trace; empty: +inf",
        _ahead("min"),
        future=True,
    ),
    _timed(
        ("eventually", "F", "ev"),
        "prefix",
        "max of p over [i+a, i+b] cut to the trace; empty: -inf",
        _ahead("max"),
        future=True,
    ),
    _timed(
        ("until", "U"),
        "infix",
        "max over j in [i+a, i+b] of min(q(j), min of p over [i, j))",
        lambda b, bounds, p, q: b.until(bounds, p, q),
        future=True,
    ),
    _timed(("unless", "W"), "infix", "always[0:b] p or p until[a:b] q", _unless, future=True),
    _neighbour(("next", "X"), "p(i+1); at the last sample +inf", 1, "min"),
    _neighbour(("s_next", "sX"), "p(i+1); at the last sample -inf", 1, "max"),
)

OPERATORS = OperatorTable(_ROWS)
