"""The inputs of array monitors: specifications, samples, masks and states."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import NamedTuple, NoReturn, Protocol, assert_never

from rtamt import Formula, Specification
from rtamt.errors import InputError, InputTypeError, RtamtError
from rtamt.language.parser import as_specification
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.lowering import compile_program, refuse_rates
from rtamt.program.program import Program
from rtamt.program.timing import as_align, as_period
from rtamt.typing import Align, Period
from rtamt_arrays.functions import FUNCTIONS
from rtamt_arrays.operations import Operations, Tensor

ArraySample = Mapping[str, Tensor] | Tensor
"""Arrays by variable, or one array with the variables in order on its last axis."""


class ArrayReader(Protocol):
    """Checks and converts arrays of a library to floats of one dtype."""

    dtype: object
    kind: str
    """The name of its arrays in errors."""
    module: str
    """The name of the library in errors."""
    limits: tuple[float, float]
    """The smallest and the largest positive normal number of the dtype."""

    def as_array(self, value: object) -> Tensor | None:
        """Return the value as an array of the dtype; None if it is not an array of real numbers."""

    def is_array(self, value: object) -> bool:
        """Return whether the library accepts the value as an array."""

    def holds(self, value: object, dtype: object) -> bool:
        """Return whether the value is an array with exactly this dtype, as states require."""

    def mask(self, mask: object, like: Tensor) -> Tensor | None:
        """Return a mask of booleans, all true for None; return None if it is not a mask."""

    def describe(self, value: object) -> str:
        """Return a value as text for an error; its type while a graph is compiled."""

    def nearest(self, name: str, names: Sequence[str]) -> str:
        """Return a suggestion of a similar name for the end of an error, or an empty text."""

    def announce(self, text: str) -> None:
        """Pass the text of the next error to a graph compiler."""


class StateField(NamedTuple):
    """An array of a state: axes before the batch, dtype, and whether it has a batch axis."""

    rows: tuple[int, ...]
    dtype: object
    entries: bool = True


def raise_error(reader: ArrayReader | None, error: type[RtamtError], text: str) -> NoReturn:
    """Raise an error, with its text also while a graph is compiled."""
    if reader is not None:
        reader.announce(text)
    raise error(text)


def columns(
    program: Program, reader: ArrayReader, signals: object, shape: Sequence[int] | None = None
) -> list[Tensor]:
    """Return an array for each variable of a program, all of one shape.

    Args:
        program: The program.
        reader: The reader of the library.
        signals: A mapping from names to arrays, or an array with the variables on its last axis.
        shape: The expected shape; None for any shape with at least one axis.
    """
    names = program.variables
    if isinstance(signals, Mapping):
        for name in names:
            if name not in signals:
                listed = ", ".join(map(str, signals)) or "none"
                hint = reader.nearest(name, [str(key) for key in signals])
                text = f"expected the variable '{name}', got {listed}{hint}"
                raise_error(reader, InputError, text)
        arrays = [_as_array(reader, signals[name], f"'{name}'") for name in names]
    else:
        counted = f"{len(names) or 'no'} variable{'' if len(names) == 1 else 's'}"
        listed = f"{counted} ({', '.join(names)})" if names else counted
        table = _as_array(reader, signals, f"{listed}, by name or as a last axis")
        if not table.shape or table.shape[-1] != len(names):
            text = (
                f"expected the last axis to have {listed}, got shape {tuple(table.shape)}; "
                "or pass a mapping from names to arrays"
            )
            raise_error(reader, InputError, text)
        arrays = [table[..., i] for i in range(len(names))]
    for name, array in zip(names, arrays, strict=True):
        if shape is None and not array.shape:
            text = f"expected an axis of samples in '{name}', got one number"
            raise_error(reader, InputError, text)
        expected = tuple(arrays[0].shape if shape is None else shape)
        if tuple(array.shape) != expected:
            why = f"'{names[0]}' has it" if shape is None else "init() set the batch size"
            text = f"expected shape {expected} of '{name}', got {tuple(array.shape)}; {why}"
            raise_error(reader, InputError, text)
    return arrays


def traces(program: Program, reader: ArrayReader, signals: object) -> list[Tensor]:
    """Return an array for each variable, with time as the first axis instead of the last."""
    if not program.variables:
        text = "the formula has no variable, so the number of samples is unknown; add a variable"
        raise_error(reader, InputError, text)
    arrays = columns(program, reader, signals)
    shape = tuple(arrays[0].shape)
    if not shape[-1]:
        raise_error(reader, InputError, f"expected 1 sample or more, got shape {shape}")
    return [array.swapaxes(0, -1) for array in arrays]


def _as_array(reader: ArrayReader, value: object, name: str) -> Tensor:
    array = reader.as_array(value)
    if array is None:
        hint = "" if reader.is_array(value) else f"; convert with {reader.module}.asarray"
        text = (
            f"expected {reader.kind} of real numbers for {name}, got {reader.describe(value)}{hint}"
        )
        raise_error(reader, InputTypeError, text)
    return array


def checked_batch_size(reader: ArrayReader, batch_size: object) -> int:
    """Return the size of a batch, or raise an error."""
    number = as_whole(batch_size)
    if number is None:
        text = f"expected a whole number of batch entries, got {reader.describe(batch_size)}"
        raise_error(reader, InputTypeError, text)
    if number < 1:
        raise_error(reader, InputError, f"expected 1 or more batch entries, got {number}")
    return number


def as_whole(value: object) -> int | None:
    """Return the value as an int; None if it is not a whole number or is a boolean."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)  # type: ignore[arg-type] # raises TypeError without __index__
    except TypeError:
        return None


