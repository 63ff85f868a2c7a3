"""Two tables of the functions of instructions: on doubles, and lattice folds of windows.

The sign bit of a robustness is clear if the formula holds, at 0 too. Min and max therefore order
-0.0 below 0.0, and the margins of predicates choose between the two zeros. The C++ machines have
functions and folds of the same names.

To add a function, see `rtamt.language.operators`.

To add a fold over a window: a row of `FOLDS`, the same fold in ``rtamt/native/core/folds.hpp``, and
a row of `rtamt.language.operators` that uses it. `rtamt_arrays` makes its folds from these rows.

Every row must be a lattice fold, which chooses among the numbers of the operands by min and max
alone. The machines rely on its laws, and ``tests/rtamt/program/test_algebra.py`` checks each row:

* It is idempotent: over dense time a step counts once, however long it lasts.
* It chooses one of the numbers and acts on each threshold separately: episodes fold the bounds of
  operands, and explanations name the sample with the chosen value.
* It has an identity, which stands for times outside the trace.
* It is associative: machines fold windows in blocks.
* Its dual negates the result for negated operands: negations move down to the predicates.
* Its mirror is the same fold with time flipped: unbounded futures are folded backwards.

Sum, mean and AGM robustness cannot be rows: a sum is not idempotent, and a mean makes numbers that
no operand has. They need a fifth instruction in `rtamt.program.instructions`, ``AVERAGE lo hi``,
and other functions than min and max for ``and`` and ``or``. mypy then lists each ``match`` with
``assert_never`` that must run or refuse it. Search for ``isinstance`` and ``case`` with `Window`
too, and for ``Opcode`` in ``rtamt/native``. `lattice_of` in `rtamt_arrays.offline`, for
``semantics="smooth"``, is the only semantics with other means so far.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rtamt.program.intervals import (
    IntervalRule,
    corners,
    even,
    logarithm,
    meeting,
    monotone,
    near,
    opposite,
    power,
    quotient,
)

INF = math.inf


@dataclass(frozen=True, slots=True)
class Function:
    """A total function on doubles, under the same name as in C++."""

    name: str
    arity: int
    apply: Callable[..., float]  # the function
    rule: IntervalRule  # its values for unknown operands; see `rtamt.program.intervals`


def _div(x: float, y: float) -> float:
    if y:
        return x / y
    if x == 0.0 or x != x:  # noqa: PLR0124 - nan is the one value that differs from itself
        return math.nan
    return math.copysign(INF, x) * math.copysign(1.0, y)


def _sqrt(x: float) -> float:
    return math.sqrt(x) if x >= 0.0 else math.nan


def _exp(x: float) -> float:
    try:
        return math.exp(x)
    except OverflowError:
        return INF


def _ln(x: float) -> float:
    if x > 0.0:
        return math.log(x)
    return -INF if x == 0.0 else math.nan


def _pow(x: float, y: float) -> float:
    try:
        return math.pow(x, y)
    except (OverflowError, ValueError):  # numpy gives the value that IEEE 754 has there
        with np.errstate(all="ignore"):
            return float(np.power(x, y))


def _log(x: float, base: float) -> float:
    return _div(_ln(x), _ln(base))


# Both return one operand: the first of two equal ones, nan if either is nan.
def _min(x: float, y: float) -> float:
    if x < y or x != x:  # noqa: PLR0124
        return x
    return x if x == y and (x or _negative(x) or not _negative(y)) else y


def _max(x: float, y: float) -> float:
    if x > y or x != x:  # noqa: PLR0124
        return x
    return y if x != y or (not x and _negative(x) and not _negative(y)) else x


def _negative(zero: float) -> bool:
    """Return whether a zero is -0.0."""
    return math.copysign(1.0, zero) < 0.0


# The margins of predicates. The difference of -0.0 and 0.0 is -0.0; adding 0.0 makes it 0.0.
def _at_least(x: float, y: float) -> float:
    return (x - y) + 0.0


def _above(x: float, y: float) -> float:
    return -((y - x) + 0.0)


def _equal(x: float, y: float) -> float:
    return -abs(x - y) + 0.0


def _unequal(x: float, y: float) -> float:
    return -(-abs(x - y) + 0.0)


def _holds(comparison: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    def holds(x: float, y: float) -> float:
        if x != x or y != y:  # noqa: PLR0124
            return math.nan
        return INF if comparison(x, y) else -INF

    return holds


FUNCTIONS: Mapping[str, Function] = {
    f.name: f
    for f in (
        Function("neg", 1, operator.neg, monotone("-")),
        Function("abs", 1, abs, even),
        Function("sqrt", 1, _sqrt, monotone("+", least=-0.0)),
        Function("exp", 1, _exp, monotone("+", wider=True)),
        Function("ln", 1, _ln, monotone("+", least=-0.0, wider=True)),
        Function("add", 2, operator.add, monotone("++")),
        Function("sub", 2, operator.sub, monotone("+-")),
        Function("mul", 2, operator.mul, corners),
        Function("div", 2, _div, quotient),
        Function("pow", 2, _pow, power),
        Function("log", 2, _log, logarithm(_ln, _div)),
        Function("min", 2, _min, monotone("++")),
        Function("max", 2, _max, monotone("++")),
        # By how much a comparison holds: 0.0 if it just does, -0.0 if it just does not.
        Function("at_least", 2, _at_least, monotone("+-")),
        Function("above", 2, _above, monotone("+-")),
        Function("equal", 2, _equal, near),
        Function("unequal", 2, _unequal, opposite(near)),
        Function("nonnegative", 1, lambda x: x + 0.0, monotone("+")),
        # Whether a comparison holds, as +inf or -inf.
        Function("ge", 2, _holds(operator.ge), monotone("+-")),
        Function("gt", 2, _holds(operator.gt), monotone("+-")),
        Function("eq", 2, _holds(operator.eq), meeting),
        Function("ne", 2, _holds(operator.ne), opposite(meeting)),
    )
}


# min and max of arrays without nan.
def lesser(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smaller numbers of two arrays."""
    either = np.where(y < x, y, x).view(np.int64) | np.where(x < y, x, y).view(np.int64)
    return either.view(np.float64)


