"""Many whole traces of one specification, evaluated in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from rtamt.errors import InputError, InputTypeError, RtamtError, brief, no_such
from rtamt.inputs.arrays import Floats, array_of_numbers
from rtamt.inputs.samples import SampleReader, TraceColumns, wrong_shape
from rtamt.machines.backend import BACKENDS
from rtamt.machines.offline import Passes, result_alone
from rtamt.monitors.options import SampleOptions, Spec, compiled, listed_in_signature
from rtamt.program.timing import Period

__all__ = ["evaluate_many"]


@listed_in_signature(SampleOptions)
def evaluate_many(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    lengths: ArrayLike | None = None,
    **options: Unpack[SampleOptions],
) -> Floats:
    """Robustness at every sample of many whole traces.

    Each trace gets the values that `evaluate` gives; the specification is compiled once.

    Args:
        spec: Text, a formula, or a parsed specification.
        data: A mapping of every variable to its values, of shape (traces, samples); other names are
            ignored. Or an array of shape (traces, samples, variables).
        period: As for `Monitor`.
        lengths: How many samples each trace has, 1 or more; values behind them are never read.
            None: every trace has all samples.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="hold"`` keeps a value within its trace.

    Returns:
        An array of shape (traces, samples); nan behind the end of a shorter trace.

    Raises:
        SpecificationError: As for `evaluate`.
        InputError: As for `evaluate`, with the number of the trace; and on shapes or lengths that
            do not fit.
        InputTypeError: On values that are not real numbers, or lengths that are not whole numbers.

    Example:
        >>> x = [[5, 4, 3], [1, 9, 9]]
        >>> evaluate_many("always(x > 1)", {"x": x})
        array([[ 2.,  2.,  2.],
               [-0.,  8.,  8.]])
        >>> evaluate_many("always(x > 1)", {"x": x}, lengths=[2, 3])
        array([[ 3.,  3., nan],
               [-0.,  8.,  8.]])
    """
    _, _, backend, nan, _, program = compiled(evaluate_many, spec, period, options, online=False)
    reader = SampleReader(program, nan)
    columns, shape = _columns(reader, data)
    ends = _ends(lengths, shape)
    robustness = np.full(shape, np.nan)
    if not len(ends):
        return robustness
    machine = BACKENDS[backend].discrete_machine
    passes = Passes(result_alone(program), reader, machine, max(ends))
    checked = [not np.isnan(column).any() for column in columns]
    for trace, n in enumerate(ends):
        row = [column[trace, :n] for column in columns]
        row += reader.rates.of_columns(row)
        try:
            if not all(checked):
                row = reader.without_nan(row)
            robustness[trace, :n] = passes.run(row, n)[""]
        except RtamtError as error:
            raise type(error)(f"trace {trace}: ", error) from None
    return robustness


def _columns(reader: SampleReader, data: TraceColumns) -> tuple[list[Floats], tuple[int, int]]:
    """For each variable a table of shape (traces, samples), and that shape."""
    names = reader.variables
    shapes: list[tuple[int, ...]]
    if isinstance(data, Mapping):
        for name in names:
            if name not in data:
                raise InputError(no_such("column", name, data))
        named = cast("Mapping[str, ArrayLike]", data)
        tables = [array_of_numbers(named[name], f"'{name}'") for name in names]
        shapes = [table.shape for table in tables]
        if not tables:
            raise InputError(
                "the formula has no variables: say how many samples with an array of shape "
                "(traces, samples, 0)"
            )
        for name, shape in zip(names, shapes, strict=True):
            if len(shape) != 2:
                raise InputError(
                    f"expected an array of shape (traces, samples) for '{name}', got {shape}"
                )
            if shape != shapes[0]:
                raise InputError(
                    f"expected arrays of one shape, got {shapes[0]} for '{names[0]}' and {shape} "
                    f"for '{name}'"
                )
    else:
        table = array_of_numbers(data, "the traces")
        if table.ndim != 3 or table.shape[2] != len(names):
            raise wrong_shape(table, "traces, samples", names)
        tables = list(np.moveaxis(table, 2, 0))
        shapes = [table.shape]
    traces, samples = shapes[0][:2]
    if samples == 0:
        raise InputError("expected traces of at least 1 sample, got 0")
    return [np.ascontiguousarray(table) for table in tables], (traces, samples)


def _ends(lengths: ArrayLike | None, shape: tuple[int, int]) -> Sequence[int]:
    """The number of samples of each trace."""
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
        odd = int(np.argmax((ends < 1) | (ends > samples)))
        raise InputError(f"expected lengths from 1 to {samples}, got {ends[odd]} for trace {odd}")
    found: list[int] = ends.tolist()
    return found
