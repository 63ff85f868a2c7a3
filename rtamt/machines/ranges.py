"""The values that the terms of a program can have on samples that are not known, or not exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NoReturn, Protocol

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.program.program import Program
from rtamt.program.ranges import of_ends, ranges_of

__all__ = ["FindRanges", "RefusesRanges", "term_ranges"]

FloatColumns = Sequence[Floats]


class RefusesRanges(Protocol):
    """Raises the error of a term without a value."""

    def refuse_between(
        self, lower: Iterable[float], upper: Iterable[float], sample: int
    ) -> NoReturn: ...


FindRanges = Callable[
    [Program, RefusesRanges, Sequence[int], FloatColumns, FloatColumns, int],
    tuple[list[Floats], list[Floats]],
]


def term_ranges(
    program: Program,
    reader: RefusesRanges,
    observed: Sequence[int],
    lower: FloatColumns,
    upper: FloatColumns,
    n: int,
) -> tuple[list[Floats], list[Floats]]:
    """The least and the greatest values of some terms at each of n samples.

    Args:
        program: A program of terms alone.
        reader: Raises the error of a term without a value.
        observed: The registers of the terms.
        lower: For every variable its n least values.
        upper: For every variable its n greatest values; it is known where both are the same.
        n: How many samples.

    Raises:
        InputError: If a term has no value.
    """
    least, greatest = np.empty((2, len(observed), n))
    for i in range(n):
        ends = [(float(a[i]), float(b[i])) for a, b in zip(lower, upper, strict=True)]
        found = ranges_of(program, [of_ends(*each) for each in ends])
        if len(found) < program.terms:
            reader.refuse_between((e[0] for e in ends), (e[1] for e in ends), i)
        for k, register in enumerate(observed):
            least[k, i], greatest[k, i] = found[register][:2]
    return list(least), list(greatest)
