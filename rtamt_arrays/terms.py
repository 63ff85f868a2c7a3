"""From what a caller hands over to the terms of a program, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, assert_never

from rtamt.errors import InputError, InputTypeError, brief, nearest
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.program import Program
from rtamt_arrays.functions import FUNCTIONS
from rtamt_arrays.operations import Operations, Tensor

__all__ = [
    "ArrayReader",
    "ArraySample",
    "checked_lanes",
    "checked_state",
    "columns",
    "terms",
    "traces",
]

ArraySample = Mapping[str, Tensor] | Tensor
"""Arrays by variable, or one array whose last axis has the variables in order."""


class ArrayReader(Protocol):
    """The arrays of a library, as floats of one kind."""

    dtype: object
    kind: str
    """What the library calls its arrays, in errors."""

    def taken(self, value: object) -> Tensor | None:
        """The value as an array of the kind; None if it is no array of real numbers."""

    def mask(self, mask: object, like: Tensor) -> Tensor:
        """The mask as booleans of the shape of another array; all of them if it is None."""


def columns(
    program: Program, reader: ArrayReader, given: object, shape: Sequence[int] | None = None
) -> list[Tensor]:
    """An array for each variable, all of one shape.

    Args:
        program: Its variables are read; others of a mapping are ignored.
        reader: Reads the arrays of the library.
        given: A mapping from names to arrays, or an array whose last axis has the variables.
        shape: The shape that each must have; None: the same for all, with an axis at least.

    Raises:
        InputError: On a missing variable, or a shape that is another one.
        InputTypeError: On what are no arrays of real numbers.
    """
    names = program.variables
    if isinstance(given, Mapping):
        for name in names:
            if name not in given:
                listed = ", ".join(map(str, given)) or "none"
                hint = nearest(name, [str(key) for key in given])
                raise InputError(f"expected the variable '{name}', got {listed}{hint}")
        found = [_taken(reader, given[name], f"'{name}'") for name in names]
    else:
        table = _taken(reader, given, "the variables")
        if not table.shape or table.shape[-1] != len(names):
            raise InputError(
                f"expected the last axis to have {len(names)} variables ({', '.join(names)}), "
                f"got shape {tuple(table.shape)}; a mapping gives an array for each name"
            )
        found = [table[..., i] for i in range(len(names))]
    for name, array in zip(names, found, strict=True):
        expected = tuple(found[0].shape if shape is None else shape)
        if tuple(array.shape) != expected:
            raise InputError(
                f"expected shape {expected} of '{name}', got {tuple(array.shape)}"
                + ("; the lanes are those of init()" if shape is not None else "")
            )
    return found


def traces(program: Program, reader: ArrayReader, signals: object) -> list[Tensor]:
    """An array for each variable, whose first axis is time and whose last axis was.

    Raises:
        InputError: As `columns` does, and on no variable, no axis or no samples.
        InputTypeError: As `columns` does.
    """
    if not program.variables:
        raise InputError(f"expected a variable in {program.specification.formula}, got none")
    found = columns(program, reader, signals)
    shape = tuple(found[0].shape)
    if not shape:
        raise InputError("expected an axis of samples, got a number for each variable")
    if not shape[-1]:
        raise InputError(f"expected 1 sample or more, got shape {shape}")
    return [array.swapaxes(0, -1) for array in found]


def _taken(reader: ArrayReader, value: object, what: str) -> Tensor:
    array = reader.taken(value)
    if array is None:
        raise InputTypeError(
            f"expected {reader.kind} of real numbers for {what}, got {brief(value)}"
        )
    return array


def checked_lanes(lanes: object) -> int:
    """A number of lanes.

    Raises:
        InputError: On fewer than 1.
        InputTypeError: On what is no ``int``.
    """
    if isinstance(lanes, bool) or not isinstance(lanes, int):
        raise InputTypeError(f"expected a number of lanes, got {brief(lanes)}")
    if lanes < 1:
        raise InputError(f"expected 1 lane or more, got {lanes}")
    return lanes


def checked_state(state: object, kind: type, rows: Mapping[str, int]) -> None:
    """Refuse what is no state of a monitor.

    Args:
        state: What a caller handed over.
        kind: The class of its states.
        rows: The length of the first axis of some of their arrays.

    Raises:
        InputError: On a state of another specification.
        InputTypeError: On what is no state.
    """
    if not isinstance(state, kind):
        raise InputTypeError(
            f"expected a state of this monitor, got {brief(state)}; init(lanes) makes the first"
        )
    found = {name: getattr(state, name).shape[0] for name in rows}
    if found != rows:
        raise InputError(
            f"expected a state of this monitor, whose rows are {rows}, got {found}: "
            "it is that of another specification"
        )


def terms(
    program: Program, o: Operations, dtype: object, values: Sequence[Tensor]
) -> tuple[list[Tensor], Tensor | None]:
    """The registers of the terms, and where one of them is nan; None: none can be.

    Args:
        program: The program whose terms are evaluated.
        o: The array library.
        dtype: The kind of numbers of constants.
        values: An array for each variable.
    """
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
        here = o.isnan(registers[-1])
        nan = here if nan is None else nan | here
    return registers, nan
