"""The variables of FMUs: their types, and the numbers that fit them."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from numbers import Real
from typing import Any, Final, NamedTuple

from rtamt import InputError, InputTypeError

__all__ = ["TYPES", "Variable", "fit", "kind_of"]

_TYPES: Final[Mapping[str, tuple[str, type[Any]]]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}
"""FMI 2.0: for each type, the word in the names of its functions, and the type in C."""

_TYPES_3: Final[Mapping[str, tuple[str, type[Any]]]] = {
    "Float32": ("Float32", ctypes.c_float),
    "Float64": ("Float64", ctypes.c_double),
    "Boolean": ("Boolean", ctypes.c_bool),
    "Enumeration": ("Int64", ctypes.c_int64),
    **{f"Int{n}": (f"Int{n}", getattr(ctypes, f"c_int{n}")) for n in (8, 16, 32, 64)},
    **{f"UInt{n}": (f"UInt{n}", getattr(ctypes, f"c_uint{n}")) for n in (8, 16, 32, 64)},
}
"""FMI 3.0: for each type, the word in the names of its functions, and the type in C."""

TYPES: Final = {2: _TYPES, 3: _TYPES_3}
"""The types by the version of FMI."""


class Variable(NamedTuple):
    """A variable of one of the FMUs.

    Attributes:
        name: The name of its FMU, a dot, its own name.
        fmu: The index of its FMU.
        entry: Its entry in the model description.
    """

    name: str
    fmu: int
    entry: Any


def kind_of(variable: Any) -> type[float | int] | None:  # noqa: ANN401 - FMPy is not typed
    """The type of a variable's value: float, int, or None if it is not a number."""
    if variable.type in {"Real", "Float32", "Float64"}:
        return float
    return int if variable.type in _TYPES or variable.type in _TYPES_3 else None


def fit(variable: Variable, value: object) -> float:
    """The value as a number of the variable's type."""
    if not isinstance(value, Real):
        raise InputTypeError(f"expected a number for {variable.name!r}, got {value!r}")
    number = float(value)
    if kind_of(variable.entry) is float:
        return number
    if not number.is_integer():
        raise InputError(
            f"expected a whole number for {variable.name!r}, a {variable.entry.type}, got {value!r}"
        )
    return int(number)
