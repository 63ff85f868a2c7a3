"""Whether there is a trace on which some formulas hold and others fail, for certain.

A finite trace is asked for first, short ones before long ones; the reading of its end says what
certain means there. A formula with a future without end may have none: then traces are asked for
whose last samples repeat for ever. That there is none at all is known where already a part of a
trace decides: a prefix after which nothing that comes could help.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final, TypedDict

from rtamt.checking.graph import FALSE, TRUE, Graph, Truth
from rtamt.checking.limits import VariableLimits
from rtamt.checking.points import PointChoices
from rtamt.checking.pool import TracePool
from rtamt.checking.runs import change_times, truth_of_runs
from rtamt.checking.samples import unknown_samples
from rtamt.checking.solver import Solution, Solver, is_exact
from rtamt.checking.truths import World, truth
from rtamt.checking.witness import ExampleTrace, Goal, judged_so, shortened
from rtamt.machines.bounds import split
from rtamt.machines.protocols import End
from rtamt.program.instructions import Window
from rtamt.program.program import Program

__all__ = ["SearchAnswer", "WitnessSearch"]

_LOOPS: Final = (1, 2, 3, 4)
_PROOFS: Final = (1, 2, 4)
_SHORT: Final = 32
"""Samples up to which any trace is sought first; above, one that changes seldom."""

_REPEATED: Final = 1000
"""The most samples of a trace that repeats its last ones."""

_ROOM: Final = 1e-9
"""The share of the room for a step that is kept for the rounding of values."""

_FREE: Final = VariableLimits()
_ENDS: Final[Mapping[End, tuple[World, World]]] = {
    "complete": (World.COMPLETE, World.COMPLETE),
    "cut": (World.CUT_LOWER, World.CUT_UPPER),
    "open": (World.LOWER, World.UPPER),
}


@dataclass(frozen=True, slots=True)
class SearchAnswer:
    """What a search came to.

    Attributes:
        trace: The trace; None: none was found.
        none: Whether there is none, however long.
        samples: There is none of up to that many samples that then repeats its last ones; 0: that
            is not known.
        why: Why it is not known.
        core: Which of the demands cannot be fulfilled together, by their places; empty if there
            is a trace, or nobody knows.
        limits: The ranges and rates on which that rests, in words.
    """

    trace: ExampleTrace | None = None
    none: bool = False
    samples: int = 0
    why: str = ""
    core: tuple[int, ...] = ()
    limits: tuple[str, ...] = ()


class _Core(TypedDict):
    core: tuple[int, ...]
    limits: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Shape:
    """Which traces are meant.

    Attributes:
        samples: How many samples they have.
        loop: How many of the last samples repeat for ever; 0: they end.
        times: The samples at which values may change; None: each.
    """

    samples: int
    loop: int = 0
    times: tuple[int, ...] | None = None


class WitnessSearch:
    """Searches for traces, which share what formulas have in common.

    Args:
        period: Seconds between samples, or None.
        end: How the end of a finite trace is read.
        horizon: The most samples of a trace.
        timeout: The most seconds of one search.
        whole: The variables that are whole numbers.
        limits: What the values of variables keep to.

    Attributes:
        graph: The truths of the traces.
        whole: The variables that are whole numbers.
        limits: What the values of variables keep to.
    """

    def __init__(
        self,
        period: Fraction | None,
        end: End,
        horizon: int,
        timeout: float,
        whole: frozenset[str] = frozenset(),
        limits: VariableLimits = _FREE,
    ) -> None:
        self._period, self._end, self._horizon, self._timeout = period, end, horizon, timeout
        self.graph, self.whole, self.limits = Graph(), whole, limits
        self._samples = unknown_samples(self.graph)
        self._solver = Solver(self.graph, whole)
        self._truths: dict[tuple[Program, int, World, int], Truth] = {}
        self._runs: dict[tuple[Program, tuple[int, ...]], Truth] = {}
        self._times: dict[tuple[tuple[Program, ...], int], list[tuple[int, ...]]] = {}
        self._pool = TracePool(self.graph, self._usual)
        self._points = PointChoices(self.graph, whole, limits.ranges)

    def find(self, demands: Sequence[Goal], first: int = 1) -> SearchAnswer:
        """A trace that is as demanded.

        Args:
            demands: The demands.
            first: The least length that is tried; a trace that was found before may be shorter.
        """
        deadline = time.monotonic() + self._timeout
        try:
            return self._found(demands, first, deadline)
        except TimeoutError:
            return SearchAnswer(why=self._late)

    def find_short(self, demands: Sequence[Goal]) -> SearchAnswer:
        """What `find` finds; a long trace ends where it is certain to be as demanded."""
        found = self.find(demands)
        trace = found.trace
        if trace is None or trace.loop or trace.samples <= _SHORT:
            return found
        return replace(found, trace=shortened(trace, demands, self._period, self._end))

    def _found(self, demands: Sequence[Goal], first: int, deadline: float) -> SearchAnswer:
        trace = self.seldom_changing(demands)
        if trace is not None:
            return SearchAnswer(trace)
        decisive, most = self._length(demands)
        why = ""
        lengths = _lengths(most, first)
        for count in lengths:
            proves = count in {*_PROOFS, lengths[0], most}
            found = self._finite(demands, count, deadline, proves=proves)
            if found.trace is not None or found.none:
                return found
            why = why or found.why
        if decisive is None:
            return self._endless(demands, most, deadline, why)
        if decisive > self._horizon:
            why = f"it needs {decisive} samples, the horizon is {self._horizon}"
        return SearchAnswer(why=why)

    def of_length(
        self, demands: Sequence[Goal], count: int, deadline: float
    ) -> tuple[ExampleTrace | None, str]:
        """A trace of so many samples that is as demanded; else why there may be one, or nothing.

        Args:
            demands: The demands.
            count: How many samples it has.
            deadline: When to give up, as `time.monotonic` tells the time.
        """
        try:
            asked = self.truths(demands, count, 0, deadline)
        except TimeoutError:
            return None, self._late
        trace, why, _ = self._tried(asked, demands, _Shape(count), deadline)
        return trace, why

    def truths(
        self, demands: Sequence[Goal], count: int, loop: int, deadline: float = math.inf
    ) -> list[Truth]:
        """What holds in `graph` of traces that are as demanded: of each demand, then of limits.

        Args:
            demands: The demands.
            count: How many samples the traces have.
            loop: How many of the last samples repeat for ever; 0: they end.
            deadline: When to give up, as `time.monotonic` tells the time.

        Raises:
            TimeoutError: If it is too late.
        """
        lower, upper = _ENDS[self._end] if not loop else (World.ENDLESS, World.ENDLESS)
        asked = [
            self._truth(each, count, lower if each.holds else upper, loop or 1, deadline)
            for each in demands
        ]
        return [*asked, *self._limited(demands, _Shape(count, loop))]

    def _limited(self, demands: Sequence[Goal], shape: _Shape, room: float = 0.0) -> list[Truth]:
        """Whether each limit of the demands' variables is kept."""
        times = shape.times or range(shape.samples)
        # What changes seldom does not change between these times, nor after the last.
        loop = 1 if shape.times else shape.loop
        return self.limits.truths(self.graph, _variables(demands), times, loop, room)

    def _length(self, demands: Sequence[Goal]) -> tuple[int | None, int]:
        """How many samples decide demands, None if no number does, and the most that are asked."""
        needed = [_needed(demand.program) for demand in demands]
        decisive = None if None in needed else max(n or 1 for n in needed)
        return decisive, min(self._horizon, _ample(demands) if decisive is None else decisive)

    def seldom_changing(self, demands: Sequence[Goal]) -> ExampleTrace | None:
        """A long trace that changes at few times, soon found; None says nothing."""
        deadline = time.monotonic() + self._timeout
        _, most = self._length(demands)
        if most <= _SHORT:
            return None
        for times in self._change_times(demands, most):
            asked = [self._truth_of_runs(each, times) for each in demands]
            shape = _Shape(most, times=times)
            asked += self._limited(demands, shape)
            if FALSE in asked:
                continue
            for columns, known in self._pool.of_length(most) if len(times) > 1 else ():
                if known.fulfils(asked):
                    values = Solution(possible=True, loads=_loads(columns))
                    trace = self._shown(values, demands, _Shape(most))
                    if trace is not None:
                        return trace
            trace, _, _ = self._tried(asked, demands, shape, deadline)
            if trace is not None:
                return trace
        return None

    def _change_times(self, demands: Sequence[Goal], most: int) -> list[tuple[int, ...]]:
        programs = tuple(dict.fromkeys(each.program for each in demands))
        key = programs, most
        if key not in self._times:
            self._times[key] = [*map(tuple, change_times(programs, most))]
        return self._times[key]

    def _truth_of_runs(self, demand: Goal, times: tuple[int, ...]) -> Truth:
        key = demand.program, times
        if key not in self._runs:
            self._runs[key] = truth_of_runs(self.graph, self._samples, demand.program, times)
        found = self._runs[key]
        return found if demand.holds else self.graph.no(found)

    def _finite(
        self, demands: Sequence[Goal], count: int, deadline: float, *, proves: bool
    ) -> SearchAnswer:
        """A trace of some samples; or whether no trace begins like one of them."""
        asked = self.truths(demands, count, 0, deadline)
        for columns, known in self._pool.of_length(count):
            if known.fulfils(asked):
                values = Solution(possible=True, loads=_loads(columns))
                before = self._shown(values, demands, _Shape(count))
                if before is not None:
                    return SearchAnswer(before)
        trace, why, _ = self._tried(asked, demands, _Shape(count), deadline)
        if trace is not None:
            return SearchAnswer(trace)
        # What fails for certain after each prefix of this length fails on each shorter trace too.
        hoped = [
            self._truth(d, count, World.UPPER if d.holds else World.LOWER, 1, deadline)
            for d in demands
        ]
        if all(truth == TRUE for truth in hoped) or not proves:
            return SearchAnswer(why=why)
        hoped += self._limited(demands, _Shape(count))
        solution = self._solver.solve(hoped, deadline, wide=not is_exact(self.graph, hoped))
        none = solution.possible is False
        why = why or (self._late if solution.possible is None else "")
        return SearchAnswer(none=none, why=why, **self._core(demands, solution.core))

    def _endless(
        self, demands: Sequence[Goal], most: int, deadline: float, why: str
    ) -> SearchAnswer:
        """A trace whose last samples repeat for ever."""
        core: set[int] = set()
        for loop in _LOOPS:
            for count in sorted({min(2 * loop, most), most}):
                asked = self.truths(demands, count, loop, deadline)
                shape = _Shape(count, loop)
                trace, reason, clash = self._tried(asked, demands, shape, deadline)
                if trace is not None:
                    return SearchAnswer(trace)
            if clash is None:
                return SearchAnswer(why=why or reason)
            core |= {*clash}
        return SearchAnswer(samples=most, **self._core(demands, sorted(core)))

    def _core(self, demands: Sequence[Goal], places: Sequence[int]) -> _Core:
        """Which demands and which limits clash, by places among the truths that were asked."""
        limits, most = self.limits.of(_variables(demands)), len(demands)
        return {
            "core": tuple(place for place in places if place < most),
            "limits": tuple(limits[place - most] for place in places if place >= most),
        }

    def _truth(self, demand: Goal, count: int, world: World, loop: int, deadline: float) -> Truth:
        key = demand.program, count, world, loop
        if key not in self._truths:
            self._truths[key] = truth(
                self.graph, self._samples, demand.program, count, world, loop, deadline
            )
        found = self._truths[key]
        return found if demand.holds else self.graph.no(found)

    def _tried(
        self, asked: Sequence[Truth], demands: Sequence[Goal], shape: _Shape, deadline: float
    ) -> tuple[ExampleTrace | None, str, tuple[int, ...] | None]:
        """A trace on which truths hold; else why there may be one, or which of them clash."""
        why = ""
        exact = is_exact(self.graph, asked)
        for wide in (False,) if exact else (False, True):
            solution = self._solver.solve(asked, deadline, wide=wide)
            if solution.possible:
                trace = self._shown(solution, demands, shape)
                if trace is None and not wide:
                    trace = self._nearer(asked, demands, shape, solution, deadline)
                if trace is not None:
                    return trace, "", None
                why = why or _doubt(solution)
            elif solution.possible is None:
                return None, self._late, None
            elif wide or exact:
                return None, "", solution.core
        return None, why, None

    def _nearer(
        self,
        asked: Sequence[Truth],
        demands: Sequence[Goal],
        shape: _Shape,
        before: Solution,
        deadline: float,
    ) -> ExampleTrace | None:
        """A trace whose values bear rounding, where the values of a solution do not."""
        more = self._limited(demands, shape, _ROOM) if self.limits.steps else []
        if before.free:
            more += self._points.choices(asked)
        if not more:
            return None
        solution = self._solver.solve([*asked, *more], deadline, wide=False)
        return self._shown(solution, demands, shape) if solution.possible else None

    def _shown(
        self, solution: Solution, demands: Sequence[Goal], shape: _Shape
    ) -> ExampleTrace | None:
        """The trace of a solution if the monitors judge it as demanded."""
        trace = self._witness(solution, demands, shape.samples, shape.loop)
        if self.confirmed(trace, demands):
            shown = trace
        elif shape.times is None or self._length(demands)[0] is not None:
            return None
        else:  # without an end it may be as demanded
            count = shape.times[-1] + 1
            columns = {name: values[:count] for name, values in trace.columns.items()}
            shown = ExampleTrace(columns, count, 1)
            if not self.confirmed(shown, demands):
                return None
        if not shape.loop:
            self._pool.add(trace.columns)
        return shown

    def _witness(
        self, solution: Solution, demands: Sequence[Goal], samples: int, loop: int
    ) -> ExampleTrace:
        columns = {}
        for variable in _variables(demands):
            values: list[float] = []
            for sample in range(samples):  # a value that does not matter is the one before
                before = values[-1] if values else self._usual(variable)
                values.append(solution.loads.get((variable, sample), before))
            columns[variable] = tuple(values)
        return ExampleTrace(columns, samples, loop)

    def _usual(self, variable: str) -> float:
        """The value of a variable where it does not matter."""
        lower, upper = self.limits.ranges.get(variable, (0.0, 0.0))
        return min(max(0.0, lower), upper)

    @property
    def _late(self) -> str:
        return f"no answer within {self._timeout:g} s"

    def confirmed(self, trace: ExampleTrace, demands: Sequence[Goal]) -> bool:
        """Whether the monitors judge the trace as demanded, and its values keep their limits."""
        return self.limits.kept(trace.columns, trace.loop) and judged_so(
            trace, demands, self._period, self._end
        )


