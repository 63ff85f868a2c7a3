"""The enumerations of the released library."""

from __future__ import annotations

from enum import Enum
from typing import Final

from rtamt.errors import InputError

__all__ = ["Language", "Semantics", "StlIOType", "TimeInterpretation"]


class _Word(Enum):
    """A member that prints as its value."""

    @classmethod
    def _missing_(cls, value: object) -> None:
        words = ", ".join(repr(str(member)) for member in cls)
        raise InputError(f"expected a member of {cls.__name__}, or one of {words}, got {value!r}")

    def __str__(self) -> str:
        return str(self.value)


class Semantics(_Word):
    """Which robustness is meant; the values are those of ``semantics=`` elsewhere."""

    STANDARD: Final = "standard"
    OUTPUT_ROBUSTNESS: Final = "output-robustness"
    INPUT_VACUITY: Final = "input-vacuity"
    INPUT_ROBUSTNESS: Final = "input-robustness"
    OUTPUT_VACUITY: Final = "output-vacuity"


class Language(_Word):
    """Which machines run."""

    PYTHON = "python"
    """The C++ machines where they were built, else those in Python: ``backend="auto"``."""
    CPP = "C++"
    """The C++ machines: ``backend="native"``."""


class TimeInterpretation(_Word):
    """Whether time is of samples or dense."""

    DISCRETE = "discrete_time"
    DENSE = "dense-time"


class StlIOType(Enum):
    """What a variable is to the system."""

    IN = 0
    OUT = 1
    UNDEFINED = 2
