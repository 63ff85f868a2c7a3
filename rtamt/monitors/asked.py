"""What a verdict stands on: how often the implications of a formula were put to the test.

An implication is put to the test where the formula reads it and its left side holds for certain:
there its right side is needed. Where it never is, or where its right side does not matter, a
satisfied formula says less than it seems to (`rtamt.program.implications`).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, NamedTuple, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import NanPolicy, SampleReader
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.specification import Specification
from rtamt.language.table import Bounds
from rtamt.machines.backend import BACKENDS, BackendName
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.program.implications import (
    Counted,
    InstantRuns,
    Reads,
    Routes,
    TraceSpan,
    implications,
    unanswered,
)
from rtamt.program.interface import STANDARD, Interface
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Align, samples

__all__ = [
    "Asked",
    "AskedRow",
    "Evidence",
    "SampledQuestion",
    "asked_text",
    "evidence_of",
    "found_rows",
    "reads_hidden",
    "text_of",
    "texts_of",
]

_A = TypeVar("_A")


class _HasOccasions(Protocol):
    @property
    def occasions(self) -> int: ...


_AnyAsked = TypeVar("_AnyAsked", bound=_HasOccasions)


@dataclass(frozen=True, slots=True)
class Asked:
    """How often an implication was put to the test on a trace of samples.

    It is put to the test at the recorded samples at which the formula reads it and its left side
    holds for certain. ``str`` gives it in words, as in ``asked 2x, first at sample 1``.

    Attributes:
        text: The implication as text.
        samples: The number of these samples.
        occasions: The number of runs of neighbouring ones; one that begins the trace counts.
        first: The first of them; None if there is none.
        vacuous: Whether the verdict is SATISFIED and would be so with ``false`` as the right side
            of this implication, so that no answer mattered.
    """

    text: str
    samples: int
    occasions: int
    first: int | None
    vacuous: bool

    def __str__(self) -> str:
        first = None if self.first is None else f"sample {self.first}"
        return asked_text(self.occasions, first, vacuous=self.vacuous)


def asked_text(occasions: int, first: str | None, *, vacuous: bool) -> str:
    """How often an implication was put to the test, in words."""
    if first is None:
        return "never asked"
    answer = ", satisfied without an answer" if vacuous else ""
    return f"asked {occasions}x, first at {first}{answer}"


_NEVER: Counted = 0, 0, None


class Signs(Protocol):
    """Where a formula fails for certain, and whether it holds for certain."""

    def fails_at(self, instants: InstantRuns) -> Counted:
        """How often it fails at recorded ones of some instants."""

    def holds_at(self, instants: InstantRuns) -> bool:
        """Whether it holds at all of some instants, which have one or more."""


class Question(Protocol):
    """A trace that was judged, as far as its evidence needs it."""

    @property
    def formula(self) -> Formula: ...

    @property
    def extent(self) -> TraceSpan:
        """The instants of the trace."""

    @property
    def hides(self) -> bool:
        """Whether the semantics of the verdict hides values that left sides need."""

    def reads(self) -> Mapping[Formula, Reads]:
        """Where the formula reads its implications."""

    def opposite(self, left: Formula) -> Signs:
        """The signs of the opposite of a left side."""

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Whether the verdict is SATISFIED with ``false`` as the right side of implications."""


class AskedRow(NamedTuple):
    """An implication, and how often it was put to the test."""

    text: str
    asked: Counted
    vacuous: bool


@dataclass(frozen=True, slots=True)
class Evidence(Generic[_A]):
    """What a verdict stands on; made by `Implications`, and read in a `Judgement`.

    Attributes:
        asked: For each implication an `Asked` or a `DenseAsked`, in the order of the text, the
            outer one first.
        vacuous: Whether the verdict is SATISFIED and would be so with ``false`` as the right sides
            of all of them.
        never_asked: Whether the verdict is SATISFIED, there is an implication, and none was put to
            the test.
    """

    asked: tuple[_A, ...]
    vacuous: bool
    never_asked: bool

    @staticmethod
    def of(asked: Sequence[_AnyAsked], *, satisfied: bool, vacuous: bool) -> Evidence[_AnyAsked]:
        """What a verdict stands on, of which it is known whether it is SATISFIED."""
        never = satisfied and bool(asked) and not any(each.occasions for each in asked)
        return Evidence(tuple(asked), vacuous, never)


