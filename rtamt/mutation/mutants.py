"""`mutants` changes a requirement in one place; `killed` tests which mutants a trace kills."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Unpack

from rtamt.errors import (
    InputError,
    RtamtError,
    SpecificationError,
    alternatives,
    is_one_of,
    nearest,
)
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula, conjunction
from rtamt.language.parser import as_specification, parse_as
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.machines.state import verdict_of
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.judgement import judge
from rtamt.monitors.options import SampleOptions, checked_end, compiled, listed_in_signature
from rtamt.monitors.verdict import Verdict
from rtamt.mutation.mutations import MUTATIONS, Mutation
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period, as_period
from rtamt.renamed import OldName, old_keywords

if TYPE_CHECKING:  # it loads the parser
    from rtamt.mutation.requirement_text import Change

_DECIDED = {Verdict.SATISFIED, Verdict.VIOLATED}


@dataclass(frozen=True, slots=True)
class Mutant:
    """A requirement with one change.

    Attributes:
        kind: The kind of the change, a name in `MUTATIONS`.
        line: The line of the change in the text, from 1.
        column: The column, from 1.
        before: The text before the change.
        after: The text after the change; empty if nothing is left.
        requirement: The requirement.
        specification: The requirement with the change.
    """

    kind: str
    line: int
    column: int
    before: str
    after: str
    requirement: Specification
    specification: Specification

    apart = OldName("distance")

    @property
    def distance(self) -> Specification:
        """``requirement iff mutant``, which a trace violates if one holds and the other fails.

        The absolute value of its robustness is the smaller of the two margins, so a search for the
        minimum robustness finds traces that kill the mutant.
        """
        changed = self.specification.standalone()
        return self.requirement.with_result(self.requirement.standalone().iff(changed))

    def __str__(self) -> str:
        return f"{self.line}:{self.column} {self.before} -> {self.after or 'nothing'}"


@old_keywords
def mutants(
    spec: str | Formula | Specification,
    period: Period | None = None,
    *,
    kinds: Collection[str] | None = None,
    limit: int | None = None,
) -> tuple[Mutant, ...]:
    """Return versions of a requirement with one change of a bound, threshold, operator or part.

    A suite of traces tests a place of the text if the change alters the verdict of at least one
    trace. A change is in one place: a formula that is named twice changes for both uses. Changes
    that keep the formula, give no specification or repeat another mutant are left out.

    Args:
        spec: Text, a formula, or a parsed specification; the changes are in its result.
        period: Seconds between samples; bounds move by a sample. None: bounds move by one unit of
            their last digit, which is a sample if bounds count samples.
        kinds: The kinds of changes, names in `MUTATIONS`; None: all.
        limit: The maximum number of mutants, taken from each kind in turn. None: all.

    Returns:
        The mutants, in the order of the text.

    Raises:
        InputError: If a kind is unknown, or ``limit`` is below 1.

    Example:
        >>> import rtamt
        >>> for mutant in rtamt.mutants("always[0:5](v < 35)", kinds=["window", "direction"]):
        ...     print(f"{mutant}: {mutant.specification}")
        1:10 [0:5] -> [0:2]: always[0:2](v < 35)
        1:10 [0:5] -> [0:10]: always[0:10](v < 35)
        1:10 [0:5] -> [0:50]: always[0:50](v < 35)
        1:15 v < 35 -> v > 35: always[0:5](v > 35)

    References:
        See `rtamt.mutation.mutations`.
    """
    from rtamt.mutation.requirement_text import RequirementText

    rows = _rows(kinds)
    if limit is not None and limit < 1:
        msg = f"limit: expected 1 mutant or more, got {limit}"
        raise InputError(msg)
    spec = _as_read(as_specification(spec))
    text = RequirementText(spec, as_period(period))
    by_formula: dict[Formula, Mutant] = {}
    for kind, change in _in_turn([(row, row.changes(text)) for row in rows]):
        if len(by_formula) == limit:
            break
        changed = _changed(spec, change)
        if changed is None or changed.formula in (spec.formula, *by_formula):
            continue
        by_formula[changed.formula] = Mutant(
            kind, change.line, change.column, change.before, change.after, spec, changed
        )
    ranks = [*MUTATIONS]
    ordered = sorted(by_formula.values(), key=lambda m: (m.line, m.column, ranks.index(m.kind)))
    return tuple(ordered)


def _rows(kinds: Collection[str] | None) -> Sequence[Mutation]:
    for kind in kinds or ():
        if not is_one_of(kind, MUTATIONS):
            known = nearest(kind, MUTATIONS) or f"; they are {alternatives(MUTATIONS)}"
            msg = f"expected a kind of mutants, got {kind!r}{known}"
            raise InputError(msg)
    return [row for name, row in MUTATIONS.items() if kinds is None or name in kinds]


def _as_read(spec: Specification) -> Specification:
    """Return the specification that the text describes; a formula from Python gets a new text."""
    from_text = _read(spec, spec.text)
    if from_text == spec:
        return _single(from_text)
    printed = spec.with_result(spec.formula)
    return _single(_read(printed, printed.text) or printed)


def _single(spec: Specification) -> Specification:
    """Return the result without the other requirements of the text."""
    parts = spec.requirements.values()
    return next((part for part in parts if part.formula is spec.formula), spec)


def _read(
    spec: Specification, text: str, constant: tuple[str, Fraction] | None = None
) -> Specification | None:
    """Return the requirement that a changed text describes, or None if the text is wrong."""
    values = dict(spec.overrides) | dict([constant] if constant else [])
    try:
        changed = parse_as(text, spec.unit, values, None, chains=spec.chains)
    except SpecificationError:
        return None
    if spec.requirement is not None:
        changed = changed.requirements[spec.requirement]
    return replace(changed, types=spec.types)


def _changed(spec: Specification, change: Change) -> Specification | None:
    text = spec.text[: change.begin] + change.new + spec.text[change.end :]
    changed = _read(spec, text, change.constant)
    return None if changed is None else _single(changed)


def _in_turn(
    rows: Sequence[tuple[Mutation, Iterator[Change]]],
) -> Iterator[tuple[str, Change]]:
    """Yield the first change of each row, then the second of each, and so on."""
    while rows:
        remaining = []
        for row, changes in rows:
            change = next(changes, None)
            if change is not None:
                yield row.name, change
                remaining.append((row, changes))
        rows = remaining


@listed_in_signature(SampleOptions)
def killed(
    mutants: Sequence[Mutant],
    signals: TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> tuple[bool, ...]:
    """Return whether a trace kills each mutant: it satisfies one of mutant and requirement only.

    The verdicts equal those of `judge` and cost less: shared comparisons are evaluated once, and
    only the verdict is computed. A mutant that cannot be judged is not killed.

    Args:
        mutants: Mutants, as `mutants` returns them.
        signals: As for `judge`.
        period: As for `judge`.
        end: As for `judge`.
        n: As for `judge`.
        **options: As for `judge`.

    Raises:
        SpecificationError: As for `judge` of the requirement.
        InputError: As for `judge` of the requirement.
        InputTypeError: As for `judge` of the requirement.

    Example:
        >>> import rtamt
        >>> several = rtamt.mutants("always[0:5](v < 35)", kinds=["window", "direction"])
        >>> trace = {"v": [9] * 8 + [40] * 43}
        >>> for mutant, killed in zip(several, rtamt.mutation.killed(several, trace), strict=True):
        ...     print(f"{mutant}: {'killed' if killed else 'survived'}")
        1:10 [0:5] -> [0:2]: survived
        1:10 [0:5] -> [0:10]: killed
        1:10 [0:5] -> [0:50]: killed
        1:15 v < 35 -> v > 35: killed
    """
    end = checked_end(end)
    killed = [False] * len(mutants)
    for requirement in dict.fromkeys(mutant.requirement for mutant in mutants):
        places = [i for i, mutant in enumerate(mutants) if mutant.requirement == requirement]
        specs = [mutants[i].specification for i in places]
        first, *others = _verdicts(requirement, specs, signals, period, end, n, options)
        for position, verdict in zip(places, others, strict=True):
            killed[position] = {verdict, first} == _DECIDED
    return tuple(killed)


def _verdicts(
    requirement: Specification,
    mutants: Sequence[Specification],
    signals: TraceColumns,
    period: Period | None,
    end: End,
    n: int | None,
    options: SampleOptions,
) -> list[Verdict | None]:
    """Return the verdicts of a requirement and its mutants; None for mutants without a verdict."""
    _, interface, backend, nan, seconds, align, program = compiled(
        killed, requirement, period, options, online=False
    )

    def program_of(spec: Specification) -> Program | None:
        try:
            return compile_program(spec, seconds, interface=interface, align=align)
        except SpecificationError:  # for instance, bounds that are not whole samples
            return None

    programs = [program, *map(program_of, mutants)]
    known = [s for s, p in zip((requirement, *mutants), programs, strict=True) if p is not None]
    together = replace(requirement, formula=conjunction([spec.formula for spec in known]))
    joint = compile_program(together, seconds, interface=interface, align=align)
    reader = SampleReader(joint, nan, bounds=True)
    lower, upper, length = trace_between(reader, signals, n, period)
    try:
        bounds = TraceBounds.of(joint, reader, BACKENDS[backend], (lower, upper), length)
        return [
            None if part is None else Verdict(verdict_of(*bounds.part(part).bounds(end)))
            for part in programs
        ]
    except RtamtError:  # a term is nan
        first = judge(requirement, signals, period, end, n=n, **options).verdict
        return [first, *(_verdict(mutant, signals, period, end, n, options) for mutant in mutants)]


def _verdict(
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
