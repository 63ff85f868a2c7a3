"""`examples`: traces that satisfy and violate requirements, to read before trusting them.

The examples are near misses. Each kind of example changes the formula in one place, and its trace
gives the formula and the changed formula different verdicts. That place alone decides the verdict:
if a trace satisfies a requirement, but would violate it with a window one sample shorter, the
answer comes at the last moment. Near misses teach a concept (Winston, "Learning structural
descriptions from examples", 1970).

To add a kind of example, add its name to `ExampleKind`, the change of one part that creates it to
`_changes`, its rank to `_ORDER`, and a row to the table in ``docs/checking.md``. `Plainness` in
`rtamt.checking.simplify` defines which values are plain.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from typing import Final, Literal, cast

from rtamt.checking.answers import Answer, AnswerWord, ExampleTrace, worst
from rtamt.checking.check import RequirementQuestions, answer_of
from rtamt.checking.encoding import ValueRange
from rtamt.checking.search import Goal
from rtamt.checking.simplify import GoalMonitors, Plainness, last_digit, simplified
from rtamt.errors import InputError, SpecificationError
from rtamt.language.formula import Formula, Term, make, number, replaced
from rtamt.language.interval import UNITS, Interval
from rtamt.language.node import Node
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.monitors.judgement import judge
from rtamt.monitors.options import Spec
from rtamt.monitors.verdict import Verdict
from rtamt.program.implications import implications, signs, unanswered
from rtamt.program.instructions import Window
from rtamt.program.program import Program
from rtamt.program.timing import Period
from rtamt.renamed import OldName

_CONTEXT: Final = 3
"""The minimum number of samples for a requirement with an unbounded window or a past operator."""

_MAX_PROVED: Final = 64
"""The maximum length of a violation that is proved to be the shortest by trying shorter ones."""

ExampleKind = Literal[
    "satisfied",
    "violated",
    "answered",
    "unanswered",
    "never asked",
    "last moment",
    "too late",
    "first moment",
    "too early",
    "threshold",
    "saved",
    "broken",
]
"""The point that an example makes.