def greater(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the larger numbers of two arrays."""
    both = np.where(y > x, y, x).view(np.int64) & np.where(x > y, x, y).view(np.int64)
    return both.view(np.float64)


def ordered(numbers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return integers in the order of the numbers, -0.0 below 0.0."""
    bits = numbers.view(np.int64)
    return bits ^ ((bits >> 63) & np.iinfo(np.int64).max)


Element = tuple[float, ...]
Arrays = tuple[NDArray[np.float64], ...]
_X = TypeVar("_X")
_Lattice = Callable[[_X, _X], _X]
_Combine = Callable[[tuple[_X, ...], tuple[_X, ...]], tuple[_X, ...]]


@dataclass(frozen=True, slots=True)
class LatticeFold:
    """A fold of a window's elements by min and max alone; the older element is on the left.

    An element is the operands' numbers at one time. The top of this module lists the laws.
    """

    name: str
    width: int  # numbers in an element; the last one is the result
    identity: Element
    mirror: str  # the same fold with time flipped
    dual: str  # the same fold with min and max exchanged, for negated operands
    combine: _Combine[float]  # the fold of two elements
    combine_arrays: _Combine[NDArray[np.float64]]  # the fold of two elements with arrays as numbers
    # returns this fold with other functions in place of min and max
    made: Callable[[_Lattice[Any], _Lattice[Any]], _Combine[Any]]


def _least(lo: _Lattice[_X], _hi: object) -> _Combine[_X]:
    return lambda x, y: (lo(x[0], y[0]),)


def _until(lo: _Lattice[_X], hi: _Lattice[_X]) -> _Combine[_X]:
    # (p, q) of a stretch of time: p holds throughout it; q is reached while p has held before.
    return lambda x, y: (lo(x[0], y[0]), hi(x[1], lo(x[0], y[1])))


def _since(lo: _Lattice[_X], hi: _Lattice[_X]) -> _Combine[_X]:
    # Mirrored: q was reached, and p has held ever since.
    return lambda x, y: (lo(x[0], y[0]), hi(y[1], lo(y[0], x[1])))


def _pair_of_duals(
    fold: Callable[..., Any], identity: Element, names: tuple[str, str], mirrors: tuple[str, str]
) -> tuple[LatticeFold, LatticeFold]:
    opposite = tuple(-x for x in identity)
    lo, hi = lesser, greater
    (name, dual), width = names, len(identity)
    return (
        LatticeFold(name, width, identity, mirrors[0], dual, fold(_min, _max), fold(lo, hi), fold),
        LatticeFold(
            dual,
            width,
            opposite,
            mirrors[1],
            name,
            fold(_max, _min),
            fold(hi, lo),
            lambda lesser, greater: fold(greater, lesser),
        ),
    )


FOLDS: Mapping[str, LatticeFold] = {
    fold.name: fold
    for fold in (
        *_pair_of_duals(_least, (INF,), ("min", "max"), ("min", "max")),
        *_pair_of_duals(_until, (INF, -INF), ("until", "release"), ("since", "trigger")),
        *_pair_of_duals(_since, (INF, -INF), ("since", "trigger"), ("until", "release")),
    )
}
