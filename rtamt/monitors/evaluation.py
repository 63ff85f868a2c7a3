"""Robustness of whole traces."""

from __future__ import annotations

from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError
from rtamt.inputs.frames import check_roles
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.machines.backend import BACKENDS
from rtamt.machines.offline import run_offline
from rtamt.monitors.options import SampleOptions, Spec, compiled, listed_in_signature
from rtamt.program.timing import Period

__all__ = ["evaluate", "raw_trace", "trace_between", "whole_trace"]


@listed_in_signature(SampleOptions)
def evaluate(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> NDArray[np.float64]:
    """Robustness at every sample of a whole trace.

    Windows are cut at both ends of the trace: where nothing of the window is left, ``always`` is
    +inf and ``eventually`` -inf. Operators without an end reach to the end of the trace.

    Args:
        spec: Text, a formula, or a parsed specification.
        data: A mapping of every variable to its n values, or of a message to n messages; a data
            frame of pandas or polars, or a table of Arrow. A variable that is not there has its
            declared default. Other names are ignored, except the times of a frame. Or an array of
            shape (n, variables).
        period: As for `Monitor`. A formula with bounds needs it for a frame with a column of times,
            such as ``time`` or ``Time [s]``, or with an index of dates.
        n: The length, for a formula without variables.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`.

    Returns:
        n values, one for each sample.

    Raises:
        SpecificationError: As for `Monitor`, except that a future may have no end.
        InputError: As for `Monitor`, and on missing variables, an empty trace, columns of different
            length, a nan, times of a frame that would be ignored, or a frame with the rows of
            several objects or episodes.
        InputTypeError: On values that are not real numbers.

    Example:
        >>> evaluate("always(x > 1)", {"x": [5, 4, 3]}).tolist()
        [2.0, 2.0, 2.0]
    """
    _, _, backend, nan, _, program = compiled(evaluate, spec, period, options, online=False)
    reader = SampleReader(program, nan)
    columns, length = raw_trace(reader, data, n, period)
    machine = BACKENDS[backend].discrete_machine
    return run_offline(program, reader, machine, columns, length)


def raw_trace(
    reader: SampleReader, data: TraceColumns, n: int | None, period: Period | None
) -> tuple[list[NDArray[np.float64]], int]:
    """What `whole_trace` returns, with every nan still in it."""
    columns, length = reader.columns(data, n=n, extra=True)
    _check_trace(reader, data, length, period)
    return columns, length


def trace_between(
    reader: SampleReader, data: TraceColumns, n: int | None, period: Period | None
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]], int]:
    """The least and the greatest values of a whole trace, and its length; see `raw_trace`.

    If all values are known, both are one list.
    """
    lower, upper, length = reader.between(data, n=n, extra=True)
    _check_trace(reader, data, length, period)
    return lower, upper, length


def whole_trace(
    reader: SampleReader, data: TraceColumns, n: int | None, period: Period | None
) -> tuple[list[NDArray[np.float64]], int]:
    """The columns of a whole trace, in the order of the variables, and its length, 1 or more.

    It raises the errors of `evaluate`.
    """
    columns, length = raw_trace(reader, data, n, period)
    return reader.without_nan(columns), length


def _check_trace(
    reader: SampleReader, data: TraceColumns, length: int, period: Period | None
) -> None:
    if length == 0:
        raise InputError("expected a trace of at least 1 sample, got 0")
    timed = period is None and reader.program.specification.timed
    check_roles(data, reader.variables, timed=timed)
