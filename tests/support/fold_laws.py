"""The laws that the machines rely on for each lattice fold, checked on a few numbers."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from rtamt.program.algebra import Arrays, Element, LatticeFold, ordered

INF = np.inf
ENDS = np.array([-INF, INF])
NUMBERS = np.array([2.0, 3.0, -1.0, -0.0, 0.0, *ENDS])


def broken_law(fold: LatticeFold) -> str | None:
    """Return the first law that a fold breaks, or None if it is a lattice fold."""
    with np.errstate(all="ignore"):
        return _broken_law(fold)


def _broken_law(row: LatticeFold) -> str | None:
    fold = row.combine_arrays
    x, y = _elements(NUMBERS, row.width, 2)
    twice, both = fold(x, x), fold(x, y)
    for i in _differences(twice, x):
        return f"it is not idempotent (of {_text(x, i)} twice it makes {_text(twice, i)})"
    operands = np.array([ordered(a) for a in (*x, *y)])
    new = [np.all(operands != ordered(number), axis=0) for number in both]
    laws = {
        "choose among the numbers of its elements": np.flatnonzero(np.any(new, axis=0)),
        "act on each threshold by itself": _differences(
            _reached(both), fold(_reached(x), _reached(y))
        ),
    }
    for law, places in laws.items():
        for i in places:
            example = f"of {_text(x, i)} and {_text(y, i)} it makes {_text(both, i)}"
            return f"it does not {law} ({example})"
    step = 1 + len(x[0]) // 200
    some = [tuple(a[::step] for a in arrays) for arrays in (x, y, both)]
    scalar = [row.combine(*pair) for pair in zip(*map(_rows, some[:2]), strict=True)]
    if _differences(tuple(np.array(scalar, dtype=np.float64).T.copy()), some[2]):
        return "combine and combine_arrays differ"
    # A fold that acts on each threshold by itself is determined by its results at -inf and +inf.
    x, y, z = _elements(ENDS, row.width, 3)
    identity = tuple(np.full_like(x[0], e) for e in row.identity)
    if _differences(fold(identity, x), x) or _differences(fold(x, identity), x):
        return f"{row.identity} is not its identity"
    if _differences(fold(fold(x, y), z), fold(x, fold(y, z))):
        return "it is not associative"
    return None


def broken_relation(rows: Iterable[LatticeFold]) -> str | None:
    """Return the first dual or mirror in a table that is wrong, or None."""
    table = {row.name: row for row in rows}
    for row in table.values():
        dual, mirror = table[row.dual], table[row.mirror]
        x, y = _elements(ENDS, row.width, 2)
        both = row.combine_arrays(x, y)
        if _differences(_negated(both), dual.combine_arrays(_negated(x), _negated(y))):
            return f"'{row.dual}' is not the dual of '{row.name}'"
        if _differences(both, mirror.combine_arrays(y, x)):
            return f"'{row.mirror}' is not the mirror of '{row.name}'"
        # An episode machine has one unknown for the fold of all future samples.
        if not any(reads_one_number(fold) for fold in (row, mirror)):
            return (
                f"'{row.name}' and its mirror read more than the last number of a younger element"
            )
    return None


def reads_one_number(fold: LatticeFold) -> bool:
    """Return whether the result reads only the last number of the younger element."""
    x, y = _elements(ENDS, fold.width, 2)
    *others, last = y
    alone = (*(np.full_like(a, e) for a, e in zip(others, fold.identity, strict=False)), last)
    combine = fold.combine_arrays
    return not _differences(combine(x, y)[-1:], combine(x, alone)[-1:])


def _elements(numbers: NDArray[np.float64], width: int, count: int) -> list[Arrays]:
    """Return all choices of ``count`` elements of these numbers."""
    shape = (len(numbers),) * (width * count)
    table = numbers[np.indices(shape).reshape(count, width, -1)]
    return [tuple(element) for element in table]


def _reached(x: Arrays) -> Arrays:
    """Return whether each number reaches each threshold, as +inf or -inf."""
    thresholds = ordered(NUMBERS)[:, None]
    return tuple(np.where(ordered(a) >= thresholds, INF, -INF) for a in x)


def _differences(x: Arrays, y: Arrays) -> Sequence[int]:
    """Return the indices at which elements differ, also 0.0 and -0.0."""
    different = [ordered(a) != ordered(b) for a, b in zip(x, y, strict=True)]
    return list(np.nonzero(np.any(different, axis=0))[-1])


def _negated(x: Arrays) -> Arrays:
    return tuple(-a for a in x)


def _rows(x: Arrays) -> list[Element]:
    return list(zip(*(a.tolist() for a in x), strict=True))


def _text(x: Arrays, i: int) -> str:
    numbers = _rows(x)[i]
    return str(numbers if len(numbers) > 1 else numbers[0])
