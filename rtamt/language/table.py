"""The table of operators: the fields of a row, and what follows from all rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

__all__ = ["KEYWORDS", "Bounds", "Builder", "Meaning", "Notation", "Operator", "OperatorTable"]

KEYWORDS = frozenset({"inf", "const", "input", "output", "specification", "from", "import"})
"""The words of statements, which the grammar itself knows; no operator is spelt like one."""

Bounds = tuple[int, int | None]
"""Bounds of an interval in samples; None is no upper bound."""


class Builder(Protocol):
    """Writes the instructions of a meaning; every method returns the register of a value."""

    def constant(self, value: float) -> int:
        """The same value at every sample, seen or not."""

    def map(self, function: str, *args: int) -> int:
        """The function of the operands' values now."""

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        """The fold over offsets lo to hi from now, cut to the trace; None is unbounded."""

    def rate(self, x: int) -> int:
        """The change per second of the variable in a register."""

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
        spellings: Every spelling that the parser takes; `str` prints the first.
        notation: ``op p``, ``p op q``, ``op(p, ...)``, or a formula without operands.
        precedence: Binding strength; higher binds tighter.
        doc: The robustness at sample i, in one line.
        meaning: The robustness, over a builder and the operands' registers (after the bounds).
        arity: Least and greatest number of operands; None is any.
        operands: Whether the operands are terms or formulas.
        result: Whether the whole is a term or a formula.
        grouping: For infix operators: ``flat`` associates and is one node of many operands,
            ``left-flat`` is one node only if grouped to the left (floating-point sums), ``left``
            nests to the left, ``none`` does not chain.
        timed: Whether an interval may follow the operator.
        future: Whether the value depends on later samples.
        sampled: Whether the value depends on neighbouring samples, which dense time does not have.
        holds: For predicates: +inf where they hold, -inf where not; over a builder and registers.
        name: The key of the row; the first spelling, unless given.
    """

    spellings: tuple[str, ...]
    notation: Notation
    precedence: int
    doc: str
    meaning: Meaning
    arity: tuple[int, int | None] = (1, 1)
    operands: Kind = "formula"
    result: Kind = "formula"
    grouping: Grouping = "none"
    timed: bool = False
    future: bool = False
    sampled: bool = False
    holds: Meaning | None = None
    name: str = ""

    def __post_init__(self) -> None:
        """Name the row, and check it against itself."""
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
    """Rows by name, and what follows from all of them.

    Attributes:
        spellings: (spelling, notation) to its row; ``-`` is a prefix and an infix operator.
        words: Spelling to its row, for the spellings that are words.
        reserved: Words that cannot name a variable: keywords, ``true`` and ``false``, and operators
            (``G - 3`` would have two readings). The name of a function can: it is a function only
            where ``(`` follows.
    """

    spellings: Mapping[tuple[str, Notation], Operator]
    words: Mapping[str, Operator]
    reserved: frozenset[str]

    def __init__(self, rows: Iterable[Operator]) -> None:
        self.replace(rows)

    def replace(self, rows: Iterable[Operator]) -> None:
        """Make these the rows of the table.

        Raises:
            AssertionError: If two rows have the same name, the same word, or the same symbol in the
                same notation, or a row has a keyword.
        """
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
        """Why a word cannot name a variable; nothing if it can."""
        if word not in self.reserved:
            return ""
        what = "a word of the language"
        row = self.words.get(word)
        if row is not None:
            what = "an operator" if word == row.symbol else f"the operator '{row.symbol}'"
        return f"'{word}' is {what} and cannot name a variable"

    def __getitem__(self, name: str) -> Operator:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
