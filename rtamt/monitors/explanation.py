"""The samples that decided a robustness, and the sub-formulas through which they did.

Robustness is made of the values of predicates by min, max and a change of sign: it *is* one of
them, or its opposite. `explain` follows it from the root down; `rtamt.monitors.provenance` finds
the operand and the sample from which one formula at one sample has its value.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from numbers import Real
from typing import NamedTuple, SupportsIndex, Unpack

import numpy as np

from rtamt.errors import InputError, InputTypeError, brief
from rtamt.inputs.arrays import Floats, kind_of
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.parser import as_specification
from rtamt.language.printing import number_text
from rtamt.language.specification import Specification
from rtamt.language.table import Bounds, Operator
from rtamt.machines.backend import BACKENDS
from rtamt.machines.offline import run_outputs
from rtamt.monitors.circumstances import Share, ShareRole, beside
from rtamt.monitors.evaluation import whole_trace
from rtamt.monitors.explanation_text import as_text
from rtamt.monitors.options import SampleOptions, Spec, compiled, listed_in_signature
from rtamt.monitors.provenance import (
    FIRST_BEST,
    Origin,
    Visit,
    holds_by_sign,
    named,
    visits,
)
from rtamt.monitors.sample_provenance import origin_of
from rtamt.program.instructions import Map, operands
from rtamt.program.interface import PredicateValue
from rtamt.program.program import Program
from rtamt.program.timing import Align, Period, alignment, samples

__all__ = [
    "Cause",
    "Circumstance",
    "Explanation",
    "ExplanationStep",
    "explain",
    "idle_registers",
    "with_all_named",
]


class Cause(NamedTuple):
    """A value that a variable had at a sample."""

    variable: str
    sample: int
    value: float


@dataclass(frozen=True, slots=True)
class ExplanationStep:
    """A formula on the way from the specification down to what decided its robustness.

    Attributes:
        formula: The formula.
        name: Its name in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        sample: The sample at which it was evaluated.
        time: The time of that sample in seconds; None without a period.
        value: Its robustness at that sample.
        witness: For ``until``, ``since`` and ``unless``: the sample at which the right side was
            reached, whichever side decided, or which comes nearest to that where the formula fails;
            None if there is none.
        outside: First and last sample of the formula's window if the window lies outside the trace
            and that decided: the formula is then +inf or -inf whatever the samples are. The first
            is None for a window without a beginning, the last for one without an end.
        reading: What a predicate counts under the semantics: its usual ``"value"``, +inf or -inf
            by its ``"sign"``, or ``"zero"``.
        aligned: What the operator's interval became under ``align=``; None if its bounds fit.
    """

    formula: Formula
    name: str | None
    text: str
    sample: int
    time: float | None
    value: float
    witness: int | None = None
    outside: tuple[int | None, int | None] | None = None
    reading: PredicateValue = "value"
    aligned: str | None = None


@dataclass(frozen=True, slots=True)
class Circumstance:
    """A formula that has a share in a violation, beside those that decided its robustness.

    Of a response that was violated the request has one, and so has the answer that was missing;
    of an ``until`` the left side that broke, and the right side that was not reached before.

    Attributes:
        formula: The formula.
        name: Its name in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        role: ``"held"``: it holds at all samples of ``window``. ``"missing"``: it fails at all of
            them, and one could have prevented the violation. ``"broken"``: it fails, and had to
            hold on a stretch of samples.
        window: First and last of the samples.
        sample: The one of them at which it comes nearest to the other sign, the first of these.
        value: Its robustness there.
        outside: First and last sample of the formula's window if that lies outside the trace; see
            `ExplanationStep`.
    """

    formula: Formula
    name: str | None
    text: str
    role: ShareRole
    window: tuple[int, int]
    sample: int
    value: float
    outside: tuple[int | None, int | None] | None = None


@dataclass(frozen=True)
class Explanation:
    """The formulas and samples that decided a robustness.

    ``str`` gives a table of at most 80 columns.

    Attributes:
        steps: From the specification down; each step takes its value, or the opposite, from the
            step below it. The last step is the predicate that decided, ``true`` or ``false``, or
            a temporal operator whose window lies outside the trace.
        causes: The variables of that predicate with their values at the sample of the last step;
            empty if a window outside the trace decided.
        period: Seconds between samples, or None.
        start: Time of the first sample in seconds.
        circumstances: What else a violation stands on; empty if the robustness is not of one. The
            violation stays as long as the last step and these keep their signs.
    """

    steps: tuple[ExplanationStep, ...]
    causes: tuple[Cause, ...]
    period: float | None = None
    start: float = 0.0
    circumstances: tuple[Circumstance, ...] = ()

    @property
    def robustness(self) -> float:
        """The robustness that is explained."""
        return self.steps[0].value

    @property
    def sample(self) -> int:
        """The sample whose robustness is explained."""
        return self.steps[0].sample

    @property
    def predicate(self) -> Formula | None:
        """The predicate that decided; None if a window outside the trace did."""
        last = self.steps[-1]
        return last.formula if last.outside is None else None

    def __str__(self) -> str:
        samples = [step.sample for step in self.steps]
        aligned = [step.aligned for step in self.steps]
        return as_text(
            *(self.steps, samples, self.causes, self._at),
            [(each, each.sample, each.window) for each in self.circumstances],
            aligned=aligned,
        )

    def _at(self, sample: int) -> str:
        if self.period is None:
            return f"sample {sample}"
        time = self.start + sample * self.period
        # As many digits as tell two samples apart.
        count = max(abs(time) / self.period, 1.0)
        if count > _MOST:
            return f"{number_text(time)} s"
        return f"{time:.{max(int(math.log10(count)) + 3, 6)}g} s"


_MOST = 1e14
"""Doubles have too few digits to tell the times of so many samples apart."""


@listed_in_signature(SampleOptions)
def explain(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    sample: SupportsIndex = 0,
    start: float = 0.0,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> Explanation:
    """Which sub-formulas and samples decided the robustness at one sample of a whole trace.

    The robustness is the value of one predicate at one sample, or its opposite; the explanation is
    the way there, from the specification down. Where values are equal, the first operand decides,
    and of its samples the first. The robustness does not change as long as the deciding value stays
    and no other value of a predicate crosses it or its opposite; and it follows the deciding value
    up to the next such value.

    Where a window lies outside the trace, ``always`` is +inf and ``eventually`` -inf whatever the
    samples are; if that decided, the explanation ends with the operator and has no causes.

    Args:
        spec: Text, a formula, or a parsed specification.
        data: As for `evaluate`.
        period: As for `Monitor`.
        sample: The sample whose robustness is explained, from 0.
        start: Time of the first sample in seconds, for the times of the explanation.
        n: The length, for a formula without variables.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`.

    Raises:
        SpecificationError: As for `evaluate`.
        InputError: As for `evaluate`, and if the trace has no such sample, or ``start`` is not
            finite.
        InputTypeError: As for `evaluate`, and if ``sample`` is not a whole number or ``start`` not
            a number.

    Example:
        >>> trace = {"req": [0, 4, 0, 0, 0], "gnt": [5, 0, 0, 1, 4]}
        >>> e = explain("always(req >= 3 implies eventually[0:2](gnt >= 3))", trace)
        >>> print(e)
        robustness -1 at sample 0, decided by req >= 3 at sample 1
        <BLANKLINE>
              at  value  formula
        sample 0     -1  always(req >= 3 implies eventually[0:2](gnt >= 3))
        sample 1     -1  req >= 3 implies eventually[0:2](gnt >= 3)
        sample 1      1  req >= 3
        sample 1      4  req
        sample 3     -2  missing: gnt >= 3
                           nowhere from sample 1 to sample 3; this is the nearest
        >>> e.predicate, e.causes
        (<Formula req >= 3>, (Cause(variable='req', sample=1, value=4.0),))

    Source: the arguments of the minima and maxima in the robustness of Fainekos and Pappas,
    "Robustness of temporal logic specifications for continuous-time signals", TCS 2009.
    """
    specification = as_specification(spec)
    start = _time(start)
    names, observed = with_all_named(specification)
    _, interface, backend, nan, seconds, program = compiled(
        explain, observed, period, options, online=False
    )
    reader = SampleReader(program, nan)
    columns, length = whole_trace(reader, data, n, period)
    at = _place(sample, length)
    # What the result does not need decides nothing, and may have no value.
    idle, unknown = idle_registers(program), np.full(length, math.nan)
    outputs = {n: program.outputs[n] for n in names if program.outputs[n] not in idle}
    program = program.restricted(program.result, outputs)
    machine = BACKENDS[backend].discrete_machine
    values = run_outputs(program, reader, machine, columns, length)
    robustness: dict[Node, Floats] = {f: values.get(name, unknown) for name, f in names.items()}
    course = _Course(specification, robustness, seconds, options.get("align"))
    way = list(visits(specification, interface, at, course.origin))
    steps = tuple(
        ExplanationStep(
            *(visit.formula, visit.name, visit.text, visit.place),
            None if seconds is None else start + float(visit.place * seconds),
            float(robustness[visit.formula][visit.place]),
            visit.origin.witness,
            visit.origin.outside,
            visit.reading,
            course.aligned(visit.formula),
        )
        for visit in way
    )
    violated = not holds_by_sign(steps[0].value)
    circumstances = tuple(map(course.circumstance, course.beside(way) if violated else ()))
    formula, at = steps[-1].formula, steps[-1].sample
    causes: tuple[Cause, ...] = ()
    if steps[-1].outside is None:
        columns_of = dict(zip(program.variables, columns, strict=True))
        rates = {
            n.args[0].leaf for n in formula.nodes() if n.op is not None and n.op.name == "rate"
        }
        causes = tuple(
            Cause(v, i, float(columns_of[v][i]))
            for v in formula.variables
            for i in ([at - 1, at] if v in rates and at else [at])
        )
    period = None if seconds is None else float(seconds)
    return Explanation(steps, causes, period, start, circumstances)


def with_all_named(specification: Specification) -> tuple[dict[str, Formula], Specification]:
    """Names for all formulas in a specification, which no formula has, and it with them."""
    formulas = [node for node in specification.formula.nodes() if isinstance(node, Formula)]
    names = {f"#{i}": formula for i, formula in enumerate(formulas)}
    return names, replace(specification, formulas={**specification.formulas, **names})


def idle_registers(program: Program) -> set[int]:
    """The registers with a term that the result does not need, and that may thus be nan."""
    needed = program.needed(program.result)
    found: set[int] = set()
    for register, instruction in enumerate(program.instructions):
        term = register < program.terms and isinstance(instruction, Map)
        if (term and register not in needed) or not found.isdisjoint(operands(instruction)):
            found.add(register)
    return found


def _time(start: float) -> float:
    if not isinstance(start, Real) or isinstance(start, np.timedelta64):
        raise InputTypeError(
            f"expected the time of the first sample in seconds as start, got {kind_of(start)}"
        )
    try:
        time = float(start)
    except OverflowError:
        time = math.inf
    if not math.isfinite(time):
        raise InputError(f"expected a finite time of the first sample as start, got {brief(start)}")
    return time


def _place(sample: SupportsIndex, length: int) -> int:
    try:
        at = operator.index(sample)
    except TypeError:
        raise InputTypeError(
            f"expected the number of a sample, got {type(sample).__name__} {brief(sample)}"
        ) from None
    if not 0 <= at < length:
        raise InputError(f"expected a sample from 0 to {length - 1}, got {brief(at)}")
    return at


class _Course(NamedTuple):
    """The robustness of every formula at every sample, and how intervals become samples."""

    specification: Specification
    robustness: Mapping[Node, Floats]
    period: Fraction | None
    align: Align | None

    def bounds(self, formula: Formula) -> Bounds:
        error = functools.partial(self.specification.error, formula)
        unit = self.specification.unit
        return samples(formula.interval, self.period, unit, error, self.align)

    def aligned(self, formula: Formula) -> str | None:
        """What the interval of an operator became; None if its bounds fit."""
        if formula.op is None or not formula.op.timed:
            return None
        unit = self.specification.unit
        return alignment(formula.interval, self.period, unit, self.bounds(formula))

    def origin(
        self, formula: Formula, row: Operator, sample: int, *, earliest: bool = False
    ) -> Origin:
        bounds = self.bounds(formula) if row.timed else None
        operands = [self.robustness[arg] for arg in formula.args]
        return origin_of(row, bounds, operands, sample, earliest=earliest)

    def beside(self, way: Sequence[Visit]) -> Iterator[Share]:
        """What else the violation of a way stands on."""
        origin = functools.partial(self.origin, earliest=True)
        return beside(way, origin, lambda formula, i: float(self.robustness[formula][i]))

    def circumstance(self, share: Share) -> Circumstance:
        values = self.robustness[share.formula][share.first : share.last + 1]
        place = FIRST_BEST["min" if share.role == "held" else "max"](values)
        name, text = named(self.specification, share.formula)
        window, sample = (share.first, share.last), share.first + place
        its = (share.formula, name, text, share.role, window, sample, float(values[place]))
        return Circumstance(*its, share.outside)
