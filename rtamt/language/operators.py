"""The table of operators: their notation and their meaning.

The parser, the printer, the compiler and the documentation read the rows. A meaning is a function
over a `Builder`: sugar is one line over the core, which is a function of values now (`map`) and a
lattice fold over a window of offsets (`window`). Definitions follow the robust semantics of STL
(Fainekos and Pappas 2009; Donze and Maler 2010) as used by Nickovic and Yamaguchi, "RTAMT: Online
Robustness Monitors from STL", ATVA 2020.

To add an operator that other operators define, such as a weak next:

1. Add a row to `OPERATORS`. The scanner finds its words there. A symbol, prefix or infix, also
   needs an alternative of ``SYMBOL`` in ``rtamt/language/grammar/Stl.g4``; then run
   ``rtamt/language/grammar/generate.py``.
2. Add the words for sentences: see `rtamt.language.words`.
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
   the same module for unknown operands; ``everything`` is right for every function. Add
   a rule that rounds outward to ``WIDER`` in ``tests/rtamt/program/test_interval_arithmetic.py``.
3. In C++, add a line to the X-macro in ``rtamt/native/core/functions.hpp``, and the same rule under
   the same name in ``rtamt/native/core/intervals.hpp``. If the function returns a number for a nan,
   as ``pow(nan, 0)`` does, add it to ``rtamt/native/discrete/columns.hpp``.
4. For arrays, add a row to `FUNCTIONS` in `rtamt_arrays.functions`. If the row needs a function of
   the library, add it to `Operations` in `rtamt_arrays.operations` and to ``operations.py`` of both
   ``rtamt_arrays/jax`` and ``rtamt_arrays/torch``.
5. Add the words, and list the function in ``docs/language.md``, as for an operator. An error in
   ``tests/rtamt/language/parse_errors.txt`` lists all functions.
6. In ``tests/support``, define the function in ``oracle.py``. Add it to ``_GUARDS`` of
   ``strategies.py`` if it is not defined everywhere. If libraries round it differently, add it to
   ``ROUNDED`` of ``array_cases.py`` and to "Exactness and errors" in ``docs/arrays.md``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

KEYWORDS = frozenset({"inf", "const", "input", "output", "specification", "from", "import"})
"""The words of statements in the grammar; an operator cannot have such a spelling."""

Bounds = tuple[int, int | None]
"""Bounds of an interval in samples; the upper bound is None if it is unbounded."""


class Builder(Protocol):
    """Writes the instructions of a meaning; every method returns the register of a value."""

    def constant(self, value: float) -> int:
        """Return the same value at every sample, seen or not."""

    def map(self, function: str, *args: int) -> int:
        """Return the function of the operands' values now."""

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        """Return the fold over offsets lo to hi, cut to the trace; None is unbounded."""

    def rate(self, x: int) -> int:
        """Return the change per second of the variable in a register."""

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
    """One row."""

    spellings: tuple[str, ...]  # every spelling that the parser takes; `str` prints the first
    notation: Notation  # ``op p``, ``p op q``, ``op(p, ...)``, or a formula without operands
    precedence: int  # binding strength; higher binds tighter
    doc: str  # the robustness at sample i, in one line
    # the robustness, over a builder and the operands' registers (after the bounds)
    meaning: Meaning
    # the smallest and the largest number of operands; None is any
    arity: tuple[int, int | None] = (1, 1)
    operands: Kind = "formula"  # whether the operands are terms or formulas
    result: Kind = "formula"  # whether the result is a term or a formula
    # for infix operators: ``flat`` associates and is one node of many operands, ``left-flat`` is
    # one node only if grouped to the left (floating-point sums), ``left`` nests to the left,
    # ``none`` does not chain
    grouping: Grouping = "none"
    timed: bool = False  # whether an interval may follow the operator
    future: bool = False  # whether the value depends on later samples
    # whether the value depends on neighbouring samples, which dense time does not have
    sampled: bool = False
    # for predicates: +inf where they hold, -inf elsewhere; over a builder and registers
    holds: Meaning | None = None
    name: str = ""  # the key of the row; default: the first spelling

    def __post_init__(self) -> None:
        """Name the row and check that its fields fit together."""
        object.__setattr__(self, "name", self.name or self.symbol)
        infix = self.notation == "infix"
        well_formed = (
            (infix or self.grouping == "none")
            and (not infix or self.arity[0] == 2)
            and (self.notation != "prefix" or self.arity == (1, 1))
            and (not self.timed or (self.operands == "formula" and self.notation != "call"))
        )
        if not well_formed:
            msg = f"the row of {self.name} contradicts itself"
            raise AssertionError(msg)

    @property
    def symbol(self) -> str:
        """The canonical spelling."""
        return self.spellings[0]

    def __repr__(self) -> str:
        return f"<operator {self.name}>"