``"satisfied"`` makes no special point, ``"violated"`` is the shortest violation; ``"answered"``,
``"unanswered"`` and ``"never asked"`` are about an implication; ``"last moment"``, ``"too late"``,
``"first moment"`` and ``"too early"`` about a window; ``"threshold"`` about a comparison at its
border; ``"saved"`` and ``"broken"`` about the only part of ``or`` and ``and`` that decides.
"""


@dataclass(frozen=True, slots=True)
class Example:
    """A trace that makes a point about a requirement.

    Attributes:
        kinds: The points that it makes.
        why: These points in words.
        verdict: SATISFIED or VIOLATED, as `judge` returns it.
        robustness: The robustness that `judge` returns; None for a trace that repeats for ever.
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
        falsifiable: Whether a trace violates it; otherwise, the requirement demands nothing.
        examples: The examples, the most informative first.
        missing: Points that no trace makes: that an implication is answered, or not answered.
        unknown: Points that the solver could not decide, with the reason.
    """

    text: str
    period: Fraction | None
    satisfiable: Answer
    falsifiable: Answer
    examples: tuple[Example, ...] = ()
    missing: tuple[str, ...] = ()
    unknown: Mapping[str, str] = field(default_factory=dict)

    says = OldName("answer")

    @property
    def satisfied(self) -> tuple[Example, ...]:
        """The examples that satisfy the requirement."""
        return tuple(example for example in self.examples if example.verdict is Verdict.SATISFIED)

    @property
    def violated(self) -> tuple[Example, ...]:
        """The examples that violate the requirement."""
        return tuple(example for example in self.examples if example.verdict is Verdict.VIOLATED)

    @property
    def answer(self) -> AnswerWord:
        """``"yes"`` if some traces satisfy it and some violate it, ``"no"``, or ``"unknown"``."""
        return worst([self.satisfiable.answer, self.falsifiable.answer])


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
    """Return traces that satisfy and violate requirements, as different as possible.

    The traces are near misses: each differs in one respect from a trace with the other verdict. An
    answer comes at the last moment if a window one sample shorter would be violated; a comparison
    just holds if it would fail with a threshold one unit further away. Z3 finds the traces. They
    are then simplified (few changes, round numbers) and judged by `judge`. The same arguments give
    the same traces, unless the timeout ends the search.

    Args:
        specs: A specification, or several by name; each requirement has its own examples.
        period: Seconds between samples; None: bounds are numbers of samples.
        count: The maximum number of examples for a requirement.
        end: The end mode, as in `judge`.
        assume: A condition that every trace satisfies, such as ``always(abs(x) < 3)``. The ranges
            of declarations are assumed too.
        rates: The minimum and maximum change of variables, as for `check`.
        horizon: The maximum number of samples of a trace.
        timeout: The maximum time to satisfy a requirement, to violate it, and for all other
            examples, in seconds each.

    Returns:
        The examples of each requirement, by its name.

    Raises:
        ModuleNotFoundError: If Z3 is not installed; the extra ``check`` installs it.
        SpecificationError: If a requirement cannot be compiled: bounds that are not whole samples.
        InputError: If the count or the horizon is below 1, the timeout is not above 0, the mapping
            is empty, or no trace satisfies the assumptions.

    Example:
        >>> import rtamt
        >>> text = "always(req >= 3 implies eventually[0:5](gnt >= 3))"
        >>> for example in rtamt.examples(text, count=5)["spec"].examples:
        ...     print(f"{example.robustness:g}, {example.why}")
        1, triggered and answered
        -1, the shortest violation; triggered and not answered
        3, never triggered
        1, gnt >= 3 comes at the last moment of eventually[0:5]
        -1, gnt >= 3 comes one sample too late for eventually[0:5]
    """
    if count < 1:
        msg = f"count: expected 1 example or more, got {count}"
        raise InputError(msg)
    questions = RequirementQuestions(specs, period, end, assume, horizon, timeout, rates)
    return {
        name: _ExampleSearch(spec, questions, horizon).examples(count, timeout)
        for name, spec in questions.specs.items()
    }


class _ExampleSearch:
    """The search for the examples of one requirement."""

    def __init__(self, spec: Specification, questions: RequirementQuestions, horizon: int) -> None:
        self._spec, self._questions, self._horizon = spec, questions, horizon
        self._period, self._end = questions.period, questions.end
        self._search = questions.search
        assumed = [goal.program.specification.formula for goal in questions.assumed]
        ranges = self._search.limits.ranges
        self._plainness = Plainness([spec.formula, *assumed], self._search.integers, ranges)
        self._program = questions.program(spec)
        self._shortest_length = min(horizon, _context(self._program))

    def examples(self, count: int, timeout: float) -> RequirementExamples:
        """Return up to ``count`` examples."""
        goals = {holds: self._questions.goals((self._program, holds)) for holds in (True, False)}
        answers = {holds: answer_of(self._search.find_short(g)) for holds, g in goals.items()}
        result: dict[object, Example] = {}
        missing: list[str] = []
        unknown: dict[str, str] = {}
        deadline = time.monotonic() + timeout
        for miss in near_misses(self._spec.formula, self._period, self._spec.unit):
            if len(result) >= count:
                break
            first = answers[miss.holds]
            if first.trace is None:
                continue
            if miss.kind == "violated":
                shortest, miss_text = self._shortest(miss, goals[False], first.trace, deadline)
                self._add(result, miss_text, shortest)
                continue
            trace, why = self._trace(miss, first.trace, deadline)
            if trace is not None:
                self._add(result, miss, trace)
            elif why:
                unknown[miss.why] = why
            elif miss.kind in {"answered", "unanswered"}:
                missing.append(miss.why)
        shown = tuple(result.values())[:count]
        text = str(self._spec.standalone())
        return RequirementExamples(
            text, self._period, answers[True], answers[False], shown, tuple(missing), unknown
        )

    def _add(self, by_trace: dict[object, Example], miss: NearMiss, trace: ExampleTrace) -> None:
        """Add an example, or its point to an example with the same trace."""
        key = trace.samples, trace.loop, tuple(trace.columns.items())
        known = by_trace.get(key)
        if known is not None:
            kinds = tuple(dict.fromkeys((*known.kinds, miss.kind)))
            by_trace[key] = replace(known, kinds=kinds, why=f"{known.why}; {miss.why}")
            return
        robustness: float | None = None
        if not trace.loop:
            columns = {name: [*trace.columns[name]] for name in self._program.variables}
            n = None if columns else trace.samples
            robustness = judge(self._spec, columns, self._period, self._end, n=n).robustness
        verdict = Verdict.SATISFIED if miss.holds else Verdict.VIOLATED
        by_trace[key] = Example((miss.kind,), miss.why, verdict, robustness, trace)

    def _trace(
        self, miss: NearMiss, known: ExampleTrace, deadline: float
    ) -> tuple[ExampleTrace | None, str]:
        """Return the trace of a near miss; otherwise the reason if unknown, or "" if impossible."""

        def compiled(formulas: Sequence[tuple[Formula, bool]]) -> list[tuple[Program, bool]]:
            return [(self._questions.program(self._spec, f), holds) for f, holds in formulas]

        plain = [(self._program, miss.holds), *compiled(miss.also)]
        wished = compiled(miss.wished)
        why = ""
        for programs in [[*plain, *wished], plain] if wished else [plain]:
            goals = self._questions.goals(*programs)
            if not known.loop:
                for samples in self._lengths(known.samples):
                    trace, reason = self._search.of_length(goals, samples, deadline)
                    if trace is not None:
                        return self._simplified(trace, goals), ""
                    why = why or reason
            if programs is plain:
                answer = self._search.find_short(goals)
                if answer.trace is not None:
                    return self._simplified(answer.trace, goals), ""
                if answer.impossible:
                    return None, ""
                why = why or answer.why
        return None, why

    def _lengths(self, known: int) -> Iterator[int]:
        """Yield lengths of traces; the first shows all bounded windows completely."""
        least = self._shortest_length
        tried = [least, least + 1, least + 2, 2 * least, known]
        yield from (n for n in dict.fromkeys(tried) if least <= n <= self._horizon)

    def _shortest(
        self, miss: NearMiss, goals: Sequence[Goal], known: ExampleTrace, deadline: float
    ) -> tuple[ExampleTrace, NearMiss]:
        """Return the shortest violation; without a proof, its text does not claim that."""
        proved = not known.loop and known.samples <= _MAX_PROVED
        shorter = range(1, known.samples) if proved else self._lengths(known.samples)
        for samples in () if known.loop else shorter:
            trace, why = self._search.of_length(goals, samples, deadline)
            proved = proved and not why
            if trace is not None:
                known = trace
                break
        trace = self._simplified(known, goals)
        return trace, miss if proved else replace(miss, why="a violation")

    def _simplified(self, trace: ExampleTrace, goals: Sequence[Goal]) -> ExampleTrace:
        """Return a simpler trace with the same verdicts, or the trace itself."""
        truths = self._search.truths(goals, trace.samples, trace.loop)
        monitors = None
        if not trace.loop:
            with suppress(SpecificationError):  # they only save time
                monitors = GoalMonitors(goals, self._period, self._end, trace.samples)
        simple = simplified(trace, self._search.graph, truths, self._plainness, monitors)
        return simple if self._search.confirmed(simple, goals) else trace


def _context(program: Program) -> int:
    """Return the number of samples that shows all bounded windows completely."""
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


@dataclass(frozen=True, slots=True)
class NearMiss:
    """The description of an example that makes the point ``why``.

    ``also`` has other formulas, and whether each holds on the trace; ``wished`` has formulas that
    are dropped if no trace can fulfil them.
    """

    kind: ExampleKind
    why: str
    also: tuple[tuple[Formula, bool], ...] = ()
    wished: tuple[tuple[Formula, bool], ...] = ()
    holds: bool = field(kw_only=True)


def near_misses(formula: Formula, step: Fraction | None, unit: str) -> list[NearMiss]:
    """Return the near misses of a formula, the most informative first."""
    triggers = [*_of_implications(formula, step, unit)]
    satisfied = [] if triggers else [NearMiss("satisfied", "a trace that satisfies it", holds=True)]
    shortest = NearMiss("violated", "the shortest violation", holds=False)
    misses = [*triggers[:1], *satisfied, shortest, *triggers[1:]]
    both = signs(formula)
    changes = [
        (_ORDER[change.kind], index, change)
        for index, node in enumerate(reversed([*formula.nodes()]))
        if isinstance(node, Formula) and node in both
        for change in _changes(node, step, unit)
    ]
    for _, _, change in sorted(changes, key=lambda ranked: ranked[:2]):
        other = replaced(formula, {change.node: change.instead})
        if other is formula:
            continue
        for positive in sorted(both[change.node], reverse=True):
            holds = change.lowers == positive
            why = change.why if positive or not change.otherwise else change.otherwise
            misses.append(NearMiss(change.kind, why, ((other, not holds),), holds=holds))
    return misses


_ORDER: Final[dict[ExampleKind, int]] = {
    "last moment": 0,
    "too late": 0,
    "saved": 1,
    "broken": 1,
    "threshold": 2,
    "first moment": 3,
    "too early": 3,
}


@dataclass(frozen=True, slots=True)
class _Change:
    """A replacement of one part of a formula.

    It implies the part if ``lowers``; otherwise the part implies it. ``why`` is the point of its
    examples, and ``otherwise`` replaces it if the formula falls when the part rises.
    """

    kind: ExampleKind
    why: str
    node: Formula
    instead: Formula
    lowers: bool
    otherwise: str = ""


def _make(name: str, *args: object, interval: Interval | None = None) -> Formula:
    return cast("Formula", make(name, cast("tuple[Node, ...]", args), interval))


def _of_implications(formula: Formula, step: Fraction | None, unit: str) -> Iterator[NearMiss]:
    """Yield three near misses for each implication: answered, unanswered and never triggered."""
    every = implications(formula)
    for item in every:
        name = f": {item}" if len(every) > 1 else ""
        other = unanswered(formula, [item])
        inside = _inside(item, step, unit)
        wished = () if inside is item else ((replaced(formula, {item: inside}), True),)
        yield NearMiss(
            "answered", f"triggered and answered{name}", ((other, False),), wished, holds=True
        )
        without = replaced(formula, {item: _make("true")})
        yield NearMiss(
            "unanswered", f"triggered and not answered{name}", ((without, True),), holds=False
        )
        yield NearMiss("never asked", f"never triggered{name}", ((other, True),), holds=True)


def _inside(implication: Formula, step: Fraction | None, unit: str) -> Formula:
    """Return the implication with a window that excludes its first and its last moment."""
    request, answer = implication.args
    for node in [*answer.nodes()]:
        interval = node.interval
        if isinstance(node, Formula) and _name(node) == "eventually" and interval is not None:
            one, begin, end = _one_sample(interval, step, unit), interval.begin, interval.end
            if end is None or end - begin < 2 * one:
                continue
            room = one * max(1, math.floor((end - begin) / one / 4))
            narrow = Interval(begin + room, end - room, interval.unit)
            inner = _make("eventually", *node.args, interval=narrow)
            answer = replaced(cast("Formula", answer), {node: inner})
    return _make("implies", request, answer)


def _changes(node: Formula, step: Fraction | None, unit: str) -> Iterator[_Change]:
    name = _name(node)
    if name in {"and", "or"}:
        yield from _of_parts(node)
    elif name in _STRICTER or name in _LOOSER:
        yield from _of_threshold(node)
    elif name in {"==", "!="}:
        yield from _of_equality(node)
    elif name in _EXISTS or name in _EVERY:
        yield from _of_window(node, step, unit)
        if name in {"until", "since"}:
            p, q = node.args
            late = _make(_ONCE[name], q, interval=node.interval)
            when = f"before {q} comes" if name == "until" else f"after {q}"
            yield _Change("broken", f"{p} fails {when}", node, late, lowers=False)
    elif name in _FIRSTS:
        first = f"{node} at the first sample, with none before it"
        yield _Change("first moment", first, node, _FIRSTS[name](node), lowers=True)


def _rising(node: Formula, *, down: bool) -> Formula:
    p = cast("Formula", node.args[0])
    return p.prev(strong=True) & ~p if down else p & (~p).prev(strong=True)


_FIRSTS: Final[Mapping[str, Callable[[Formula], Formula]]] = {
    "rise": lambda node: _rising(node, down=False),
    "fall": lambda node: _rising(node, down=True),
    "prev": lambda node: _make("s_prev", *node.args),
}
"""Operators that do not count the first sample."""


def _of_parts(node: Formula) -> Iterator[_Change]:
    """Yield changes where one part alone decides: it fails in ``and``, or holds in ``or``."""
    every = _name(node) == "and"
    for i, part in enumerate(node.args):
        remainder = (*node.args[:i], *node.args[i + 1 :])
        instead = remainder[0] if len(remainder) == 1 else make(_name(node), remainder)
        kind: ExampleKind = "broken" if every else "saved"
        why = f"{'broken' if every else 'saved'} by {part} alone"
        otherwise = f"of {node}, {part} alone {'fails' if every else 'holds'}"
        yield _Change(kind, why, node, cast("Formula", instead), not every, otherwise)


_EXISTS: Final = {"eventually", "once", "until", "since"}
_EVERY: Final = {"always", "historically"}
_PAST: Final = {"once", "since", "historically"}
_ONCE: Final = {"until": "eventually", "since": "once"}


def _of_window(node: Formula, step: Fraction | None, unit: str) -> Iterator[_Change]:
    """Yield windows that are one sample longer or shorter at one end."""
    name, interval, part = _name(node), node.interval, node.args[-1]
    if interval is None:
        return
    one = _one_sample(interval, step, unit)
    exists, past = name in _EXISTS, name in _PAST
    verb = "comes" if exists else "fails"
    if exists:
        late, early = ("too long ago", "too recently") if past else ("too late", "too early")
        beyond, before = f"one sample {late} for", f"one sample {early} for"
    else:
        late, early = ("longer ago than", "more recently than") if past else ("after", "before")
        beyond, before = f"one sample {late}", f"one sample {early}"
    last, first = ("earliest", "latest") if past else ("last", "first")
    begin, end = interval.begin, interval.end
    moves: list[tuple[ExampleKind, str, Fraction, Fraction | None, bool]] = []
    if end is not None:
        moves += [
            ("last moment", f"at the {last} moment of", begin, end - one, True),
            ("too late", beyond, begin, end + one, False),
        ]
    moves += [
        ("first moment", f"at the {first} moment of", begin + one, end, True),
        ("too early", before, begin - one, end, False),
    ]
    for kind, moment, low, high, narrower in moves:
        if low < 0 or (high is not None and high < low):
            continue
        with suppress(SpecificationError):  # a bound without a decimal number
            changed = _make(name, *node.args, interval=Interval(low, high, interval.unit))
            why = f"{part} {verb} {moment} {name}{interval}"
            yield _Change(kind, why, node, changed, narrower == exists)


def _one_sample(interval: Interval, step: Fraction | None, unit: str) -> Fraction:
    """Return the period in the unit of an interval."""
    return Fraction(1) if step is None else step / UNITS[interval.unit or unit]


_STRICTER: Final = {">=": ">", "<=": "<"}
_LOOSER: Final = {">": ">=", "<": "<="}


def _of_threshold(node: Formula) -> Iterator[_Change]:
    """Yield a comparison at its border, and one unit of its last digit away from it."""
    name, unit = _name(node), _unit(node)
    exact = f"exactly at its threshold, {node}"
    more = unit if name in {">", "<="} else -unit  # for the right side: a > b + 1 is stricter
    if name in _STRICTER:
        strict = _make(_STRICTER[name], *node.args)
        yield _Change("threshold", f"{exact} holds", node, strict, lowers=True)
        yield _Change("threshold", f"{node} just fails", node, _moved(node, more), lowers=False)
    else:
        yield _Change("threshold", f"{node} just holds", node, _moved(node, more), lowers=True)
        loose = _make(_LOOSER[name], *node.args)
        yield _Change("threshold", f"{exact} fails", node, loose, lowers=False)


def _of_equality(node: Formula) -> Iterator[_Change]:
    """Yield both sides of an equality, up to one unit of the last digit from its threshold."""
    for more, inner, outer, side in ((1.0, ">=", "<=", "above"), (-1.0, "<=", ">=", "below")):
        beyond = _moved(node, more * _unit(node))
        near = _make(inner, *node.args) & _make(outer, *beyond.args)
        if _name(node) == "==":
            yield _Change("threshold", f"{node} just fails, from {side}", node, near, lowers=False)
        else:
            yield _Change("threshold", f"{node} just holds, from {side}", node, ~near, lowers=True)


def _unit(node: Formula) -> float:
    """Return one unit of the last digit of the threshold of a comparison; 1 without a threshold."""
    numbers = [side.leaf for side in node.args if side.op is None and isinstance(side.leaf, float)]
    return last_digit(numbers[0]) if numbers else 1.0


def _moved(node: Formula, by: float) -> Formula:
    """Return a comparison with a larger right side."""
    left, right = cast("tuple[Term, Term]", node.args)
    if right.op is None and isinstance(right.leaf, float):
        return _make(_name(node), left, number(_sum(right.leaf, by)))
    if left.op is None and isinstance(left.leaf, float):
        return _make(_name(node), number(_sum(left.leaf, -by)), right)
    return _make(_name(node), left, right + by)


def _sum(x: float, y: float) -> float:
    """Return the sum of decimal numbers: 0.1 and 0.2 give 0.3."""
    return float(Decimal(repr(x)) + Decimal(repr(y)))


def _name(node: Node) -> str:
    return node.op.name if node.op else ""
