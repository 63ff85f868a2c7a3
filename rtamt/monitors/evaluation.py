"""Robustness of whole traces."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError
from rtamt.inputs.samples import Columns, NanPolicy, SampleReader
from rtamt.language.parser import as_specification
from rtamt.machines.backend import Backend, discrete_machine
from rtamt.machines.offline import run_offline
from rtamt.monitors.online import Spec
from rtamt.program.interface import Names, Semantics, as_interface
from rtamt.program.lowering import compile_program
from rtamt.program.timing import Period, as_period

__all__ = ["evaluate", "whole_trace"]


def evaluate(
    spec: Spec,
    data: Columns,
    period: Period | None = None,
    *,
    n: int | None = None,
    backend: Backend = "auto",
    nan: NanPolicy = "raise",
    semantics: Semantics = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
) -> NDArray[np.float64]:
    """Robustness at every sample of a whole trace.

    Windows are cut at both ends of the trace: where nothing of the window is left, ``always`` is
    +inf and ``eventually`` -inf. Operators without an end reach to the end of the trace.

    Args:
        spec: Text, a formula, or a parsed specification.
        data: A mapping of every variable to its n values, or of a message to its n (a data frame
            too; other columns are ignored), or an array of shape (n, variables).
        period: Seconds between samples; None: bounds are numbers of samples.
        n: The length, for a formula without variables.
        backend: ``"auto"`` takes the C++ machine where it was built.
        nan: ``"raise"`` refuses nan; ``"hold"`` keeps the variable's last value.
        semantics: ``"standard"``, or an interface-aware one: ``"output-robustness"``,
            ``"input-vacuity"``, ``"input-robustness"`` or ``"output-vacuity"``.
        inputs: Variables that the system reads; a message stands for its fields. None: those that
            the text declares ``input``. Only interface-aware semantics ask for them.
        outputs: Variables that the system sets; likewise.

    Returns:
        n values, one for each sample.

    Raises:
        SpecificationError: As for `Monitor`, but a future without end is welcome.
        InputError: On missing variables, an empty trace, columns of different length, a nan.
        InputTypeError: On values that are no real numbers.

    Example:
        >>> evaluate("always(x > 1)", {"x": [5, 4, 3]}).tolist()
        [2.0, 2.0, 2.0]
    """
    specification = as_specification(spec)
    interface = as_interface(specification, semantics, inputs, outputs)
    program = compile_program(specification, as_period(period), interface=interface)
    reader = SampleReader(program, nan)
    columns, length = whole_trace(reader, data, n)
    machine = functools.partial(discrete_machine, backend)
    return run_offline(program, reader, machine, columns, length)


def whole_trace(
    reader: SampleReader, data: Columns, n: int | None
) -> tuple[list[NDArray[np.float64]], int]:
    """The columns of a whole trace, in the order of the variables, and its length, 1 or more.

    Raises:
        InputError: As `evaluate` does.
        InputTypeError: Likewise.
    """
    columns, length = reader.block(data, 0, (), n=n, extra=True)
    if length == 0:
        msg = "expected a trace of at least 1 sample, got 0"
        raise InputError(msg)
    return columns, length