@functools.lru_cache(maxsize=512)
def text_of(formula: Formula) -> str:
    """The formula as text."""
    return str(formula)


def texts_of(formula: Formula) -> tuple[str, ...]:
    """The implications of a formula that count, as text."""
    return tuple(text_of(each) for each in implications(formula))


def found_rows(question: Question, *, satisfied: bool) -> tuple[list[AskedRow], bool]:
    """Where the implications of a formula were put to the test on a trace.

    Args:
        question: The trace.
        satisfied: Whether the verdict is SATISFIED.

    Returns:
        A row for each of them, and whether the verdict is SATISFIED with ``false`` as the right
        side of all of them.
    """
    formula = question.formula
    counted = implications(formula)
    if not counted:
        return [], False
    where = question.reads()
    rows, idle = [], []
    for each in counted:
        every, needed = where[each]
        if not every:
            rows.append(AskedRow(text_of(each), _NEVER, satisfied))
            idle.append(True)
            continue
        opposite = question.opposite(cast("Formula", each.args[0]))
        asked = opposite.fails_at(every)
        vacuous = False
        if satisfied:
            _, answers, _ = asked if needed == every else opposite.fails_at(needed)
            vacuous = not answers
            # Where the left side fails, the right side does not matter.
            idle.append(not asked[1] and not question.hides and opposite.holds_at(every))
            if vacuous and not idle[-1]:
                vacuous = question.satisfied_without((each,))
        rows.append(AskedRow(text_of(each), asked, vacuous))
    # The more of them are unanswered, the less is satisfied.
    vacuous = satisfied and all(row.vacuous for row in rows)
    if vacuous and len(rows) > 1 and not all(idle):
        vacuous = question.satisfied_without(counted)
    return rows, vacuous