class OperatorTable(Mapping[str, Operator]):
    """The rows by name, with indexes over their spellings."""

    # (spelling, notation) to its row; ``-`` is a prefix and an infix operator
    spellings: Mapping[tuple[str, Notation], Operator]
    words: Mapping[str, Operator]  # spelling to its row, for the spellings that are words
    # words that cannot name a variable: keywords, ``true`` and ``false``, and operators (``G - 3``
    # would have two readings). Names of functions are free: a function needs a ``(`` after its
    # name
    reserved: frozenset[str]

    def __init__(self, rows: Iterable[Operator]) -> None:
        self.replace(rows)

    def replace(self, rows: Iterable[Operator]) -> None:
        """Make these the rows of the table, and check that no word has two meanings."""
        rows = tuple(rows)
        spellings = [((s, row.notation), row) for row in rows for s in row.spellings]
        words = [(s, row) for (s, _), row in spellings if s.isidentifier()]
        seen = Counter[object](row.name for row in rows)
        seen |= Counter([*KEYWORDS, *(word for word, _ in words)])
        seen |= Counter(key for key, _ in spellings)
        if twice := [str(key) for key, count in seen.items() if count > 1]:
            msg = f"expected one meaning for a word, got several for {', '.join(twice)}"
            raise AssertionError(msg)
        self._rows = {row.name: row for row in rows}
        self.spellings = dict(spellings)
        self.words = dict(words)
        self.reserved = KEYWORDS.union(s for s, row in words if row.notation != "call")

    def refusal(self, word: str) -> str:
        """Return why a word cannot name a variable; empty if it can."""
        if word not in self.reserved:
            return ""
        phrase = "a word of the language"
        row = self.words.get(word)
        if row is not None:
            phrase = "an operator" if word == row.symbol else f"the operator '{row.symbol}'"
        return f"'{word}' is {phrase} and cannot name a variable"

    def __getitem__(self, name: str) -> Operator:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)


# Meanings. ---------------------------------------------------------------------------------------


def _apply(function: str) -> Meaning:
    return lambda b, *operands: b.map(function, *operands)


def _swapped(function: str) -> Meaning:
    return lambda b, x, y: b.map(function, y, x)


def _chained(function: str) -> Meaning:
    def meaning(b: Builder, first: int, *others: int) -> int:
        for operand in others:
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
    """Return a function with the same name in the algebra."""
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
    """Return an operator that takes an interval."""
    precedence, operands = (7, 1) if notation == "prefix" else (6, 2)
    arity = (operands, operands)
    return Operator(spellings, notation, precedence, doc, meaning, arity, timed=True, future=future)


def _neighbour(spellings: tuple[str, ...], doc: str, offset: int, fold: str) -> Operator:
    """Return an operator of a neighbouring sample; outside the trace it is the fold's identity.

    The weak operator folds with min, so that its identity is +inf; the strong one with max (-inf).
    """
    return Operator(
        spellings,
        "prefix",
        7,
        doc,
        lambda b, p: b.window(fold, offset, offset, p),
        sampled=True,
        future=offset > 0,
    )


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
    _function("min", "the smallest of two or more terms", 2, None),
    _function("max", "the largest of two or more terms", 2, None),
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
