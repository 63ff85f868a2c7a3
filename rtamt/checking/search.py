"""The search for a trace that certainly satisfies some formulas and violates others.

The search tries finite traces first, short before long; the end mode defines which verdicts are
certain there. If a formula with an unbounded future has no finite trace, the search tries traces
that repeat their last samples for ever. No trace exists if every prefix of some length decides
against the goals.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

from rtamt.checking.answers import ExampleTrace
from rtamt.checking.encoding import (
    VariableLimits,
    change_times,
    truth,
    truth_of_runs,
)
from rtamt.checking.graph import (
    FALSE,
    TRUE,
    Graph,
    KnownTrace,
    Truth,
    known_samples,
    unknown_samples,
)
from rtamt.checking.solver import PointChoices, Solution, Solver, is_exact
from rtamt.machines.bounds import split
from rtamt.machines.protocols import End, World, worlds_of
from rtamt.monitors.judgement import Judgement, judge
from rtamt.monitors.verdict import Verdict
from rtamt.program.instructions import Window
from rtamt.program.program import Program

_LOOPS: Final = (1, 2, 3, 4)
_PROOFS: Final = (1, 2, 4)
_SHORT: Final = 32
"""The length up to which the search tries all traces first; above it, traces that change seldom."""

_MAX_REPEATED: Final = 1000
"""The maximum number of samples of a trace that repeats its last samples."""

_MAX_KNOWN: Final = 200
"""The maximum number of earlier traces that are tried before the solver."""

_ROOM: Final = 1e-9
"""The share of a step that stays free for the rounding of values."""

_FAR: Final = 2**40


@dataclass(frozen=True, slots=True)
class Goal:
    """A program, and whether its formula must hold or fail on a trace."""

    program: Program
    holds: bool


@dataclass(frozen=True, slots=True)
class SearchAnswer:
    """The result of a search.

    A trace is impossible at any length (``none``), or if it repeats its last samples, up to
    ``samples``; 0 is unknown. ``core`` has the places of goals that clash, and ``limits`` the
    ranges and rates; both are empty if unknown. ``why`` is the reason for an unknown answer.
    """

    trace: ExampleTrace | None = None
    none: bool = False
    samples: int = 0
    why: str = ""
    core: tuple[int, ...] = ()
    limits: tuple[str, ...] = ()

    @property
    def impossible(self) -> bool:
        """Whether a trace is impossible, at least up to `samples`."""
        return self.none or bool(self.samples)


@dataclass(frozen=True, slots=True)
class _Shape:
    """The traces to try.

    Attributes:
        samples: The number of samples.
        loop: The number of last samples that repeat for ever; 0 if traces end.
        times: The samples where values may change; None: all samples.
    """

    samples: int
    loop: int = 0
    times: tuple[int, ...] | None = None


class WitnessSearch:
    """A search for traces; searches share the truths and traces of earlier ones.

    ``horizon`` is the maximum number of samples of a trace, and ``timeout`` is in seconds.
    """

    def __init__(
        self,
        period: Fraction | None,
        end: End,
        horizon: int,
        timeout: float,
        integers: frozenset[str],
        limits: VariableLimits,
    ) -> None:
        self._period, self._end, self._horizon, self._timeout = period, end, horizon, timeout
        self.graph, self.integers, self.limits = Graph(), integers, limits
        self._samples = unknown_samples(self.graph)
        self._solver = Solver(self.graph, integers)
        self._truths: dict[tuple[Program, int, World, int], Truth] = {}
        self._runs: dict[tuple[Program, tuple[int, ...]], Truth] = {}
        self._times: dict[tuple[tuple[Program, ...], int], list[tuple[int, ...]]] = {}
        self._pool = TracePool(self.graph, self._usual)
        self._points = PointChoices(self.graph, integers, limits.ranges)

    def find(self, goals: Sequence[Goal], first: int = 1) -> SearchAnswer:
        """Return a trace that reaches all goals.

        Args:
            goals: The goals.
            first: The smallest length to try; a trace of an earlier search may be shorter.
        """
        deadline = time.monotonic() + self._timeout
        try:
            return self._find(goals, first, deadline)
        except TimeoutError:
            return SearchAnswer(why=self._late)

    def find_short(self, goals: Sequence[Goal]) -> SearchAnswer:
        """Return the answer of `find`, with a long trace cut where it is certain."""
        answer = self.find(goals)
        trace = answer.trace
        if trace is None or trace.loop or trace.samples <= _SHORT:
            return answer
        return replace(answer, trace=shortened(trace, goals, self._period, self._end))

    def _find(self, goals: Sequence[Goal], first: int, deadline: float) -> SearchAnswer:
        trace = self.seldom_changing(goals)
        if trace is not None:
            return SearchAnswer(trace)
        decisive, most = self._length(goals)
        why = ""
        lengths = _lengths(most, first)
        for count in lengths:
            proves = count in {*_PROOFS, lengths[0], most}
            answer = self._find_finite(goals, count, deadline, proves=proves)
            if answer.trace is not None or answer.none:
                return answer
            why = why or answer.why
        if decisive is None:
            return self._find_endless(goals, most, deadline, why)
        if decisive > self._horizon:
            why = f"it needs {decisive} samples, the horizon is {self._horizon}"
        return SearchAnswer(why=why)

    def of_length(
        self, goals: Sequence[Goal], count: int, deadline: float
    ) -> tuple[ExampleTrace | None, str]:
        """Return a trace of ``count`` samples; otherwise None and the reason if this is unknown."""
        try:
            truths = self.truths(goals, count, 0, deadline)
        except TimeoutError:
            return None, self._late
        trace, why, _ = self._solve(truths, goals, _Shape(count), deadline)
        return trace, why

    def truths(
        self, goals: Sequence[Goal], count: int, loop: int, deadline: float = math.inf
    ) -> list[Truth]:
        """Return a truth in `graph` for each goal, then for each limit; TimeoutError if late."""
        lower, upper = worlds_of("complete" if loop else self._end)
        truths = [
            self._truth(goal, count, lower if goal.holds else upper, loop, deadline)
            for goal in goals
        ]
        return [*truths, *self._limit_truths(goals, _Shape(count, loop))]

    def _limit_truths(self, goals: Sequence[Goal], shape: _Shape, room: float = 0.0) -> list[Truth]:
        times = shape.times or range(shape.samples)
        # A trace that changes seldom is constant between these times and after the last one.
        loop = 1 if shape.times else shape.loop
        return self.limits.truths(self.graph, _variables(goals), times, loop, room)

    def _length(self, goals: Sequence[Goal]) -> tuple[int | None, int]:
        """Return the number of samples that decides the goals, or None, and the longest to try."""
        needed = [split(goal.program, _FAR, best=False).needed for goal in goals]
        decisive = None if None in needed else max(n or 1 for n in needed)
        return decisive, min(self._horizon, _ample(goals) if decisive is None else decisive)

    def seldom_changing(self, goals: Sequence[Goal]) -> ExampleTrace | None:
        """Return a long trace that changes at few times; None proves nothing."""
        deadline = time.monotonic() + self._timeout
        _, most = self._length(goals)
        if most <= _SHORT:
            return None
        for times in self._change_times(goals, most):
            shape = _Shape(most, times=times)
            truths = [self._truth_of_runs(goal, times) for goal in goals]
            truths += self._limit_truths(goals, shape)
            if FALSE in truths:
                continue
            trace = self._known_trace(truths, goals, most) if len(times) > 1 else None
            trace = trace or self._solve(truths, goals, shape, deadline)[0]
            if trace is not None:
                return trace
        return None

    def _known_trace(
        self, truths: Sequence[Truth], goals: Sequence[Goal], count: int
    ) -> ExampleTrace | None:
        """Return an earlier trace that reaches the goals."""
        for columns, known in self._pool.of_length(count):
            if known.fulfils(truths):
                loads = {(n, i): x for n, values in columns.items() for i, x in enumerate(values)}
                trace = self._confirmed_trace(
                    Solution(possible=True, loads=loads), goals, _Shape(count)
                )
                if trace is not None:
                    return trace
        return None

    def _change_times(self, goals: Sequence[Goal], most: int) -> list[tuple[int, ...]]:
        programs = tuple(dict.fromkeys(goal.program for goal in goals))
        key = programs, most
        if key not in self._times:
            self._times[key] = [*change_times(programs, most)]
        return self._times[key]

    def _truth_of_runs(self, goal: Goal, times: tuple[int, ...]) -> Truth:
        key = goal.program, times
        if key not in self._runs:
            self._runs[key] = truth_of_runs(self.graph, self._samples, goal.program, times)
        return self._runs[key] if goal.holds else self.graph.no(self._runs[key])

    def _find_finite(
        self, goals: Sequence[Goal], count: int, deadline: float, *, proves: bool
    ) -> SearchAnswer:
        """Return a trace of ``count`` samples, or whether its length excludes longer traces too."""
        truths = self.truths(goals, count, 0, deadline)
        known = self._known_trace(truths, goals, count)
        if known is not None:
            return SearchAnswer(known)
        trace, why, _ = self._solve(truths, goals, _Shape(count), deadline)
        if trace is not None:
            return SearchAnswer(trace)
        # A goal that fails after each prefix of this length fails on shorter traces too.
        possible = [
            self._truth(g, count, World.UPPER if g.holds else World.LOWER, 0, deadline)
            for g in goals
        ]
        if all(truth == TRUE for truth in possible) or not proves:
            return SearchAnswer(why=why)
        possible += self._limit_truths(goals, _Shape(count))
        solution = self._solver.solve(possible, deadline, wide=not is_exact(self.graph, possible))
        none = solution.possible is False
        why = why or (self._late if solution.possible is None else "")
        core, limits = self._core(goals, solution.core)
        return SearchAnswer(none=none, why=why, core=core, limits=limits)

    def _find_endless(
        self, goals: Sequence[Goal], most: int, deadline: float, why: str
    ) -> SearchAnswer:
        """Return a trace that repeats its last samples for ever."""
        places: set[int] = set()
        for loop in _LOOPS:
            for count in sorted({min(2 * loop, most), most}):
                truths = self.truths(goals, count, loop, deadline)
                trace, reason, clash = self._solve(truths, goals, _Shape(count, loop), deadline)
                if trace is not None:
                    return SearchAnswer(trace)
            if clash is None:
                return SearchAnswer(why=why or reason)
            places |= {*clash}
        core, limits = self._core(goals, sorted(places))
        return SearchAnswer(samples=most, core=core, limits=limits)

    def _core(
        self, goals: Sequence[Goal], places: Sequence[int]
    ) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Return the goals and the limits that clash, from places in the list of `truths`."""
        limits, most = self.limits.texts(_variables(goals)), len(goals)
        return (
            tuple(position for position in places if position < most),
            tuple(limits[position - most] for position in places if position >= most),
        )

    def _truth(self, goal: Goal, count: int, world: World, loop: int, deadline: float) -> Truth:
        key = goal.program, count, world, loop
        if key not in self._truths:
            self._truths[key] = truth(
                self.graph, self._samples, goal.program, count, world, loop, deadline
            )
        return self._truths[key] if goal.holds else self.graph.no(self._truths[key])

    def _solve(
        self, truths: Sequence[Truth], goals: Sequence[Goal], shape: _Shape, deadline: float
    ) -> tuple[ExampleTrace | None, str, tuple[int, ...] | None]:
        """Return a trace; otherwise the reason if unknown, or the places of truths that clash."""
        why = ""
        exact = is_exact(self.graph, truths)
        for wide in (False,) if exact else (False, True):
            solution = self._solver.solve(truths, deadline, wide=wide)
            if solution.possible:
                trace = self._confirmed_trace(solution, goals, shape)
                if trace is None and not wide:
                    trace = self._robust_trace(truths, goals, shape, solution, deadline)
                if trace is not None:
                    return trace, "", None
                why = why or _doubt(solution)
            elif solution.possible is None:
                return None, self._late, None
            elif wide or exact:
                return None, "", solution.core
        return None, why, None

    def _robust_trace(
        self,
        truths: Sequence[Truth],
        goals: Sequence[Goal],
        shape: _Shape,
        before: Solution,
        deadline: float,
    ) -> ExampleTrace | None:
        """Return a trace with room for rounding, after a solution without it."""
        more = self._limit_truths(goals, shape, _ROOM) if self.limits.steps else []
        if before.free:
            more += self._points.choices(truths)
        if not more:
            return None
        solution = self._solver.solve([*truths, *more], deadline, wide=False)
        return self._confirmed_trace(solution, goals, shape) if solution.possible else None

    def _confirmed_trace(
        self, solution: Solution, goals: Sequence[Goal], shape: _Shape
    ) -> ExampleTrace | None:
        """Return the trace of a solution if the monitors confirm it."""
        columns: dict[str, tuple[float, ...]] = {}
        for variable in _variables(goals):
            values: list[float] = []
            for sample in range(shape.samples):  # a value without effect repeats the previous value
                before = values[-1] if values else self._usual(variable)
                values.append(solution.loads.get((variable, sample), before))
            columns[variable] = tuple(values)
        trace = confirmed = ExampleTrace(columns, shape.samples, shape.loop)
        if not self.confirmed(trace, goals):
            if shape.times is None or self._length(goals)[0] is not None:
                return None
            # It may reach the goals if its last value is repeated for ever.
            count = shape.times[-1] + 1
            prefix = {name: values[:count] for name, values in columns.items()}
            confirmed = ExampleTrace(prefix, count, 1)
            if not self.confirmed(confirmed, goals):
                return None
        if not shape.loop:
            self._pool.add(trace.columns)
        return confirmed

    def _usual(self, variable: str) -> float:
        """Return the value of a variable at samples where it has no effect."""
        lower, upper = self.limits.ranges.get(variable, (0.0, 0.0))
        return min(max(0.0, lower), upper)

    @property
    def _late(self) -> str:
        return f"no answer within {self._timeout:g} s"

    def confirmed(self, trace: ExampleTrace, goals: Sequence[Goal]) -> bool:
        """Return whether a trace keeps the limits and reaches all goals, as judged by monitors."""
        return self.limits.allow(trace.columns, trace.loop) and reaches(
            trace, goals, self._period, self._end
        )


