"""`examples`: traces that satisfy and violate requirements, to read before they are trusted."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Final

from rtamt.checking.answers import Answer, Says, worst
from rtamt.checking.goal_monitors import GoalMonitors
from rtamt.checking.kinds import ExampleKind, Sought, kinds_of
from rtamt.checking.limits import ValueRange
from rtamt.checking.plain import Plainness, made_plain
from rtamt.checking.questions import prepared
from rtamt.checking.search import WitnessSearch
from rtamt.checking.witness import ExampleTrace, Goal
from rtamt.errors import InputError, SpecificationError
from rtamt.language.formula import Formula
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.monitors.judgement import judge
from rtamt.monitors.options import Spec, checked_end
from rtamt.monitors.verdict import Verdict
from rtamt.program.instructions import Window
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["Example", "RequirementExamples", "examples"]

_CONTEXT: Final = 3
"""The fewest samples that are shown of a requirement with a window without end, or of the past."""

_PROVED: Final = 64
"""The most samples of a violation of which each shorter length is tried."""


@dataclass(frozen=True, slots=True)
class Example:
    """A trace that shows something about a requirement.

    Attributes:
        kinds: What it shows.
        why: The same in a sentence.
        verdict: SATISFIED or VIOLATED, as `judge` says.
        robustness: The robustness that `judge` gives; None of a trace that repeats for ever.
        trace: The trace.
    """

    kinds: tuple[ExampleKind, ...]
    why: str
    verdict: Verdict
    robustness: float | None
    trace: ExampleTrace


@dataclass(frozen=True, slots=True)
class RequirementExamples:
    """The examples of a requirement.

    Attributes:
        text: The requirement.
        period: Seconds between samples; None: bounds are numbers of samples.
        satisfiable: Whether a trace satisfies it.
        falsifiable: Whether a trace violates it; if none does, it demands nothing.
        examples: The examples, the most telling first.
        missing: What no trace shows: that an implication is answered, or not answered.
        unknown: What the solver does not know, and why.
    """

    text: str
    period: Fraction | None
    satisfiable: Answer
    falsifiable: Answer
    examples: tuple[Example, ...] = ()
    missing: tuple[str, ...] = ()
    unknown: Mapping[str, str] = field(default_factory=dict)

    @property
    def satisfied(self) -> tuple[Example, ...]:
        """The examples that satisfy it."""
        return tuple(each for each in self.examples if each.verdict is Verdict.SATISFIED)

    @property
    def violated(self) -> tuple[Example, ...]:
        """The examples that violate it."""
        return tuple(each for each in self.examples if each.verdict is Verdict.VIOLATED)

    @property
    def says(self) -> Says:
        """``"yes"`` if traces satisfy and violate it, ``"no"`` if not, or ``"unknown"``."""
        return worst([self.satisfiable.says, self.falsifiable.says])


def examples(
    specs: Spec | Mapping[str, Spec],
    period: Period | None = None,
    *,
    count: int = 10,
    end: End = "cut",
    assume: Spec | None = None,
    rates: Mapping[str, ValueRange] | None = None,
    horizon: int = 1000,
    timeout: float = 10.0,
) -> dict[str, RequirementExamples]:
    """Traces that satisfy and violate requirements, as different as they can be.

    They are near misses: each differs from a trace of the other verdict in one respect, which it
    is there for. An answer comes at the last moment if the requirement would be violated with a
    window one sample shorter; a comparison just holds if it would not with a threshold one unit
    further. The traces are found with Z3, made plain (few changes, round numbers), and judged by
    `judge`. The same arguments give the same traces, unless time is over.

    Args:
        specs: A specification, whose requirements are shown, or several by name.
        period: Seconds between samples; None: bounds are numbers of samples.
        count: The most examples of a requirement.
        end: How the end of a trace is read, as in `judge`.
        assume: What holds of every trace, such as ``always(abs(x) < 3)``. Ranges that variables
            are declared with are assumed too.
        rates: How fast variables change, as for `check`.
        horizon: The most samples of a trace.
        timeout: The most seconds for a requirement's satisfaction, for its violation, and for all
            that is shown beside.

    Returns:
        The examples of each requirement, by its name.

    Raises:
        ModuleNotFoundError: If Z3 is not installed, which the extra ``check`` does.
        SpecificationError: If a requirement cannot be compiled: bounds that are no whole samples.
        InputError: If the count or the horizon is below 1, the timeout not above 0, there is no
            requirement, or no trace fulfils what is assumed.

    Example:
        >>> import rtamt
        >>> text = "always(req >= 3 implies eventually[0:5](gnt >= 3))"
        >>> for each in rtamt.examples(text, count=5)["spec"].examples:
        ...     print(f"{each.robustness:g}, {each.why}")
        1, asked and answered
        -1, the shortest violation; asked and not answered
        3, never asked
        1, gnt >= 3 comes at the last moment of eventually[0:5]
        -1, gnt >= 3 comes one sample too late for eventually[0:5]
    """
    if count < 1:
        msg = f"count: expected 1 example or more, got {count}"
        raise InputError(msg)
    named, seconds, search, given = prepared(specs, period, end, assume, horizon, timeout, rates)
    assumed = [each.program.specification.formula for each in given]
    shown = {}
    for name, spec in named.items():
        plainness = Plainness([spec.formula, *assumed], search.whole, search.limits.ranges)
        shower = _Shower(spec, seconds, search, given, plainness, checked_end(end), horizon)
        shown[name] = shower.shown(count, timeout)
    return shown


class _Shower:
    """Finds the examples of one requirement."""

    def __init__(
        self,
        spec: Specification,
        period: Fraction | None,
        search: WitnessSearch,
        given: Sequence[Goal],
        plainness: Plainness,
        end: End,
        horizon: int,
    ) -> None:
        self._spec, self._period, self._search, self._given = spec, period, search, given
        self._plainness, self._end, self._horizon = plainness, end, horizon
        self._program = compile_program(spec, period)
        self._least = min(horizon, _context(self._program))

    def shown(self, count: int, timeout: float) -> RequirementExamples:
        """The examples, at most so many."""
        goals = {holds: self._goals([(self._program, holds)]) for holds in (True, False)}
        answers = {holds: Answer.of(self._search.find_short(each)) for holds, each in goals.items()}
        found: dict[object, Example] = {}
        missing: list[str] = []
        unknown: dict[str, str] = {}
        deadline = time.monotonic() + timeout
        for sought in kinds_of(self._spec.formula, self._period, self._spec.unit):
            if len(found) >= count:
                break
            first = answers[sought.holds]
            if first.trace is None:
                continue
            if sought.kind == "violated":
                short, as_shown = self._shortest(sought, goals[False], first.trace, deadline)
                self._keep(found, as_shown, short)
                continue
            trace, why = self._sought(sought, first.trace, deadline)
            if trace is None and why:
                unknown[sought.why] = why
            elif trace is None and sought.kind in {"answered", "unanswered"}:
                missing.append(sought.why)
            elif trace is not None:
                self._keep(found, sought, trace)
        shown = tuple(found.values())[:count]
        text = str(self._spec.standalone())
        return RequirementExamples(
            text, self._period, answers[True], answers[False], shown, tuple(missing), unknown
        )

    def _keep(self, found: dict[object, Example], sought: Sought, trace: ExampleTrace) -> None:
        """Adds an example, or what it shows to an equal one."""
        key = trace.samples, trace.loop, tuple(trace.columns.items())
        known = found.get(key)
        if known is not None:
            kinds = tuple(dict.fromkeys((*known.kinds, sought.kind)))
            found[key] = replace(known, kinds=kinds, why=f"{known.why}; {sought.why}")
            return
        robustness: float | None = None
        if not trace.loop:
            columns = {name: [*trace.columns[name]] for name in self._program.variables}
            n = None if columns else trace.samples
            judged = judge(self._spec, columns, self._period, self._end, n=n)
            robustness = judged.robustness
        verdict = Verdict.SATISFIED if sought.holds else Verdict.VIOLATED
        found[key] = Example((sought.kind,), sought.why, verdict, robustness, trace)

    def _goals(self, demands: Sequence[tuple[Program, bool]]) -> list[Goal]:
        return [*(Goal(program, holds) for program, holds in demands), *self._given]

    def _compiled(self, formulas: Sequence[tuple[Formula, bool]]) -> list[tuple[Program, bool]]:
        return [
            (compile_program(self._spec.with_result(formula), self._period), holds)
            for formula, holds in formulas
        ]

    def _sought(
        self, sought: Sought, known: ExampleTrace, deadline: float
    ) -> tuple[ExampleTrace | None, str]:
        """A trace that is as is sought; else why nobody knows, or nothing if there is none."""
        plain = [(self._program, sought.holds), *self._compiled(sought.also)]
        wished = self._compiled(sought.wished)
        why = ""
        for demands in [[*plain, *wished], plain] if wished else [plain]:
            goals = self._goals(demands)
            if not known.loop:
                for samples in self._lengths(known.samples):
                    trace, reason = self._search.of_length(goals, samples, deadline)
                    if trace is not None:
                        return self._plain(trace, goals), ""
                    why = why or reason
            if demands is plain:
                answer = self._search.find_short(goals)
                if answer.trace is not None:
                    return self._plain(answer.trace, goals), ""
                if answer.none or answer.samples:
                    return None, ""
                why = why or answer.why
        return None, why

    def _lengths(self, known: int) -> Iterator[int]:
        """Numbers of samples, from the least that shows the windows in full."""
        least = self._least
        tried = [least, least + 1, least + 2, 2 * least, known]
        yield from (each for each in dict.fromkeys(tried) if least <= each <= self._horizon)

    def _shortest(
        self, sought: Sought, goals: Sequence[Goal], known: ExampleTrace, deadline: float
    ) -> tuple[ExampleTrace, Sought]:
        """The shortest violation, or one of which that is not proved; and what it is."""
        proved = not known.loop and known.samples <= _PROVED
        shorter = range(1, known.samples) if proved else self._lengths(known.samples)
        for samples in () if known.loop else shorter:
            trace, why = self._search.of_length(goals, samples, deadline)
            proved = proved and not why
            if trace is not None:
                known = trace
                break
        return self._plain(known, goals), sought if proved else replace(sought, why="a violation")

    def _plain(self, trace: ExampleTrace, goals: Sequence[Goal]) -> ExampleTrace:
        """A plainer trace that the monitors judge alike, else the trace itself."""
        truths = self._search.truths(goals, trace.samples, trace.loop)
        judges = None
        if not trace.loop:
            with suppress(SpecificationError):  # they are for speed alone
                judges = GoalMonitors(goals, self._period, self._end, trace.samples)
        plain = made_plain(trace, self._search.graph, truths, self._plainness, judges)
        return plain if self._search.confirmed(plain, goals) else trace


def _context(program: Program) -> int:
    """How many samples show all windows that have an end in full."""
    reach: list[int] = []
    context = 1
    for instruction in program.instructions:
        below = max((reach[a] for a in getattr(instruction, "args", ())), default=0)
        if isinstance(instruction, Window):
            ahead, behind = max(instruction.hi or 0, 0), max(-(instruction.lo or 0), 0)
            if instruction.hi is None or instruction.lo is None or behind:
                context = _CONTEXT
            below += ahead + behind
        reach.append(below)
    return max(context, reach[program.result] + 1)
