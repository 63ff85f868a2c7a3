"""The enumerations of the released library, and the class names derived from `Semantics`."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import Final

from rtamt.errors import InputError


class _Word(Enum):
    """An enumeration with members that print as their values."""

    @classmethod
    def _missing_(cls, value: object) -> None:
        words = ", ".join(repr(str(member)) for member in cls)
        raise InputError(f"expected a member of {cls.__name__}, or {words}, got {value!r}")

    def __str__(self) -> str:
        return str(self.value)


class Semantics(_Word):
    """The semantics of the robustness, with the values of the option ``semantics``."""

    STANDARD: Final = "standard"
    OUTPUT_ROBUSTNESS: Final = "output-robustness"
    INPUT_VACUITY: Final = "input-vacuity"
    INPUT_ROBUSTNESS: Final = "input-robustness"
    OUTPUT_VACUITY: Final = "output-vacuity"


class Language(_Word):
    """The language of the machines."""

    PYTHON = "python"
    """The C++ machines if they were built; otherwise, the Python machines: ``backend="auto"``."""
    CPP = "C++"
    """The C++ machines: ``backend="native"``."""


class TimeInterpretation(_Word):
    """Time as samples, or dense."""

    DISCRETE = "discrete_time"
    DENSE = "dense-time"


class StlIOType(Enum):
    """The role of a variable in the system."""

    IN = 0
    OUT = 1
    UNDEFINED = 2


def interface_aware(time: str, **classes: Callable[..., object]) -> dict[str, object]:
    """Return the classes of a time domain for each interface-aware semantics, by released name.

    Example:
        >>> import rtamt
        >>> offline = rtamt.StlDenseTimeOfflineSpecification
        >>> for name in interface_aware("DenseTime", Offline=offline):
        ...     print(name)
        IAStlOutputRobustnessDenseTimeOfflineSpecification
        IAStlInputVacuityDenseTimeOfflineSpecification
        IAStlInputRobustnessDenseTimeOfflineSpecification
        IAStlOutputVacuityDenseTimeOfflineSpecification
    """
    return {
        f"IAStl{str(semantics).title().replace('-', '')}{time}{kind}Specification": partial(
            cls, semantics
        )
        for semantics in Semantics
        if semantics is not Semantics.STANDARD
        for kind, cls in classes.items()
    }
