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
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Final, TypedDict

from rtamt.checking.graph import TRUE, Graph, Truth
from rtamt.checking.pool import TracePool
from rtamt.checking.samples import known_samples, unknown_samples
from rtamt.checking.solver import Solution, Solver, is_exact
from rtamt.checking.truths import World, truth
from rtamt.machines.protocols import End
from rtamt.monitors.judgement import judge
from rtamt.monitors.monitor import Verdict
from rtamt.program.instructions import Window
from rtamt.program.outlook import look_out
from rtamt.program.program import Program

__all__ = ["ExampleTrace", "Goal", "SearchAnswer", "WitnessSearch"]

_LOOPS: Final = (1, 2, 3, 4)
_PROOFS: Final = (1, 2, 4)
_ENDS: Final[Mapping[End, tuple[World, World]]] = {
    "complete": (World.COMPLETE, World.COMPLETE),
    "cut": (World.CUT_LOWER, World.CUT_UPPER),
    "open": (World.LOWER, World.UPPER),
}


@dataclass(frozen=True, slots=True)
class Goal:
    """What a trace is to be like.

    Attributes:
        program: The program of a formula.
        holds: Whether the formula is to hold; else it is to fail.
    """

    program: Program
    holds: bool


@dataclass(frozen=True, slots=True)
class ExampleTrace:
    """A trace that the monitors have judged as asked for.

    Attributes:
        columns: The value of each variable at each sample.
        samples: How many samples there are.
        loop: How many of the last samples repeat for ever; 0: it ends.
    """

    columns: Mapping[str, tuple[float, ...]]
    samples: int
    loop: int

    @property
    def described(self) -> str:
        """How long it is, in words."""
        count = f"{self.samples} sample{'s' * (self.samples != 1)}"
        if not self.loop:
            return f"in {count}"
        last = "sample" if self.loop == 1 else f"{self.loop} samples"
        return f"by {count}, the last {last} again and again"

    def unrolled(self, variable: str) -> list[float]:
        """The values of a variable, for thrice the samples if the last ones repeat."""
        values = [*self.columns[variable]]
        more = 2 * self.samples if self.loop else 0
        again = values[self.samples - self.loop :]
        return values + (again * (more // max(1, self.loop) + 1))[:more]


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
        ranged: The variables on whose ranges that rests.
    """

    trace: ExampleTrace | None = None
    none: bool = False
    samples: int = 0
    why: str = ""
    core: tuple[int, ...] = ()
    ranged: tuple[str, ...] = ()


class _Core(TypedDict):
    core: tuple[int, ...]
    ranged: tuple[str, ...]


class WitnessSearch:
    """Searches for traces, which share what formulas have in common.

    Args:
        period: Seconds between samples, or None.
        end: How the end of a finite trace is read.
        horizon: The most samples of a trace.
        timeout: The most seconds of one search.
        whole: The variables that are whole numbers.
        ranges: The least and the greatest value of variables.

    Attributes:
        graph: The truths of the traces.
        whole: The variables that are whole numbers.
        ranges: The least and the greatest value of variables.
    """

    def __init__(
        self,
        period: Fraction | None,
        end: End,
        horizon: int,
        timeout: float,
        whole: frozenset[str] = frozenset(),
        ranges: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    ) -> None:
        self._period, self._end, self._horizon, self._timeout = period, end, horizon, timeout
        self.graph, self.whole, self.ranges = Graph(), whole, ranges
        self._samples = unknown_samples(self.graph)
        self._solver = Solver(self.graph, whole)
        self._truths: dict[tuple[Program, int, World, int], Truth] = {}
        self._kept: dict[tuple[str, int], Truth] = {}
        self._pool = TracePool(self.graph, self._usual)

    def find(self, demands: Sequence[Goal], first: int = 1) -> SearchAnswer:
        """A trace that is as demanded.

        Args:
            demands: The demands.
            first: The least length that is tried; a trace that was found before may be shorter.
        """
        deadline = time.monotonic() + self._timeout
        needed = [_needed(demand.program) for demand in demands]
        decisive = None if None in needed else max(n or 1 for n in needed)
        most = min(self._horizon, _ample(demands) if decisive is None else decisive)
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
        asked = self.truths(demands, count, 0)
        trace, why, _ = self._tried(asked, demands, count, 0, deadline)
        return trace, why

    def truths(self, demands: Sequence[Goal], count: int, loop: int) -> list[Truth]:
        """What holds in `graph` of traces that are as demanded: of each demand, then of ranges.

        Args:
            demands: The demands.
            count: How many samples the traces have.
            loop: How many of the last samples repeat for ever; 0: they end.
        """
        lower, upper = _ENDS[self._end] if not loop else (World.ENDLESS, World.ENDLESS)
        asked = [self._truth(d, count, lower if d.holds else upper, loop or 1) for d in demands]
        return [*asked, *self._within(demands, count)]

    def _finite(
        self, demands: Sequence[Goal], count: int, deadline: float, *, proves: bool
    ) -> SearchAnswer:
        """A trace of some samples; or whether no trace begins like one of them."""
        asked = self.truths(demands, count, 0)
        for columns, known in self._pool.of_length(count):
            if known.fulfils(asked):
                values = Solution(possible=True, loads=_loads(columns))
                before = self._witness(values, demands, count, 0)
                if self.confirmed(before, demands):
                    return SearchAnswer(before)
        trace, why, _ = self._tried(asked, demands, count, 0, deadline)
        if trace is not None:
            self._pool.add(trace.columns)
            return SearchAnswer(trace)
        # What fails for certain after each prefix of this length fails on each shorter trace too.
        hoped = [self._truth(d, count, World.UPPER if d.holds else World.LOWER) for d in demands]
        if all(truth == TRUE for truth in hoped) or not proves:
            return SearchAnswer(why=why)
        hoped += self._within(demands, count)
        solution = self._solver.solve(hoped, deadline, wide=not is_exact(self.graph, hoped))
        none = solution.possible is False
        why = why or self._late(solution)
        return SearchAnswer(none=none, why=why, **self._core(demands, solution.core))

    def _endless(
        self, demands: Sequence[Goal], most: int, deadline: float, why: str
    ) -> SearchAnswer:
        """A trace whose last samples repeat for ever."""
        core: set[int] = set()
        for loop in _LOOPS:
            for count in sorted({min(2 * loop, most), most}):
                asked = self.truths(demands, count, loop)
                trace, reason, clash = self._tried(asked, demands, count, loop, deadline)
                if trace is not None:
                    return SearchAnswer(trace)
            if clash is None:
                return SearchAnswer(why=why or reason)
            core |= {*clash}
        return SearchAnswer(samples=most, **self._core(demands, sorted(core)))

    def _ranged(self, demands: Sequence[Goal]) -> list[str]:
        """The variables of demands that have a range."""
        names = dict.fromkeys(name for each in demands for name in each.program.variables)
        return [name for name in names if name in self.ranges]

    def _within(self, demands: Sequence[Goal], count: int) -> list[Truth]:
        """Whether each variable that has a range keeps it."""
        return [self._keeps(name, count) for name in self._ranged(demands)]

    def _keeps(self, name: str, count: int) -> Truth:
        key = name, count
        if key not in self._kept:
            lower, upper = self.ranges[name]
            kept = []
            for sample in range(count):
                load = ("load", name, sample)
                if lower > -math.inf:
                    kept.append(self.graph.atom(("at_least", load, ("const", lower))))
                if upper < math.inf:
                    kept.append(self.graph.atom(("at_least", ("const", upper), load)))
            self._kept[key] = self.graph.all(kept)
        return self._kept[key]

    def _core(self, demands: Sequence[Goal], places: Sequence[int]) -> _Core:
        """Which demands and which ranges clash, by places among the truths that were asked."""
        ranged, most = self._ranged(demands), len(demands)
        return {
            "core": tuple(place for place in places if place < most),
            "ranged": tuple(ranged[place - most] for place in places if place >= most),
        }

    def _truth(self, demand: Goal, count: int, world: World, loop: int = 1) -> Truth:
        key = demand.program, count, world, loop
        if key not in self._truths:
            self._truths[key] = truth(self.graph, self._samples, demand.program, count, world, loop)
        found = self._truths[key]
        return found if demand.holds else self.graph.no(found)

    def _tried(
        self,
        asked: Sequence[Truth],
        demands: Sequence[Goal],
        count: int,
        loop: int,
        deadline: float,
    ) -> tuple[ExampleTrace | None, str, tuple[int, ...] | None]:
        """A trace on which truths hold; else why there may be one, or which of them clash."""
        why = ""
        exact = is_exact(self.graph, asked)
        for wide in (False,) if exact else (False, True):
            solution = self._solver.solve(asked, deadline, wide=wide)
            if solution.possible:
                trace = self._witness(solution, demands, count, loop)
                if self.confirmed(trace, demands):
                    return trace, "", None
                why = why or _doubt(solution)
            elif solution.possible is None:
                return None, self._late(solution), None
            elif wide or exact:
                return None, "", solution.core
        return None, why, None

    def _witness(
        self, solution: Solution, demands: Sequence[Goal], samples: int, loop: int
    ) -> ExampleTrace:
        variables = dict.fromkeys(name for demand in demands for name in demand.program.variables)
        columns = {}
        for variable in variables:
            values: list[float] = []
            for sample in range(samples):  # a value that does not matter is the one before
                before = values[-1] if values else self._usual(variable)
                values.append(solution.loads.get((variable, sample), before))
            columns[variable] = tuple(values)
        return ExampleTrace(columns, samples, loop)

    def _usual(self, variable: str) -> float:
        """The value of a variable where it does not matter."""
        lower, upper = self.ranges.get(variable, (0.0, 0.0))
        return min(max(0.0, lower), upper)

    def _late(self, solution: Solution) -> str:
        return f"no answer within {self._timeout:g} s" if solution.possible is None else ""

    def confirmed(self, trace: ExampleTrace, demands: Sequence[Goal]) -> bool:
        """Whether the monitors judge the trace as demanded, and its values keep their ranges."""
        for name, (lower, upper) in self.ranges.items():
            if not all(lower <= value <= upper for value in trace.columns.get(name, ())):
                return False
        for demand in demands:
            program = demand.program
            try:
                if trace.loop:
                    samples, world = known_samples(trace.columns), World.ENDLESS
                    found = truth(Graph(), samples, program, trace.samples, world, trace.loop)
                    if (found == TRUE) is not demand.holds:
                        return False
                # The monitors see a part of a trace that does not end; it must not say otherwise.
                columns = {name: trace.unrolled(name) for name in program.variables}
                end = "open" if trace.loop else self._end
                n = None if columns else trace.samples
                verdict = judge(program.specification, columns, self._period, end, n=n).verdict
            except ValueError:
                return False
            wanted = Verdict.SATISFIED if demand.holds else Verdict.VIOLATED
            if verdict is not wanted and not (trace.loop and verdict is Verdict.UNDECIDED):
                return False
        return True


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
    return max(16, 2 * reach + 4)


def _needed(program: Program) -> int | None:
    """How many samples decide the result; None: no number does."""
    return look_out(program, _FAR, best=False).needed


_FAR: Final = 2**40


def _doubt(solution: Solution) -> str:
    if solution.free:
        return f"it is not linear ({', '.join(sorted(solution.free))})"
    return "it hangs on how doubles are rounded"
