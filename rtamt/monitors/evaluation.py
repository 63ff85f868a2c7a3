"""Robustness of recorded traces: one trace or a batch of samples, and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from rtamt.errors import InputError, InputTypeError, RtamtError, brief, no_such
from rtamt.inputs.arrays import Floats, array_of_numbers
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Events, EventsLike
from rtamt.inputs.frames import check_roles, warn_of_times
from rtamt.inputs.samples import SampleReader, TraceColumns, wrong_shape
from rtamt.machines.backend import BACKENDS
from rtamt.machines.offline import Passes, result_alone, run_offline
from rtamt.monitors.options import (
    Compiled,
    Interpolation,
    Options,
    SampleOptions,
    Spec,
    check_interpolation,
    compiled,
    compiled_dense,
    listed_in_signature,
)
from rtamt.program.timing import Period


@listed_in_signature(SampleOptions)
def evaluate(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    n: int | None = None,
    lengths: ArrayLike | None = None,
    **options: Unpack[SampleOptions],
) -> Floats:
    """Return the robustness at every sample of a recorded trace, or of a batch of traces.

    Windows are cut at both ends of the trace: if the whole window lies outside, ``always`` is +inf
    and ``eventually`` -inf. Operators without an end reach to the end of the trace.

    The data are a batch if ``lengths`` is set, if an array has three dimensions, or if a column has
    two. Each trace of a batch has the same values as alone.

    Args:
        spec: Text, a formula, or a parsed specification.
        data: A mapping of every variable to its n values, or of a message to n messages; a data
            frame of pandas or polars, or a table of Arrow. A missing variable has its declared
            default. Other names are ignored, except the times of a frame. Or an array of shape
            (n, variables). A batch is a mapping of every variable to an array of shape (traces,
            samples), or an array of shape (traces, samples, variables).
        period: As for `Monitor`. A formula with bounds needs it for a frame with a column of times,
            such as ``time`` or ``Time [s]``, or with an index of dates.
        n: The number of samples of one trace, for a formula without variables.
        lengths: The number of samples of each trace of a batch, 1 or more; later values are never
            read. Default: every trace has all samples. Columns of shape (traces, 1) need it.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="hold"`` keeps a value within its trace.

    Returns:
        Array of shape (n,), or of shape (traces, samples) with nan after the end of a trace.

    Raises:
        SpecificationError: As for `Monitor`, but future operators need no end.
        InputError: As for `Monitor`, and on missing variables, an empty trace, columns of different
            length, a nan, times of a frame that would be ignored, or a frame with the rows of
            several objects or episodes; for a batch with the number of the trace, and on shapes or
            lengths that do not fit.
        InputTypeError: On values that are not real numbers, or lengths that are not whole numbers.

    Example:
        >>> evaluate("always(x > 1)", {"x": [5, 4, 3]}).tolist()
        [2.0, 2.0, 2.0]
        >>> evaluate("always(x > 1)", {"x": [[5, 4, 3], [1, 9, 9]]}, lengths=[2, 3])
        array([[ 3.,  3., nan],
               [-0.,  8.,  8.]])
    """
    parts = compiled(evaluate, spec, period, options, online=False)
    program = parts.program
    reader = SampleReader(program, parts.nan)
    if lengths is not None or _is_batch(data, reader.variables):
        if n is not None:
            raise InputError("n= is the length of one trace, got a batch. Use lengths=.")
        return _evaluate_batch(parts, reader, data, lengths, strict=True)
    columns, length = raw_trace(reader, data, n, period)
    machine = BACKENDS[parts.backend].discrete_machine
    return run_offline(program, reader, machine, columns, length)


def evaluate_many(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    lengths: ArrayLike | None = None,
    **options: Unpack[SampleOptions],
) -> Floats:
    """Return `evaluate` of a batch: the name of this in the previous version."""
    parts = compiled(evaluate_many, spec, period, options, online=False)
    return _evaluate_batch(parts, SampleReader(parts.program, parts.nan), data, lengths)


@listed_in_signature(Options)
def evaluate_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    *,
    resolution: Period = "1ns",
    interpolation: Interpolation = "previous",
    **options: Unpack[Options],
) -> Events:
    """Return the robustness over a whole trace in dense time.

    Signals are right-continuous step functions: a value lasts until the variable's next event, and
    the last event is an instant, the end. The trace covers the times at which all variables are
    known. Windows are closed and cut to the trace: if the whole window lies outside, ``always`` is
    +inf and ``eventually`` -inf. Operators without an end reach to the end of the trace.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: For each variable a sequence of (time, value), an array of shape (n, 2), or
            `rtamt.dense.Events`. Other variables are ignored.
        resolution: As for `rtamt.dense.Monitor`.
        interpolation: As for `rtamt.dense.Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Returns:
        The robustness, which is also a step function: an event at its start, wherever it changes,
        and at the end if it changes there. A value at a single instant inside the trace, with
        another value before and after, is left out; a value at the end is part of the result.

    Raises:
        SpecificationError: As for `rtamt.dense.Monitor`, but future operators need no end.
        InputError: On a variable without events, times that `rtamt.dense.Monitor` refuses, a nan, a
            term that is not a number, or variables that are never known at the same time.
        InputTypeError: On values that are not real numbers.

    Example:
        >>> import rtamt
        >>> signals = {"request": [(0, 0), (1, 1), (5, 1)], "grant": [(0, 0), (2.5, 1), (5, 1)]}
        >>> spec = "request > 0.5 implies eventually[0:1](grant > 0.5)"
        >>> list(rtamt.dense.evaluate(spec, signals))
        [(0.0, 0.5), (1.0, -0.5), (1.5, 0.5)]

    Source: see `rtamt.dense.Monitor`.
    """
    check_interpolation(interpolation)
    _, _, backend, whole = compiled_dense(evaluate_dense, spec, resolution, options, online=False)
    program = whole.result_alone()
    reader = EventReader(program)
    machine = BACKENDS[backend].dense_machine(program, reader, ())
    return Events.unchecked(*machine.run(reader.whole(signals)))


def raw_trace(
    reader: SampleReader, data: TraceColumns, n: int | None, period: Period | None
) -> tuple[list[Floats], int]:
    """Return the columns of a trace in the order of the variables, and its length, 1 or more."""
    columns, length = reader.columns(data, n=n, extra=True)
    _check_trace(reader, data, length, period)
    return columns, length


def trace_between(
    reader: SampleReader, data: TraceColumns, n: int | None, period: Period | None
) -> tuple[list[Floats], list[Floats], int]:
    """Return the smallest and the largest values of a trace, and its length; see `raw_trace`.

    If all values are known, both are the same list.
    """
    lower, upper, length = reader.between(data, n=n, extra=True)
    _check_trace(reader, data, length, period)
    return lower, upper, length


def _check_trace(
    reader: SampleReader, data: TraceColumns, length: int, period: Period | None
) -> None:
    if length == 0:
        raise InputError("expected a trace of at least 1 sample, got 0")
    timed = reader.program.specification.timed
    check_roles(data, reader.variables, timed=timed and period is None)
    if timed and period is not None:
        warn_of_times(data, reader.variables, reader.program.seconds)


def _is_batch(data: TraceColumns, names: Sequence[str]) -> bool:
    if isinstance(data, Mapping):
        return any(name in data and _depth(data[name]) == 2 for name in names)
    return _depth(data) == 3


def _depth(values: Any) -> int:  # noqa: ANN401 - an array or nested lists
    """Return the number of dimensions, of lists by their first elements."""
    depth = 0
    while isinstance(values, list | tuple):
        depth += 1
        if not values:
            return depth
        values = values[0]
    return depth + getattr(values, "ndim", 0)


def _check_unambiguous(data: TraceColumns, shape: tuple[int, int]) -> None:
    """Raise InputError for columns of shape (n, 1), which may be one trace or n traces."""
    if isinstance(data, Mapping) and shape[1] == 1 < shape[0]:
        raise InputError(
            f"A column has the shape {shape}: one trace of {shape[0]} samples, or {shape[0]} "
            "traces of one sample. Pass a column of one dimension, or lengths= for a batch."
        )


def _evaluate_batch(
    parts: Compiled,
    reader: SampleReader,
    data: TraceColumns,
    lengths: ArrayLike | None,
    *,
    strict: bool = False,
) -> Floats:
    columns, shape = _tables(reader, data)
    if strict and lengths is None:
        _check_unambiguous(data, shape)
    ends = _ends(lengths, shape)
    robustness = np.full(shape, np.nan)
    if not len(ends):
        return robustness
    machine = BACKENDS[parts.backend].discrete_machine
    passes = Passes(result_alone(parts.program), reader, machine, max(ends))
    complete = not any(np.isnan(column).any() for column in columns)
    for trace, n in enumerate(ends):
        row = [column[trace, :n] for column in columns]
        row += reader.rates.of_columns(row)
        try:
            if not complete:
                row = reader.without_nan(row)
            robustness[trace, :n] = passes.run(row, n)[""]
        except RtamtError as error:
            raise error.at(f"trace {trace}") from None
    return robustness


def _tables(reader: SampleReader, data: TraceColumns) -> tuple[list[Floats], tuple[int, int]]:
    """Return a table of shape (traces, samples) for each variable, and that shape."""
    names = reader.variables
    if isinstance(data, Mapping):
        tables = _named_tables(names, cast("Mapping[str, ArrayLike]", data))
        shape = tables[0].shape
    else:
        table = array_of_numbers(data, "the traces")
        if table.ndim != 3 or table.shape[2] != len(names):
            raise wrong_shape(table, "traces, samples", names)
        tables, shape = list(np.moveaxis(table, 2, 0)), table.shape
    traces, samples = shape[:2]
    if samples == 0:
        raise InputError("expected traces of at least 1 sample, got 0")
    return [np.ascontiguousarray(table) for table in tables], (traces, samples)


def _named_tables(names: Sequence[str], data: Mapping[str, ArrayLike]) -> list[Floats]:
    if not names:
        raise InputError(
            "the formula has no variables: pass an array of shape (traces, samples, 0) for the "
            "number of samples"
        )
    for name in names:
        if name not in data:
            raise InputError(no_such("column", name, data))
    tables = [array_of_numbers(data[name], f"'{name}'") for name in names]
    for name, table in zip(names, tables, strict=True):
        if table.ndim != 2:
            raise InputError(
                f"expected an array of shape (traces, samples) for '{name}', got {table.shape}"
            )
        if table.shape != tables[0].shape:
            raise InputError(
                f"expected arrays of one shape, got {tables[0].shape} for '{names[0]}' and "
                f"{table.shape} for '{name}'"
            )
    return tables


def _ends(lengths: ArrayLike | None, shape: tuple[int, int]) -> Sequence[int]:
    """Return the number of samples of each trace."""
    traces, samples = shape
    if lengths is None:
        return [samples] * traces
    try:
        ends = np.asarray(lengths)
    except ValueError:
        raise InputTypeError(
            f"expected a whole number for each trace as lengths, got {brief(lengths)}"
        ) from None
    if ends.dtype.kind not in "iu":
        raise InputTypeError(f"expected whole numbers as lengths, got dtype {ends.dtype}")
    if ends.shape != (traces,):
        raise InputError(f"expected a length for each of {traces} traces, got shape {ends.shape}")
    if ends.size and not 1 <= ends.min() <= ends.max() <= samples:
        wrong = int(np.argmax((ends < 1) | (ends > samples)))
        raise InputError(
            f"expected lengths from 1 to {samples}, got {ends[wrong]} for trace {wrong}"
        )
    counts: list[int] = ends.tolist()
    return counts