def checked_mask(reader: ArrayReader, mask: object, like: Tensor) -> Tensor:
    """Return a mask with the shape of ``like``, or raise an error."""
    shape, array = tuple(like.shape), reader.mask(mask, like)
    if array is None:
        module, entries = reader.module, shape[0]
        text = (
            f"expected a mask of booleans in {reader.kind} of shape {shape}, got "
            f"{reader.describe(mask)}; write numbers != 0, or "
            f"{module}.isin({module}.arange({entries}), indices) for indices"
        )
        raise_error(reader, InputTypeError, text)
    if tuple(array.shape) != shape:
        text = (
            f"expected a mask of shape {shape}, a boolean for each batch entry, got "
            f"{tuple(array.shape)}"
        )
        raise_error(reader, InputError, text)
    return array


def checked_state(
    reader: ArrayReader, state: object, kind: type, fields: Mapping[str, StateField]
) -> None:
    """Raise an error if ``state`` is not a state with these fields."""
    if not isinstance(state, kind):
        text = (
            f"expected a state of this monitor, an {kind.__name__}, got {reader.describe(state)}; "
            "init(batch_size) returns the first state, and a step the next state and a reading"
        )
        raise_error(reader, InputTypeError, text)
    for name, field in fields.items():
        value = getattr(state, name)
        if not reader.holds(value, field.dtype):
            got = value.dtype if reader.is_array(value) else type(value).__name__
            text = (
                f"expected a state of this monitor, with {reader.kind} of "
                f"{dtype_name(field.dtype)} as '{name}', got {got}"
            )
            raise_error(reader, InputTypeError, text)
    entries = tuple(state.age.shape)[-1:] or (1,)  # type: ignore[attr-defined] # of states
    for name, field in fields.items():
        expected = (*field.rows, *entries) if field.entries else field.rows
        shape = tuple(getattr(state, name).shape)
        if shape != expected:
            text = (
                f"expected a state of this monitor, in which '{name}' has the shape {expected}, "
                f"got {shape}; the state belongs to another specification or batch size"
            )
            raise_error(reader, InputError, text)


def dtype_name(dtype: object) -> str:
    """Return the name of a dtype for errors."""
    return getattr(dtype, "__name__", None) or str(dtype)


def zeros(o: Operations, fields: Mapping[str, StateField], entries: int) -> dict[str, Tensor]:
    """Return the arrays of a state, filled with zeros."""
    return {
        name: o.full((*field.rows, *[entries] * field.entries), 0.0, field.dtype)
        for name, field in fields.items()
    }


def terms(
    program: Program, o: Operations, dtype: object, values: Sequence[Tensor]
) -> tuple[list[Tensor], Tensor | None]:
    """Return the registers of the terms, and where a term is nan; None without variables."""
    registers: list[Tensor] = []
    nan: Tensor | None = None
    for instruction in program.instructions[: program.terms]:
        match instruction:
            case Load(variable):
                registers.append(values[program.variables.index(variable)])
            case Const(value):
                registers.append(o.full((), value, dtype))
                continue
            case Map(function, args):
                registers.append(FUNCTIONS[function](o, *(registers[a] for a in args)))
            case Window():
                msg = "a window among the terms"
                raise AssertionError(msg)
            case _ as never:
                assert_never(never)
        is_nan = o.isnan(registers[-1])
        nan = is_nan if nan is None else nan | is_nan
    return registers, nan


Spec = str | Formula | Specification
"""A specification: text, a formula, or a parsed specification."""


def program_of(spec: Spec, period: Period | None, align: Align | None, *, online: bool) -> Program:
    """Compile a specification; with ``online``, an unbounded future is an error."""
    specification = as_specification(spec)
    refuse_rates(specification, "rtamt_arrays")
    program = compile_program(
        specification, as_period(period), align=as_align(align), online=online
    )
    return program.restricted(program.result, {})
