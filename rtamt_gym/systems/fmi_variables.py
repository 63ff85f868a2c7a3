"""The variables of FMUs: their types, their names, and the numbers that fit them."""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Mapping
from numbers import Real
from typing import Any, Final, NamedTuple

from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing

TYPES: Final[Mapping[int, Mapping[str, tuple[str, type[Any]]]]] = {
    2: {
        "Real": ("Real", ctypes.c_double),
        "Integer": ("Integer", ctypes.c_int),
        "Enumeration": ("Integer", ctypes.c_int),
        "Boolean": ("Boolean", ctypes.c_int),
    },
    3: {
        "Float32": ("Float32", ctypes.c_float),
        "Float64": ("Float64", ctypes.c_double),
        "Boolean": ("Boolean", ctypes.c_bool),
        "Enumeration": ("Int64", ctypes.c_int64),
        **{f"Int{n}": (f"Int{n}", getattr(ctypes, f"c_int{n}")) for n in (8, 16, 32, 64)},
        **{f"UInt{n}": (f"UInt{n}", getattr(ctypes, f"c_uint{n}")) for n in (8, 16, 32, 64)},
    },
}
"""The word in the names of functions, and the C type, by version of FMI and type."""

_ELEMENT = re.compile(r"(.+?)((?:\[-?\d+\])+)")
"""The name of an element of an array: ``row[2]``, ``grid[0][1]``."""

_WORDS: Final = {"true": 1, "false": 0}


class Variable(NamedTuple):
    """A number of an FMU: a variable, or an element of an array variable."""

    name: str
    fmu: int
    entry: Any
    element: int = 0


class Variables:
    """The variables of FMUs by name."""

    def __init__(self, described: Mapping[str, Any]) -> None:
        self._of = ", ".join(described)
        self._known: dict[str, Variable] = {}
        for i, (fmu, description) in enumerate(described.items()):
            for entry in description.modelVariables:
                variable = Variable(f"{fmu}.{entry.name}", i, entry)
                self._known[variable.name] = variable
                if len(described) == 1:
                    self._known[entry.name] = variable

    def find(self, name: str) -> Variable:
        """Return the variable of a name."""
        variable = self._known.get(name) or self._element(name)
        if variable is None:
            array = name.partition("[")[0]
            meant = nearest(name, self._known) or nearest(array, self._known)
            raise InputError(
                f"no variable {name!r} in {self._of}"
                + (meant or f"; the outputs are {self._all('output')}")
            )
        if kind_of(variable.entry) is None:
            raise InputError(f"{name!r} is a {variable.entry.type}, expected a number")
        if variable.entry.dimensions and name in self._known:
            raise InputError(f"{_array(name, variable.entry)}; choose one element")
        return variable

    def input(self, name: str) -> Variable:
        """Return the input of a name."""
        variable = self.find(name)
        if variable.entry.causality != "input":
            raise InputError(
                f"expected an input, got {name!r}, which is of causality "
                f"{variable.entry.causality!r}; the inputs are {self._all('input')}"
            )
        return variable

    def parameter(self, name: str) -> Variable:
        """Return the variable of a name if its start value can be set."""
        variable = self.find(name)
        entry = variable.entry
        if entry.causality == "input":
            raise InputError(f"{name!r} is an input: give it in inputs=")
        if entry.causality == "structuralParameter":
            raise InputError(
                f"{name!r} sets the size of arrays and cannot change from its start value "
                f"{entry.start}"
            )
        if entry.variability == "constant" or entry.initial not in {"exact", "approx"}:
            raise InputError(
                f"expected a variable with a start value, got {name!r}, which is of causality "
                f"{entry.causality!r} and calculated"
            )
        return variable

    def _element(self, name: str) -> Variable | None:
        """Return the array element of a name; None if the array does not exist."""
        of_element = _ELEMENT.fullmatch(name)
        array = self._known.get(of_element[1]) if of_element else None
        if of_element is None or array is None:
            return None
        base, brackets = of_element.groups()
        indices = [int(index) for index in re.findall(r"-?\d+", brackets)]
        shape = array.entry.shape
        if not shape:
            raise InputError(f"no {name!r}: {base!r} is a single number")
        if len(indices) != len(shape) or not all(
            0 <= index < size for index, size in zip(indices, shape, strict=True)
        ):
            raise InputError(f"no {name!r}: {_array(base, array.entry)}")
        element = 0
        for index, size in zip(indices, shape, strict=True):
            element = element * size + index
        return Variable(f"{array.name}{brackets}", array.fmu, array.entry, element)

    def _all(self, causality: str) -> str:
        """List the names of all inputs or outputs."""
        known = dict.fromkeys(self._known.values())
        return listing(
            [variable.name for variable in known if variable.entry.causality == causality]
        )


def _array(name: str, entry: Any) -> str:  # noqa: ANN401 - FMPy is not typed
    """Describe an array variable."""
    if not size_of(entry):
        return f"{name!r} is an array without numbers"
    first, last = "[0]" * len(entry.shape), "".join(f"[{size - 1}]" for size in entry.shape)
    return (
        f"{name!r} is an array of {' x '.join(map(str, entry.shape))} numbers, "
        f"{name}{first} to {name}{last}"
    )


def kind_of(variable: Any) -> type[float | int] | None:  # noqa: ANN401 - FMPy is not typed
    """Return the type of a variable's value: float, int, or None if it is not a number."""
    if variable.type in {"Real", "Float32", "Float64"}:
        return float
    return int if any(variable.type in types for types in TYPES.values()) else None


def size_of(variable: Any) -> int:  # noqa: ANN401
    """Return how many numbers a variable holds."""
    return math.prod(variable.shape)


def start_values(array: Any) -> list[float]:  # noqa: ANN401
    """Return the start values of an array; FMI 3.0 writes one for all, or each."""
    size, read = size_of(array), float if kind_of(array) is float else int
    words = (array.start or "0").split()
    numbers = [_WORDS[word] if word in _WORDS else read(word) for word in words]
    if len(numbers) not in {1, size}:
        raise InputError(
            f"expected {size} start values of {array.name!r} in its FMU, got {len(numbers)}"
        )
    return numbers * size if len(numbers) == 1 else numbers


def fit(variable: Variable, value: object) -> float:
    """Return the value as a number of the variable's type."""
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