class SampledQuestion(NamedTuple):
    """A trace of samples that was judged.

    Attributes:
        specification: The specification.
        period: Seconds between samples; None: bounds are in samples.
        align: How bounds became whole samples.
        interface: The semantics of the verdict.
        end: The reading of the end.
        n: How many samples.
        whole: The bounds of the whole formula; None: nobody needed them.
        columns: The least and the greatest values of every variable, one array if all values are
            known; None where ``whole`` is enough: it is there, and not `reads_hidden`.
        nan: What is made of a nan in the columns.
        backend: The back-end.
    """

    specification: Specification
    period: Fraction | None
    align: Align | None
    interface: Interface
    end: End
    n: int
    whole: TraceBounds | None
    columns: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]] | None
    nan: NanPolicy
    backend: BackendName

    @property
    def formula(self) -> Formula:
        """The formula that was judged."""
        return self.specification.formula

    @property
    def extent(self) -> TraceSpan:
        """The instants of the trace, which are samples."""
        return TraceSpan(self.n - 1, self.end == "complete", self.end == "cut")

    @property
    def hides(self) -> bool:
        """Whether the semantics of the verdict hides values that left sides need."""
        return reads_hidden(self.formula, self.interface)

    def reads(self) -> Mapping[Formula, Reads]:
        """Where the formula reads its implications."""
        return _reads(self.specification, self.period, self.align, self.extent)

    def opposite(self, left: Formula) -> Signs:
        """The signs of the opposite of a left side, by standard semantics."""
        of = self.specification, self.period, self.align
        if self.columns is None and self.whole is not None:
            # The opposite, as the whole formula may have no other predicates.
            program = _opposite(*of, self.interface, left)
            return _SampledSigns(self.whole.part(program), self.end)
        program = _opposite(*of, STANDARD, left)
        return _SampledSigns(self._bounds(program, everywhere=True), self.end)

    def satisfied(self) -> bool:
        """Whether the verdict is SATISFIED."""
        return self.satisfied_without(())

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Whether the verdict is SATISFIED with ``false`` as the right side of implications."""
        specification = _with_result(self.specification, unanswered(self.formula, answered))
        program = compile_program(
            specification, self.period, interface=self.interface, align=self.align
        )
        bounds = self.whole.part(program) if self.whole else self._bounds(program)
        return verdict_of(*bounds.bounds(self.end)) == 1

    def _bounds(self, program: Program, *, everywhere: bool = False) -> TraceBounds:
        """The bounds of a program of some of the variables."""
        assert self.columns is not None  # noqa: S101 - the whole is not there, or hides values
        made, n = BACKENDS[self.backend], self.n
        pairs = [self.columns[name] for name in program.variables]
        lower = upper = [low[:n] for low, _ in pairs]
        if any(low is not high for low, high in pairs):
            upper = [high[:n] for _, high in pairs]
        reader = SampleReader(program, self.nan, bounds=True)
        machines = made.discrete_machine, made.term_ranges
        return TraceBounds.of(program, reader, *machines, (lower, upper), n, everywhere=everywhere)


class _SampledSigns:
    def __init__(self, part: TraceBounds, end: End) -> None:
        self._part, self._end, self._last = part, end, part.n - 1

    @functools.cached_property
    def _fails(self) -> NDArray[np.bool_]:
        return self._part.fails(self._end)

    def fails_at(self, instants: InstantRuns) -> Counted:
        length = occasions = 0
        first = None
        for begin, final in instants:  # no run touches the next
            flags = self._fails[begin : int(min(final, self._last)) + 1]
            count = int(np.count_nonzero(flags))
            if not count:
                continue
            if first is None:
                first = begin + int(flags.argmax())
            length += count
            occasions += int(np.count_nonzero(flags[1:] > flags[:-1])) + int(flags[0])
        return length, occasions, first

    def holds_at(self, instants: InstantRuns) -> bool:
        if instants[-1][1] > self._last:
            return False
        holds = self._part.holds(self._end)
        return all(bool(holds[begin : int(final) + 1].all()) for begin, final in instants)


@functools.lru_cache(maxsize=512)
def _routes(specification: Specification, period: Fraction | None, align: Align | None) -> Routes:
    def bounds(node: Node) -> Bounds:
        error = functools.partial(specification.error, node)
        return samples(node.interval, period, specification.unit, error, align)

    return Routes(specification.formula, bounds)


@functools.lru_cache(maxsize=512)  # many traces have one length
def _reads(
    specification: Specification, period: Fraction | None, align: Align | None, extent: TraceSpan
) -> Mapping[Formula, Reads]:
    return _routes(specification, period, align).reads(extent)


@functools.lru_cache(maxsize=512)
def _opposite(
    specification: Specification,
    period: Fraction | None,
    align: Align | None,
    interface: Interface,
    left: Formula,
) -> Program:
    """The program of the opposite of a formula, with the variables of a specification."""
    opposite = specification.with_result(~left)
    return compile_program(opposite, period, interface=interface, align=align)


@functools.lru_cache(maxsize=512)
def _with_result(specification: Specification, formula: Formula) -> Specification:
    return specification.with_result(formula)


@functools.lru_cache(maxsize=512)
def reads_hidden(formula: Formula, interface: Interface) -> bool:
    """Whether a left side has a predicate that counts 0 by the semantics of the verdict."""
    if interface.semantics in ("standard", "boolean"):
        return False
    lefts = (each.args[0].nodes() for each in implications(formula))
    return any(
        interface.reading(node) == "zero"
        for nodes in lefts
        for node in nodes
        if node.op is not None and node.op.holds is not None
    )


def evidence_of(question: SampledQuestion, *, satisfied: bool) -> Evidence[Asked]:
    """What the verdict on a trace of samples stands on."""
    rows, vacuous = found_rows(question, satisfied=satisfied)
    asked = [Asked(text, *counted, its) for text, counted, its in rows]
    return Evidence.of(asked, satisfied=satisfied, vacuous=vacuous)