def _variables(goals: Sequence[Goal]) -> list[str]:
    return [*dict.fromkeys(name for goal in goals for name in goal.program.variables)]


def _lengths(most: int, first: int) -> list[int]:
    """Return lengths that double, from ``first`` up to ``most``."""
    lengths = [min(first, most)]
    while lengths[-1] * 2 < most:
        lengths.append(lengths[-1] * 2)
    return lengths if lengths[-1] >= most else [*lengths, most]


def _ample(goals: Sequence[Goal]) -> int:
    """Return twice the reach of all windows, for goals that are never decided."""
    reach = sum(
        abs(bound)
        for goal in goals
        for window in goal.program.instructions
        if isinstance(window, Window)
        for bound in {window.lo, window.hi} - {None}
        if bound is not None
    )
    return min(_MAX_REPEATED, max(16, 2 * reach + 4))


def _doubt(solution: Solution) -> str:
    if solution.free:
        return f"it is not linear ({', '.join(sorted(solution.free))})"
    return "it depends on the rounding of doubles"


def reaches(trace: ExampleTrace, goals: Sequence[Goal], period: Fraction | None, end: End) -> bool:
    """Return whether a trace reaches all goals, as judged by the monitors."""
    for goal in goals:
        program = goal.program
        try:
            if trace.loop:
                samples, count = known_samples(trace.columns), trace.samples
                result = truth(Graph(), samples, program, count, loop=trace.loop)
                if (result == TRUE) is not goal.holds:
                    return False
            # The monitors see only a part of an endless trace; they must not contradict its truth.
            verdict = _judged(trace, program, period, "open" if trace.loop else end).verdict
        except ValueError:
            return False
        expected = Verdict.SATISFIED if goal.holds else Verdict.VIOLATED
        if verdict is not expected and not (trace.loop and verdict is Verdict.UNDECIDED):
            return False
    return True


