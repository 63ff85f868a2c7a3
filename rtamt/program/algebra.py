"""What the instructions compute: functions of doubles, and the lattice folds of windows.

Both are tables; the C++ machines know the same names.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["FOLDS", "FUNCTIONS", "Arrays", "Element", "Function", "LatticeFold"]

INF = math.inf


@dataclass(frozen=True, slots=True)
class Function:
    """A total function on doubles, known by the same name to the C++ machine."""

    name: str
    arity: int
    apply: Callable[..., float]


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
    except (
        OverflowError,
        ValueError,
    ):  # where math raises, IEEE has a value: let numpy say it
        with np.errstate(all="ignore"):
            return float(np.power(x, y))


def _log(x: float, base: float) -> float:
    return _div(_ln(x), _ln(base))


# min and max keep a nan of either side: `a if a <= b else b` alone would lose one of them.
def _min(x: float, y: float) -> float:
    return x if x <= y or x != x else y  # noqa: PLR0124


def _max(x: float, y: float) -> float:
    return x if x >= y or x != x else y  # noqa: PLR0124


def _holds(comparison: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    def holds(x: float, y: float) -> float:
        if x != x or y != y:  # noqa: PLR0124
            return math.nan
        return INF if comparison(x, y) else -INF

    return holds


FUNCTIONS: Mapping[str, Function] = {
    f.name: f
    for f in (
        Function("neg", 1, operator.neg),
        Function("abs", 1, abs),
        Function("sqrt", 1, _sqrt),
        Function("exp", 1, _exp),
        Function("ln", 1, _ln),
        Function("add", 2, operator.add),
        Function("sub", 2, operator.sub),
        Function("mul", 2, operator.mul),
        Function("div", 2, _div),
        Function("pow", 2, _pow),
        Function("log", 2, _log),
        Function("min", 2, _min),
        Function("max", 2, _max),
        # Whether a comparison holds, as +inf or -inf.
        Function("ge", 2, _holds(operator.ge)),
        Function("gt", 2, _holds(operator.gt)),
        Function("eq", 2, _holds(operator.eq)),
        Function("ne", 2, _holds(operator.ne)),
    )
}


Element = tuple[float, ...]
Arrays = tuple[NDArray[np.float64], ...]
_X = TypeVar("_X")
_Lattice = Callable[[_X, _X], _X]
_Combine = Callable[[tuple[_X, ...], tuple[_X, ...]], tuple[_X, ...]]


@dataclass(frozen=True, slots=True)
class LatticeFold:
    """An associative fold with identity. The older element stands left.

    Attributes:
        width: Numbers in an element; the last one is the result.
        mirror: The same fold with time flipped.
        dual: The same fold with the order of the reals flipped: the fold under a negation.
        combine: The fold of two elements.
        combine_arrays: The same, number by number of arrays.
    """

    name: str
    width: int
    identity: Element
    mirror: str
    dual: str
    combine: _Combine[float]
    combine_arrays: _Combine[NDArray[np.float64]]

    def __post_init__(self) -> None:
        """Check identity and associativity where the row is made."""
        elements = list(itertools.product((-INF, 0.0, 1.0), repeat=self.width))
        fold = self.combine
        for x in elements:
            if not fold(self.identity, x) == x == fold(x, self.identity):
                msg = f"{self.identity} is no identity of {self.name}"
                raise AssertionError(msg)
        for x, y, z in itertools.product(elements[::2], repeat=3):
            if fold(fold(x, y), z) != fold(x, fold(y, z)):
                msg = f"{self.name} is not associative"
                raise AssertionError(msg)


def _least(lo: Callable[..., Any], _hi: object) -> _Combine[Any]:
    if lo is min:  # a comparison is faster than a call of min
        return lambda x, y: x if x[0] <= y[0] else y
    if lo is max:
        return lambda x, y: x if x[0] >= y[0] else y
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
    lo, hi = np.minimum, np.maximum
    (name, dual), width = names, len(identity)
    return (
        LatticeFold(name, width, identity, mirrors[0], dual, fold(min, max), fold(lo, hi)),
        LatticeFold(dual, width, opposite, mirrors[1], name, fold(max, min), fold(hi, lo)),
    )


FOLDS: Mapping[str, LatticeFold] = {
    m.name: m
    for m in (
        *_pair_of_duals(_least, (INF,), ("min", "max"), ("min", "max")),
        *_pair_of_duals(_until, (INF, -INF), ("until", "release"), ("since", "trigger")),
        *_pair_of_duals(_since, (INF, -INF), ("since", "trigger"), ("until", "release")),
    )
}
