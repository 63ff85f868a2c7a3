"""The module of the released library's enumerations."""

from rtamt.compat import (
    Language,
    Semantics,
    TimeInterpretation,
)
