"""The variables of an exported monitor: names, value references, start values.

=================  ================================================================  =============
value reference    variable                                                          type
=================  ================================================================  =============
0                  ``time``, the independent variable (FMI 3.0 alone)                Float64
1, 2, 3            ``robustness``, ``lower``, ``upper``                              Real, Float64
4                  ``verdict``: -1 violated, 0 undecided, 1 satisfied                Integer, Int32
5                  ``stop_on_violation``                                             Boolean
8 and on           the inputs, the parameters, the constants that are fixed,         Real, Float64
                   the named formulas: in this order, without gaps
=================  ================================================================  =============

What they mean from step to step is said in `rtamt.export.program_file`.

Parameters may be set until initialization ends. From them follow the values of the program's
constants, by functions of `rtamt.program.algebra` that are applied once, when initialization ends:
one that is not a number ends it with an error. A parameter of -0.0 is 0.0, as a text has it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count
from typing import Final, Literal, NamedTuple

from rtamt.errors import SpecificationError
from rtamt.export.program_file import DenseFile, ProgramFile

__all__ = ["FIRST", "RESERVED", "Causality", "UnitVariable", "VariableType", "variables_of"]

RESERVED: Final = ("time", "robustness", "lower", "upper", "verdict", "stop_on_violation")
"""The names of a monitor's own variables; their value references are their places here."""

FIRST: Final = 8
"""The value reference of the first input."""

VariableType = Literal["real", "integer", "boolean"]
Causality = Literal["input", "output", "parameter", "local"]


class UnitVariable(NamedTuple):
    """A variable of a unit.

    Attributes:
        name: Its name.
        reference: Its value reference.
        kind: Its type, whose name depends on the version of FMI.
        causality: Its role, in the words of FMI; a local one is a constant that cannot be set.
        start: Its start value; None if it is calculated.
        meaning: What it is, for the reader of a model description.
        range: The least and the greatest value that its declaration says; None if it says none.
    """

    name: str
    reference: int
    kind: VariableType
    causality: Causality
    start: float | None
    meaning: str
    range: tuple[float, float] | None = None


def variables_of(
    file: ProgramFile,
    formulas: Mapping[str, str],
    ranges: Mapping[str, tuple[float, float]],
) -> list[UnitVariable]:
    """The variables of a unit, without ``time``, in the order of their value references.

    Args:
        file: What the unit runs.
        formulas: What each named formula means.
        ranges: The ranges that inputs are declared with.

    Raises:
        SpecificationError: If the specification has a name that is in `RESERVED`.
    """
    found = [*_own(file), *_of_text(file, formulas, ranges)]
    for each in found[len(RESERVED) - 1 :]:
        if each.name in RESERVED:
            msg = (
                f"an FMU of a monitor has a variable '{each.name}' of its own; "
                f"give the '{each.name}' of the specification another name"
            )
            raise SpecificationError(msg)
    return found


def _own(file: ProgramFile) -> Iterator[UnitVariable]:
    robustness = "of the episode if it ended now"
    if isinstance(file.programs, DenseFile):
        robustness = "at the last time for which it is settled"
    meanings: Mapping[str, tuple[VariableType, str]] = {
        "robustness": ("real", f"the robustness {robustness}"),
        "lower": ("real", "the least robustness over all continuations and ends"),
        "upper": ("real", "the greatest robustness over all continuations and ends"),
        "verdict": ("integer", "-1 violated, 0 undecided, 1 satisfied"),
    }
    for name, (kind, meaning) in meanings.items():
        yield UnitVariable(name, RESERVED.index(name), kind, "output", None, meaning)
    stop = "stop_on_violation"
    meaning = "whether the simulation ends when a violation is certain"
    yield UnitVariable(stop, RESERVED.index(stop), "boolean", "parameter", file.stop, meaning)


def _of_text(
    file: ProgramFile,
    formulas: Mapping[str, str],
    ranges: Mapping[str, tuple[float, float]],
) -> Iterator[UnitVariable]:
    reference = count(FIRST)
    parts: tuple[tuple[Causality, str], ...] = (
        ("input", "a variable of the specification"),
        ("parameter", "a constant of the specification"),
        ("local", "a constant in a bound of an interval, which cannot be set"),
    )
    for (causality, meaning), named in zip(
        parts, (file.inputs, file.parameters, file.fixed), strict=True
    ):
        for each in named:
            within = ranges.get(each.name) if causality == "input" else None
            yield UnitVariable(
                each.name, next(reference), "real", causality, each.start, meaning, within
            )
    for name in file.formulas:
        yield UnitVariable(name, next(reference), "real", "output", None, formulas[name])