def _variables(demands: Sequence[Goal]) -> list[str]:
    return [*dict.fromkeys(name for each in demands for name in each.program.variables)]


def _loads(columns: Mapping[str, Sequence[float]]) -> dict[tuple[str, int], float]:
    return {(name, i): x for name, values in columns.items() for i, x in enumerate(values)}


def _lengths(most: int, first: int) -> list[int]:
    """Numbers of samples, each twice the one before; the last is the most."""
    lengths = [min(first, most)]
    while lengths[-1] * 2 < most:
        lengths.append(lengths[-1] * 2)
    return lengths if lengths[-1] >= most else [*lengths, most]


def _ample(demands: Sequence[Goal]) -> int:
    """As many samples as all windows reach, twice, and some: where no number decides."""
    reach = sum(
        abs(bound)
        for demand in demands
        for each in demand.program.instructions
        if isinstance(each, Window)
        for bound in {each.lo, each.hi} - {None}
        if bound is not None
    )
    return min(_REPEATED, max(16, 2 * reach + 4))


def _needed(program: Program) -> int | None:
    """How many samples decide the result; None: no number does."""
    return split(program, _FAR, best=False).needed


_FAR: Final = 2**40


def _doubt(solution: Solution) -> str:
    if solution.free:
        return f"it is not linear ({', '.join(sorted(solution.free))})"
    return "it hangs on how doubles are rounded"
