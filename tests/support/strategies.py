"""Formulas, traces and chunkings for the property tests, from the table of operators.

A new row in `OPERATORS` is drawn too. If it is a partial function, `_GUARDS` keeps its operands in
its domain.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import cast

from hypothesis import strategies as st

from rtamt import Formula, Interval, Term, number, variable
from rtamt.language.formula import make
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS, Operator

Trace = dict[str, list[float]]
Draw = st.DrawFn

VARIABLES = ("a", "b", "c")
TERMS = tuple(name for name, row in OPERATORS.items() if row.result == "term")
FORMULAS = tuple(name for name, row in OPERATORS.items() if row.operands == "formula")
DENSE = tuple(name for name in FORMULAS if not OPERATORS[name].sampled)
ATOMS = tuple(name for name in OPERATORS if name not in (*TERMS, *FORMULAS))

QUARTERS = tuple(sign * i / 4 for i in range(25) for sign in (1, -1))
"""Numbers with exact sums and differences, the simplest first."""

INTEGERS = (0.0, 0.0, 0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 3.0, 1.0, -1.0)
"""Numbers with many differences of 0."""

INFINITIES = (*QUARTERS, math.inf, -math.inf)
"""Values for atoms that are not ``total``: a difference of two of them may be nan."""

# Create strategies once: their creation is the largest cost of drawing.
_leaf = st.sampled_from([variable(name) for name in VARIABLES] * 3 + [None])
_quarter = st.sampled_from(QUARTERS).map(number)
# Dense time, arrays, checks and exported monitors draw terms too, and do not support rates.
_drawn = tuple(name for name in TERMS if name != "rate")
_term_name = st.sampled_from((None,) * 2 * len(_drawn) + _drawn)
_atom_name = st.sampled_from(ATOMS)
_formula_name = st.sampled_from((None,) * (len(FORMULAS) // 3) + FORMULAS)
_dense_name = st.sampled_from((None,) * (len(DENSE) // 3) + DENSE)
_comparison = st.sampled_from(("<", ">=", "==", "!="))
_small = st.integers(0, 3)
_once_in_six = st.sampled_from((False,) * 5 + (True,))


@functools.cache
@st.composite
def terms(draw: Draw, depth: int = 1, name: str | None = None) -> Term:
    """Terms that have a value for all finite variables; with an operator at the root."""
    name = name or (draw(_term_name) if depth else None)
    if name is None:
        return draw(_leaf) or draw(_quarter)
    operand = terms(max(0, depth - 1))
    operands = tuple(draw(operand) for _ in range(draw(_arity(name))))
    guarded = _GUARDS[name](*operands) if name in _GUARDS else operands
    return cast("Term", make(name, guarded))


_GUARDS: Mapping[str, Callable[..., tuple[Node, ...]]] = {
    "sqrt": lambda x: (abs(x),),
    "exp": lambda x: (x.min(5),),
    "ln": lambda x: (abs(x) + 0.5,),
    "pow": lambda x, y: (abs(x) + 0.5, y.min(2)),
    "log": lambda x, base: (abs(x) + 0.5, abs(base) + 2),
    "/": lambda x, y: (x, abs(y) + 0.5),
    "rate": lambda x: (variable("a"),),  # noqa: ARG005
}


@functools.cache
@st.composite
def intervals(draw: Draw, *, endless: bool) -> Interval | None:
    """Bounds of a few samples, also points; with ``endless``, sometimes unbounded."""
    begin, width = draw(_small), draw(_small)
    return Interval.of(begin, None if endless and draw(st.booleans()) else begin + width)


@functools.cache
@st.composite
def rooted(
    draw: Draw,
    name: str,
    depth: int = 0,
    *,
    endless: bool = False,
    total: bool = True,
    dense: bool = False,
) -> Formula:
    """Formulas with this operator at the root, or in the term on the left of the root.

    Args:
        draw: The function of hypothesis.
        name: The operator.
        depth: Temporal and Boolean operators below the root.
        endless: Whether future operators may be unbounded; past operators always may.
        total: See `formulas`.
        dense: See `formulas`.
    """
    row = OPERATORS[name]
    if name in TERMS:
        return cast("Formula", make(">=", (draw(terms(2, name)), draw(terms(0)))))
    interval = draw(intervals(endless=endless or not row.future)) if row.timed else None
    below = formulas(depth, endless=endless, total=total, dense=dense)
    operand = terms() if row.operands == "term" else below
    args: list[Node] = []
    for _ in range(draw(_arity(name))):
        # Equal sub-formulas share one register.
        args.append(args[0] if args and draw(_once_in_six) else draw(operand))
    return cast("Formula", make(name, tuple(args), interval))


@functools.cache
@st.composite
def formulas(
    draw: Draw,
    depth: int = 3,
    *,
    endless: bool = False,
    total: bool = True,
    dense: bool = False,
) -> Formula:
    """Formulas of any operators, past and future.

    Args:
        draw: The function of hypothesis.
        depth: The maximum number of temporal and Boolean operators on a path.
        endless: Whether future operators may be unbounded; past operators always may.
        total: Whether atoms may be differences, which infinite samples can make nan.
        dense: Whether to draw only operators that are defined in dense time.
    """
    name = draw(_dense_name if dense else _formula_name) if depth else None
    if name is not None:
        return draw(rooted(name, depth - 1, endless=endless, total=total, dense=dense))
    if total:
        return draw(rooted(draw(_atom_name)))
    return cast("Formula", make(draw(_comparison), (draw(terms(0)), draw(_quarter))))


@functools.cache
def _arity(name: str) -> st.SearchStrategy[int]:
    row: Operator = OPERATORS[name]
    least, most = row.arity
    return st.integers(least, least + 1 if most is None else most)


@functools.cache
@st.composite
def traces(draw: Draw, least: int = 1, most: int = 12, values: Sequence[float] = QUARTERS) -> Trace:
    """Values of every variable at ``least`` to ``most`` samples."""
    n = draw(st.integers(least, most))
    drawn = draw(st.binary(min_size=n * len(VARIABLES), max_size=n * len(VARIABLES)))
    column = [values[byte % len(values)] for byte in drawn]
    return {name: column[i :: len(VARIABLES)] for i, name in enumerate(VARIABLES)}


@functools.cache
@st.composite
def chunkings(draw: Draw, n: int) -> list[slice]:
    """Consecutive slices of n samples, also empty ones."""
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=4)))
    return [slice(i, j) for i, j in zip([0, *cuts], [*cuts, n], strict=True)]


def length(trace: Trace) -> int:
    """Return the number of samples in a trace."""
    return len(trace[VARIABLES[0]])


def sample(trace: Trace, i: int, names: tuple[str, ...] = VARIABLES) -> dict[str, float]:
    """Return one sample of a trace, of the variables of a monitor."""
    return {name: trace[name][i] for name in names}