def shortened(
    trace: ExampleTrace, goals: Sequence[Goal], period: Fraction | None, end: End
) -> ExampleTrace:
    """Return a prefix of a trace that also reaches all goals.

    It ends at the sample that decides the verdicts, or later if a verdict needs the end.
    """
    decided = [_judged(trace, goal.program, period, end).decided_at for goal in goals]
    count = 1 + max((int(sample) for sample in decided if sample is not None), default=0)
    while count < trace.samples:
        columns = {name: values[:count] for name, values in trace.columns.items()}
        prefix = ExampleTrace(columns, count, 0)
        if reaches(prefix, goals, period, end):
            return prefix
        count *= 2
    return trace


def _judged(trace: ExampleTrace, program: Program, period: Fraction | None, end: End) -> Judgement:
    columns = {name: trace.unrolled(name) for name in program.variables}
    n = None if columns else trace.samples
    return judge(program.specification, columns, period, end, n=n)


class TracePool:
    """The newest finite traces of a search; ``other`` returns the value of other variables."""

    def __init__(self, graph: Graph, other: Callable[[str], float]) -> None:
        self._graph, self._other = graph, other
        self._traces: dict[tuple[tuple[str, tuple[float, ...]], ...], KnownTrace] = {}

    def add(self, columns: Mapping[str, tuple[float, ...]]) -> None:
        """Store a trace."""
        key = tuple(columns.items())
        if not columns or key in self._traces:
            return

        def load(name: str, sample: int) -> float:
            return columns[name][sample] if name in columns else self._other(name)

        self._traces[key] = KnownTrace(self._graph, load)
        if len(self._traces) > _MAX_KNOWN:
            del self._traces[next(iter(self._traces))]

    def of_length(self, count: int) -> Iterator[tuple[dict[str, tuple[float, ...]], KnownTrace]]:
        """Yield the traces of ``count`` samples, the newest first."""
        for key in reversed([*self._traces]):
            if len(key[0][1]) == count:
                yield dict(key), self._traces[key]
