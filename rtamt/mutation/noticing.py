"""`noticed`: which mutants a trace tells from their requirement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

from rtamt.errors import RtamtError, SpecificationError
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import conjunction
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.judgement import judge
from rtamt.monitors.options import SampleOptions, checked_end, compiled, listed_in_signature
from rtamt.monitors.verdict import Verdict
from rtamt.mutation.mutants import Mutant
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["noticed"]

_DECIDED = {Verdict.SATISFIED, Verdict.VIOLATED}


@listed_in_signature(SampleOptions)
def noticed(
    mutants: Sequence[Mutant],
    signals: TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> tuple[bool, ...]:
    """Whether a trace notices mutants: satisfies the requirement and violates the mutant, or back.

    It is what `judge` says of each of them, at less cost: comparisons that they share are evaluated
    once, and nothing but the verdict is found. A mutant that cannot be judged is not noticed.

    Args:
        mutants: Mutants, as `mutants` makes them.
        signals: As for `judge`.
        period: As for `judge`.
        end: As for `judge`.
        n: As for `judge`.
        **options: As for `judge`.

    Raises:
        SpecificationError: As `judge` of the requirement.
        InputError: As `judge` of the requirement.
        InputTypeError: As `judge` of the requirement.

    Example:
        >>> import rtamt
        >>> made = rtamt.mutants("always[0:5](v < 35)", kinds=["window", "direction"])
        >>> trace = {"v": [9] * 8 + [40] * 43}
        >>> for mutant, found in zip(made, noticed(made, trace), strict=True):
        ...     print(f"{mutant}: {'noticed' if found else 'not noticed'}")
        1:10 [0:5] -> [0:2]: not noticed
        1:10 [0:5] -> [0:10]: noticed
        1:10 [0:5] -> [0:50]: noticed
        1:15 v < 35 -> v > 35: noticed
    """
    reading = checked_end(end)
    found = [False] * len(mutants)
    for requirement in dict.fromkeys(mutant.requirement for mutant in mutants):
        places = [i for i, mutant in enumerate(mutants) if mutant.requirement == requirement]
        specs = [mutants[i].specification for i in places]
        verdicts = _verdicts(requirement, specs, signals, period, reading, n, options)
        for place, verdict in zip(places, verdicts[1:], strict=True):
            found[place] = {verdict, verdicts[0]} == _DECIDED
    return tuple(found)


def _verdicts(
    requirement: Specification,
    mutants: Sequence[Specification],
    signals: TraceColumns,
    period: Period | None,
    end: End,
    n: int | None,
    options: SampleOptions,
) -> list[Verdict | None]:
    """The verdicts of a requirement and its mutants; None of those that cannot be judged."""
    _, interface, backend, nan, seconds, program = compiled(
        noticed, requirement, period, options, online=False
    )
    align = options.get("align")

    def made(spec: Specification) -> Program | None:
        try:
            return compile_program(spec, seconds, interface=interface, align=align)
        except SpecificationError:  # its bounds are no whole number of samples, for instance
            return None

    programs = [program, *map(made, mutants)]
    known = [s for s, p in zip((requirement, *mutants), programs, strict=True) if p is not None]
    together = replace(requirement, formula=conjunction([spec.formula for spec in known]))
    joint = compile_program(together, seconds, interface=interface, align=align)
    reader = SampleReader(joint, nan, bounds=True)
    least, greatest, length = trace_between(reader, signals, n, period)
    its = BACKENDS[backend]
    columns = least, greatest
    try:
        machine, ranges = its.discrete_machine, its.term_ranges
        whole = TraceBounds.of(joint, reader, machine, ranges, columns, length)
        return [
            None if each is None else Verdict(verdict_of(*whole.part(each).bounds(end)))
            for each in programs
        ]
    except RtamtError:  # a term of one of them is no number
        first = judge(requirement, signals, period, end, n=n, **options).verdict
        return [first, *(_alone(each, signals, period, end, n, options) for each in mutants)]


def _alone(
    spec: Specification,
    signals: TraceColumns,
    period: Period | None,
    end: End,
    n: int | None,
    options: SampleOptions,
) -> Verdict | None:
    try:
        return judge(spec, signals, period, end, n=n, **options).verdict
    except RtamtError:
        return None
