"""Formulas, traces and chunkings for the property tests; drawn from the table of operators.

A new row in `OPERATORS` is generated from the moment it is registered. If it is a function that
has no value everywhere, `_GUARDS` keeps its operands where it has one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import cast

from hypothesis import strategies as st

from rtamt.formula import Formula, Node, Term, make, number, variable
from rtamt.interval import Interval
from rtamt.operators import OPERATORS, Operator

Trace = dict[str, list[float]]
Draw = st.DrawFn

VARIABLES = ("a", "b", "c")
FORMULAS = tuple(name for name, row in OPERATORS.items() if row.operands == "formula")
ATOMS = tuple(
    n for n, row in OPERATORS.items() if (row.operands, row.result) == ("term", "formula")
)
TERMS = tuple(name for name, row in OPERATORS.items() if row.result == "term")
ENDLESS_FUTURE = frozenset(n for n, row in OPERATORS.items() if row.timed and row.future)

quarters = st.integers(-24, 24).map(lambda i: i / 4)
"""Numbers whose sums and differences are exact."""


@st.composite
def terms(draw: Draw, depth: int = 1, name: str | None = None) -> Term:
    """A term that has a value wherever its variables are finite; with an operator at its root."""
    if name is None:
        if depth == 0 or draw(st.integers(0, 2)) > 0:
            constant = draw(st.integers(0, 3)) == 0
            return (
                number(draw(quarters)) if constant else variable(draw(st.sampled_from(VARIABLES)))
            )
        name = draw(st.sampled_from(TERMS))
    row = OPERATORS[name]
    operands = tuple(draw(terms(depth=max(0, depth - 1))) for _ in range(draw(_arity(row))))
    guarded = _GUARDS[name](*operands) if name in _GUARDS else operands
    return cast("Term", make(name, guarded))


_GUARDS: Mapping[str, Callable[..., tuple[Node, ...]]] = {
    "sqrt": lambda x: (abs(x),),
    "exp": lambda x: (x.min(5),),
    "ln": lambda x: (abs(x) + 0.5,),
    "pow": lambda x, y: (abs(x) + 0.5, y.min(2)),
    "log": lambda x, base: (abs(x) + 0.5, abs(base) + 2),
    "/": lambda x, y: (x, abs(y) + 0.5),
}


@st.composite
def predicates(draw: Draw, *, total: bool = True) -> Formula:
    """Any atom; not ``total``: one that has a value at infinite samples too."""
    if not total:
        x, limit = variable(draw(st.sampled_from(VARIABLES))), number(draw(quarters))
        return cast("Formula", make(draw(st.sampled_from(("<", ">=", "==", "!="))), (x, limit)))
    return draw(rooted(draw(st.sampled_from(ATOMS))))


@st.composite
def intervals(draw: Draw, *, endless: bool) -> Interval | None:
    """Bounds of a few samples, points among them; ``endless``: without an end at times."""
    begin = draw(st.integers(0, 3))
    end = None if endless and draw(st.booleans()) else begin + draw(st.integers(0, 3))
    return Interval.of(begin, end)


@st.composite
def rooted(
    draw: Draw, name: str, depth: int = 0, *, endless: bool = False, total: bool = True
) -> Formula:
    """A formula with this operator at its root.

    Args:
        draw: Given by hypothesis.
        name: The operator.
        depth: Temporal and Boolean operators below the root.
        endless: Whether future operators may lack an end; those of the past may always.
        total: See `predicates`.
    """
    row = OPERATORS[name]
    if name in TERMS:
        return cast("Formula", make(">=", (draw(terms(2, name)), draw(terms(0)))))
    interval = None
    if row.timed:
        interval = draw(intervals(endless=endless or not row.future))
    args: list[Node] = []
    for _ in range(draw(_arity(row))):
        if row.operands == "term":
            args.append(draw(terms()))
        elif args and draw(st.integers(0, 5)) == 0:
            args.append(args[0])  # equal sub-formulas share one register
        else:
            args.append(draw(formulas(depth, endless=endless, total=total)))
    return cast("Formula", make(name, tuple(args), interval))


@st.composite
def formulas(draw: Draw, depth: int = 3, *, endless: bool = False, total: bool = True) -> Formula:
    """A formula of any operators, past and future."""
    if depth == 0 or draw(st.integers(0, 3)) == 0:
        return draw(predicates(total=total))
    name = draw(st.sampled_from(FORMULAS))
    return draw(rooted(name, depth - 1, endless=endless, total=total))


def _arity(row: Operator) -> st.SearchStrategy[int]:
    least, most = row.arity
    return st.integers(least, least + 1 if most is None else most)


@st.composite
def traces(
    draw: Draw, least: int = 1, most: int = 12, values: st.SearchStrategy[float] = quarters
) -> Trace:
    """Values of every variable at ``least`` to ``most`` samples."""
    n = draw(st.integers(least, most))
    return {v: draw(st.lists(values, min_size=n, max_size=n)) for v in VARIABLES}


infinities = st.one_of(quarters, st.sampled_from((math.inf, -math.inf)))
"""Values for predicates that are not ``total``: a difference of two of them may be nan."""


@st.composite
def chunkings(draw: Draw, n: int) -> list[slice]:
    """Consecutive slices, empty ones among them, that make up n samples."""
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=4)))
    return [slice(i, j) for i, j in zip([0, *cuts], [*cuts, n], strict=True)]


def length(trace: Trace) -> int:
    """Samples in a trace."""
    return len(trace[VARIABLES[0]])


def sample(trace: Trace, i: int, names: tuple[str, ...] = VARIABLES) -> dict[str, float]:
    """One sample of a trace, of the variables that a monitor has."""
    return {name: trace[name][i] for name in names}
