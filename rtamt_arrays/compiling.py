"""The program of a specification, for whose arrays there is a library."""

from __future__ import annotations

from rtamt import Formula, Specification
from rtamt.language.parser import as_specification
from rtamt.program.lowering import compile_program, refuse_rates
from rtamt.program.program import Program
from rtamt.program.timing import as_align, as_period
from rtamt.typing import Align, Period

__all__ = ["Spec", "program_of"]

Spec = str | Formula | Specification
"""A specification: text, a formula made of combinators, or a parsed specification."""


def program_of(spec: Spec, period: Period | None, align: Align | None, *, online: bool) -> Program:
    """The program that computes the robustness of a specification under standard semantics.

    Args:
        spec: What to compile.
        period: Seconds between samples; None: bounds are in samples.
        align: How bounds that are no whole number of samples become one; None refuses them.
        online: Whether a future without an end is refused.
    """
    specification = as_specification(spec)
    refuse_rates(specification, "rtamt_arrays")
    program = compile_program(
        specification, as_period(period), align=as_align(align), online=online
    )
    return program.restricted(program.result, {})
