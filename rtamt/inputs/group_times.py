"""The period of each group of a table, from its column of times."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt.columns import unit_of_times
from rtamt.errors import InputError, no_such
from rtamt.inputs.arrays import line_of_numbers
from rtamt.inputs.groups import Groups
from rtamt.language.interval import UNITS
from rtamt.program.timing import simplest

_NEAR = Fraction(1, 20)
"""The part of the period by which a sample may lie off the even times."""


def seconds_of(table: Mapping[str, Any], name: str) -> NDArray[np.float64]:
    """Return a column of times as seconds from the earliest one."""
    if name not in table.keys():  # noqa: SIM118 - a data frame
        raise InputError(no_such("column", name, table.keys()))
    column = np.asarray(table[name])
    if column.dtype.kind in "mM":
        if np.isnat(column).any():
            row = int(np.isnat(column).argmax())
            raise InputError(f"expected a time '{name}' in every row, got none in row {row + 1}")
        ticks = column.astype(f"{column.dtype.kind}8[ns]").astype(np.int64)
        since: NDArray[np.float64] = (ticks - (ticks.min() if len(ticks) else 0)) / 1e9
        return since
    unit = unit_of_times(name) or "s"
    if unit not in UNITS:
        raise InputError(
            f"expected a column of times in {', '.join(UNITS)}, got '{name}' in {unit}; rename it"
        )
    times = line_of_numbers(table[name], f"the times '{name}'")
    if not np.isfinite(times).all():
        row = int((~np.isfinite(times)).argmax())
        raise InputError(
            f"expected a finite time '{name}' in every row, got {times[row]} in row {row + 1}"
        )
    return times * float(UNITS[unit])


def periods_of(
    times: NDArray[np.float64], groups: Groups, *, even: bool
) -> list[Fraction | InputError | None]:
    """Return the period of each group; an error for times that do not increase evenly.

    Args:
        times: The times in seconds in the order of the groups.
        groups: The groups.
        even: Whether the distances of times matter.

    The period of a group of one row is None.
    """
    begins, lengths = groups.begins, groups.lengths
    last = times[begins + lengths - 1]
    spans = last - times[begins]
    steps = np.divide(spans, lengths - 1, out=np.zeros(len(spans)), where=lengths > 1)
    rises = np.ones(len(times), bool)
    rises[1:] = times[1:] > times[:-1]
    rises[begins] = True
    ordered = np.logical_and.reduceat(rises, begins)
    within = np.arange(len(times)) - np.repeat(begins, lengths)
    ideal = np.repeat(times[begins], lengths) + within * np.repeat(steps, lengths)
    off = np.maximum.reduceat(np.abs(times - ideal), begins)
    blur = 4 * np.spacing(np.maximum(np.abs(last), np.abs(times[begins])))
    rows: list[Fraction | InputError | None] = []
    known: dict[tuple[float, float], Fraction] = {}
    for i, (step, count) in enumerate(zip(steps.tolist(), lengths.tolist(), strict=True)):
        if not ordered[i]:
            begin = int(begins[i])
            row = int((~rises[begin : begin + count]).argmax())
            earlier, later = times[begin + row - 1 : begin + row + 1]
            rows.append(
                InputError(
                    f"expected times that increase, got {later:.12g} s after {earlier:.12g} s; "
                    "sort the rows by time"
                )
            )
        elif count == 1 or not even:
            rows.append(None)
        elif off[i] > _NEAR * Fraction(step) + Fraction(blur[i]):
            rows.append(
                InputError(
                    f"expected times at even distances, got samples up to {off[i]:.3g} s off a "
                    f"step of {step:.6g} s; resample the rows, or pass period= in place of time="
                )
            )
        else:
            # A thousandth of what the samples may be off: neighbouring groups agree.
            near = max(step * 1e-9, blur[i] / (count - 1), off[i] / (count - 1))
            key = step, near
            if key not in known:
                known[key] = simplest(
                    Fraction(step) - Fraction(near), Fraction(step) + Fraction(near)
                )
            rows.append(known[key])
    return rows
