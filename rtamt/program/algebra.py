"""The functions of instructions: on doubles with their ranges, and lattice folds of windows.

The sign bit of a robustness is clear if the formula holds, at 0 too. Min and max therefore order
-0.0 below 0.0, and the margins of predicates choose between the two zeros. The C++ machines have
functions and folds of the same names.

The first part is interval arithmetic: the values of a function of unknown operands. The rules take
the smallest and the largest value of each operand, with -0.0 below 0.0, so bounds keep the sign
bit. Each row of `FUNCTIONS` names its rule; `everything` is right for all of them. The C++ machines
have the same rules in ``core/intervals.hpp`` and the same bounds, bit for bit. Operands without a
value, such as -1 of a square root, are left out. An end that is not a number, such as inf - inf,
makes the range everything.

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
and other functions than min and max for ``and`` and ``or``. mypy then lists each ``match`` that
must run or refuse it, because the match statements of `rtamt.program`, `rtamt.machines`,
`rtamt.monitors` and `rtamt_arrays` name every kind (``exhaustive-match`` in ``pyproject.toml``). It
cannot list ``isinstance`` with `Map` or `Window`: search for these in `rtamt` and `rtamt_arrays`
too. In ``rtamt/native``, search for ``Opcode``, ``RTAMT_KINDS``, ``"WINDOW"`` and ``"MAP"``: the
machines of episodes and of dense time and the FMUs compare names. Means for ``and`` and ``or`` are
rows of `FUNCTIONS` and a semantics in `rtamt.program.interface`. Define the average again in
``oracle.py``, ``region_oracle.py`` and ``dense_oracle.py`` of ``tests/support``, and describe it in
``docs/language.md`` and ``docs/stl.md``. `lattice_of` in `rtamt_arrays.offline`, for
``semantics="smooth"``, is the only semantics with other means so far.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

INF = math.inf
Ends = tuple[float, float]
"""The smallest and the largest value."""

EVERYTHING: Ends = (-INF, INF)


class Range(NamedTuple):
    """The possible values of a term."""

    lower: float  # the smallest one
    upper: float  # the largest one
    known: bool = False  # whether the term reads no unknown sample, so that both are its value


def of_ends(lower: float, upper: float) -> Range:
    """Return the range of a variable, which is known if its ends are the same to the bit."""
    same = lower == upper and math.copysign(1.0, lower) == math.copysign(1.0, upper)
    return Range(lower, upper, same)


_Apply = Callable[..., float]
IntervalRule = Callable[..., Ends | None]
"""Takes the function and the range of each operand; None if the function has no value there."""


def range_of(apply: _Apply, rule: IntervalRule, *operands: Range) -> Range | None:
    """Return the values of a function; None without a value, or if known operands give nan."""
    if all(operand.known for operand in operands):
        value = apply(*(operand.lower for operand in operands))
        return None if value != value else Range(value, value, known=True)  # noqa: PLR0124 - nan
    ends = rule(apply, *operands)
    return None if ends is None else Range(*ends)


def everything(apply: _Apply, *operands: Range) -> Ends:  # noqa: ARG001 - it is a rule
    """Return the rule of a function about which nothing is known."""
    return EVERYTHING


def monotone(directions: str, *, least: float = -INF, wider: bool = False) -> IntervalRule:
    """Return the rule of a function that rises (``+``) or falls (``-``) with each operand."""

    def rule(apply: _Apply, *operands: Range) -> Ends | None:
        low, high = [], []
        for direction, operand in zip(directions, operands, strict=True):
            if operand.upper < least:
                return None
            ends = _largest((operand.lower, least)), operand.upper
            low.append(ends[direction == "-"])
            high.append(ends[direction == "+"])
        hull = _hull((apply(*low), apply(*high)))
        return _outward(hull) if wider else hull

    return rule


def even(apply: _Apply, x: Range) -> Ends:
    """Return the rule of the absolute value."""
    ends = apply(x.lower), apply(x.upper)
    spans = _negative(x.lower) and not _negative(x.upper)
    return 0.0 if spans else _smallest(ends), _largest(ends)


def corners(apply: _Apply, *operands: Range) -> Ends:
    """Return the rule of a function that is monotone in each operand, up or down."""
    return _hull(apply(*values) for values in itertools.product(*(o[:2] for o in operands)))


def quotient(apply: _Apply, x: Range, y: Range) -> Ends:
    """Return the rule of a division: everything if an unknown divisor may be 0."""
    if not y.known and y.lower <= 0.0 <= y.upper:
        return EVERYTHING
    return corners(apply, x, y)


def near(apply: _Apply, x: Range, y: Range) -> Ends:  # noqa: ARG001 - it is a rule
    """Return the rule of ``-abs(x - y)``, which is 0.0 where both are equal."""
    lower, upper = _hull((x.lower - y.upper, x.upper - y.lower))
    far = max(abs(lower), abs(upper))
    close = 0.0 if lower <= 0.0 <= upper else min(abs(lower), abs(upper))
    return 0.0 - far, 0.0 - close


def meeting(apply: _Apply, x: Range, y: Range) -> Ends:  # noqa: ARG001 - it is a rule
    """Return the rule of ``x == y`` without a margin."""
    always = x.lower == x.upper == y.lower == y.upper
    ever = x.lower <= y.upper and y.lower <= x.upper
    return INF if always else -INF, INF if ever else -INF


def opposite(rule: IntervalRule) -> IntervalRule:
    """Return the rule of the function with the other sign."""

    def negated(apply: _Apply, *operands: Range) -> Ends | None:
        ends = rule(apply, *operands)
        return None if ends is None else (-ends[1], -ends[0])

    return negated


def power(apply: _Apply, x: Range, y: Range) -> Ends | None:
    """Return the rule of ``pow``: everything, unless it is monotone in both operands."""
    if _negative(x.lower):
        if x.lower > -INF and not _has_whole(y):  # a negative base has no such power
            if x.upper < 0.0:
                return None
            x = Range(0.0, x.upper + 0.0)
        elif not _is_monotone_power(x, y):
            return EVERYTHING
    return _outward(corners(apply, x, y))


def _has_whole(y: Range) -> bool:
    """Return whether a whole number lies in a range; both infinities count as whole."""
    if math.isinf(y.lower) or math.isinf(y.upper):
        return True
    return math.ceil(y.lower) <= y.upper


def _is_monotone_power(x: Range, y: Range) -> bool:
    """Return whether a power is monotone on a range with negative bases or -0.0."""
    n = y.lower
    if n != y.upper or not _has_whole(y):
        return False
    if not math.isinf(n) and math.fmod(n, 2.0) != 0.0:
        return n > 0.0 or _negative(x.upper)  # an odd one jumps at 0 if it is negative
    return n == 0.0 or x.upper <= 0.0 or x.lower >= 0.0


def logarithm(ln: Callable[[float], float], div: Callable[[float, float], float]) -> IntervalRule:
    """Return the rule of ``log``, a quotient of two natural logarithms."""
    logarithm_of = functools.partial(monotone("+", least=-0.0), ln)

    def rule(apply: _Apply, x: Range, base: Range) -> Ends | None:  # noqa: ARG001 - it is a rule
        over, under = logarithm_of(x), logarithm_of(base)
        if over is None or under is None:
            return None
        if not base.known and under[0] <= 0.0 <= under[1]:
            return EVERYTHING
        exact = corners(div, Range(*over), Range(*under))
        # A step of the logarithm may be larger than a step of the quotient.
        under = under if base.known else _outward(under)
        stepped = corners(div, Range(*_outward(over)), Range(*under))
        return _hull((*_outward(exact), *stepped))

    return rule


def _hull(values: Iterable[float]) -> Ends:
    """Return the smallest and the largest of some numbers; everything if one is nan."""
    numbers = list(values)
    return EVERYTHING if any(map(math.isnan, numbers)) else (_smallest(numbers), _largest(numbers))


def _outward(ends: Ends) -> Ends:
    """Return the range with each end one step further, but never of the other sign."""
    lower, upper = ends
    if lower != 0.0 or _negative(lower):
        lower = math.nextafter(lower, -INF)
    if upper != 0.0 or not _negative(upper):
        upper = math.nextafter(upper, INF)
    return lower, upper


def _order(x: float) -> tuple[float, float]:
    return x, math.copysign(1.0, x)


def _smallest(values: Iterable[float]) -> float:
    return min(values, key=_order)


def _largest(values: Iterable[float]) -> float:
    return max(values, key=_order)


def _negative(x: float) -> bool:
    """Return whether the sign bit is set, also of -0.0."""
    return math.copysign(1.0, x) < 0.0


@dataclass(frozen=True, slots=True)
class Function:
    """A total function on doubles, under the same name as in C++."""

    name: str
    arity: int
    apply: Callable[..., float]
    rule: IntervalRule  # its values for unknown operands; see `everything`


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
