"""The truth of a program's result on a trace of unknown samples, as a graph for the solver.

The sign bit of a robustness is the truth of the formula, so a register is a truth here: a minimum
is a conjunction, a maximum a disjunction, and the folds of windows act on truths as on numbers.
There are two encodings. `truth` encodes each sample, in a world of `rtamt.machines.protocols` or on
a trace that repeats its last samples for ever. `truth_of_runs` encodes only the samples where the
trace may change, so that long windows cost as little as short ones; it covers only traces that
change nowhere else.
"""

from __future__ import annotations

import functools
import itertools
import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from time import monotonic
from typing import Final

from rtamt.checking.graph import FALSE, TRUE, Atom, Graph, TermKey, TermTruths, Truth, TruthElement
from rtamt.language.declarations import range_text
from rtamt.machines.protocols import World
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Window
from rtamt.program.placement import positive
from rtamt.program.program import Program

_MAX_CORNERS: Final = 64
"""The maximum number of window corners where a trace may change."""

_MAX_GRID: Final = 256
"""The maximum number of times on an even grid where a trace may change."""


def truth(
    graph: Graph,
    samples: TermTruths,
    program: Program,
    count: int,
    world: World = World.NOW,
    loop: int = 0,
    deadline: float = math.inf,
) -> Truth:
    """Return whether the result of a program holds at the first of ``count`` samples.

    The last ``loop`` samples repeat for ever; 0: the trace ends. TimeoutError is raised after the
    deadline.
    """
    program = positive(program).with_zero(0.0 if world.best else -0.0)
    encoding = _Encoding(graph, samples, program, count - 1, loop, deadline)
    return encoding.history(program.result, world).at(0)


@dataclass(frozen=True, slots=True)
class _History:
    """A truth at all times from 0 on; its last ``loop`` values repeat for ever."""

    values: Sequence[Truth]
    loop: int

    def at(self, time: int) -> Truth:
        over = time - len(self.values)
        return self.values[time if over < 0 else len(self.values) - self.loop + over % self.loop]

    @property
    def start(self) -> int:
        """The first time of the repeated values."""
        return len(self.values) - self.loop


class _Encoding:
    """The histories of a program's registers in each world."""

    def __init__(
        self,
        graph: Graph,
        samples: TermTruths,
        program: Program,
        last: int,
        loop: int,
        deadline: float,
    ) -> None:
        self._graph, self._samples, self._program = graph, samples, program
        self._last, self._deadline = last, deadline
        self._ends, self._loop = loop == 0, max(1, loop)
        self._until = _last_reads(program)
        self._known: dict[tuple[int, World], _History] = {}

    def history(self, register: int, world: World) -> _History:
        """Return the history of a register; depth first, without recursion."""
        stack = [(register, world)]
        while stack:
            key = stack[-1]
            missing = [need for need in self._needs(*key) if need not in self._known]
            if missing:
                stack.extend(missing)
                continue
            stack.pop()
            if key not in self._known:
                self._known[key] = self._encoded(*key)
        return self._known[register, world]

    def _needs(self, register: int, world: World) -> list[tuple[int, World]]:
        if register < self._program.terms:
            return []
        instruction = self._program.formula(register)
        needs = [(a, world) for a in instruction.args]
        if isinstance(instruction, Window) and _has_open_values(instruction, world):
            needs.append((register, world.opened))
        return needs

    def _encoded(self, register: int, world: World) -> _History:
        if register < self._program.terms:
            return self._predicate(register, world)
        instruction = self._program.formula(register)
        if isinstance(instruction, Window):
            return self._window(register, instruction, world)
        operands = [self._known[a, world] for a in instruction.args]
        combine = self._graph.all if instruction.function == "min" else self._graph.any
        start = max(operand.start for operand in operands)
        return self._periodic(register, start, lambda i: combine(o.at(i) for o in operands))

    def _periodic(self, register: int, start: int, value: Callable[[int], Truth]) -> _History:
        """Return a history that repeats from ``start`` on, cut after the last time that is read."""
        until, loop = self._until[register], self._loop
        if until is not None and until < start + loop:
            start, loop = until, 1
        values = []
        for i in range(start + loop):
            if monotonic() > self._deadline:
                raise TimeoutError
            values.append(value(i))
        return _History(values, loop)

    def _predicate(self, register: int, world: World) -> _History:
        if isinstance(self._program.instructions[register], Const):
            return _History([self._samples(self._program, register, 0)] * self._loop, self._loop)
        start = self._last + 1 if self._ends else self._last + 1 - self._loop

        def value(i: int) -> Truth:
            if i > self._last:
                return TRUE if world.best else FALSE
            return self._samples(self._program, register, i)

        return self._periodic(register, start, value)

    def _window(self, register: int, window: Window, world: World) -> _History:
        operands = [self._known[a, world] for a in window.args]
        ends = self._ends and window.ahead and world.ends(window)
        skips = ends and world in {World.LOWER, World.UPPER}
        folds = _Folds(self._graph, window.fold, operands, self._last if ends else None, self._loop)
        # A window into the past repeats later than its operands do.
        behind = self._loop - min(0, window.hi or 0) if window.lo is None else max(0, -window.lo)
        start = folds.start + behind
        if self._ends:
            start = max(start, self._last + 1)
        others = self._known[register, world.opened] if _has_open_values(window, world) else None
        others_from = self._last + 1 - window.begin
        if others is not None:
            start = max(start, others.start, others_from)

        def value(i: int) -> Truth:
            if others is not None and i >= others_from:
                return others.at(i)
            if skips and i > self._last:
                return operands[-1].at(i) if window.lo == 0 else folds.nothing[-1]
            return folds.over(i, window.lo, window.hi)[-1]

        return self._periodic(register, start, value)


def _has_open_values(window: Window, world: World) -> bool:
    """Return whether unrecorded times have the values of an open end."""
    return world.cut and (window.endless or window.hi is None)


def _last_reads(program: Program) -> list[int | None]:
    """Return the last time that each register is read; None if it is read for ever."""
    until: list[int | None] = [0] * len(program.instructions)
    for register in range(program.result, program.terms - 1, -1):
        instruction, read = program.formula(register), until[register]
        hi = instruction.hi if isinstance(instruction, Window) else 0
        for operand in instruction.args:
            here = until[operand]
            if here is None or read is None or hi is None:
                until[operand] = None
            else:
                until[operand] = max(here, read + max(0, hi))
    return until


def _identity(fold: str) -> TruthElement:
    return tuple(int(x > 0) for x in FOLDS[fold].identity)


class _Folds:
    """Folds of truths over windows, which share their parts; they repeat from ``start`` on."""

    def __init__(
        self, graph: Graph, fold: str, operands: Sequence[_History], end: int | None, loop: int
    ) -> None:
        self.nothing = _identity(fold)
        self.start = max(operand.start for operand in operands)
        if end is not None:
            self.start = max(self.start, end + 1)
        self._operands, self._end, self._loop = operands, end, loop
        self._combine = graph.fold(fold)
        self._blocks: dict[tuple[int, int], TruthElement] = {}
        self._prefixes: list[TruthElement] = []
        self._suffixes: dict[int, TruthElement] = {}

    def over(self, time: int, lo: int | None, hi: int | None) -> TruthElement:
        """Return the fold over offsets lo to hi from a time."""
        if lo is None:
            return self._prefix(time + (hi or 0))
        begin = max(0, time + lo)
        if hi is None:
            return self._suffix(self._repeated(begin))
        length = time + hi - begin + 1
        if self._end is not None:
            length = min(length, self._end - begin + 1)
        # Folds are idempotent, so more than one repetition changes nothing.
        length = min(length, max(0, self.start - begin) + 2 * self._loop)
        total = self.nothing
        size = 0
        while length > 0:
            if length & 1:
                total = self._combine(total, self._block(begin, size))
                begin += 1 << size
            length >>= 1
            size += 1
        return total

    def _repeated(self, time: int) -> int:
        """Return the earliest time that has the same elements as a time, now and later."""
        return time if time <= self.start else self.start + (time - self.start) % self._loop

    def _element(self, time: int) -> TruthElement:
        if self._end is not None and time > self._end:
            return self.nothing
        return tuple(operand.at(time) for operand in self._operands)

    def _block(self, begin: int, size: int) -> TruthElement:
        """Return the fold of 2**size elements."""
        begin = self._repeated(begin)
        key = begin, size
        if key not in self._blocks:
            if size == 0:
                self._blocks[key] = self._element(begin)
            else:
                half = 1 << (size - 1)
                left, right = (self._block(first, size - 1) for first in (begin, begin + half))
                self._blocks[key] = self._combine(left, right)
        return self._blocks[key]

    def _prefix(self, end: int) -> TruthElement:
        if end < 0:
            return self.nothing
        repeats = self.start + self._loop
        if end > repeats:
            end = repeats + (end - repeats) % self._loop
        while len(self._prefixes) <= end:
            before = self._prefixes[-1] if self._prefixes else self.nothing
            self._prefixes.append(self._combine(before, self._element(len(self._prefixes))))
        return self._prefixes[end]

    def _suffix(self, begin: int) -> TruthElement:
        if begin not in self._suffixes:
            total = self.nothing
            first = max(begin, self.start)
            for i in range(first + self._loop - 1, first - 1, -1):
                total = self._combine(self._element(i), total)
            for i in range(self.start - 1, begin - 1, -1):
                total = self._combine(self._element(i), total)
                self._suffixes[i] = total
            self._suffixes[begin] = total
        return self._suffixes[begin]


def truth_of_runs(
    graph: Graph, samples: TermTruths, program: Program, times: Sequence[int]
) -> Truth:
    """Return whether the result holds at the first sample of an endless trace that changes seldom.

    Args:
        graph: The graph to add truths to.
        samples: The truths of terms.
        program: The program.
        times: The samples where values may change, in order, from 0 on; the last run is endless.
    """
    program = positive(program).with_zero(-0.0)
    until = _last_reads(program)
    known: dict[int, _Runs] = {}

    def runs(register: int) -> _Runs:
        if register not in known:  # a predicate
            last = until[register]
            begins = [time for time in times if last is None or time <= last]
            known[register] = _merged((time, samples(program, register, time)) for time in begins)
        return known[register]

    for register in range(program.terms, len(program.instructions)):
        instruction = program.formula(register)
        operands = [runs(operand) for operand in instruction.args]
        if isinstance(instruction, Window):
            known[register] = _window_runs(graph, instruction, operands, until[register])
        else:
            combine = graph.all if instruction.function == "min" else graph.any
            known[register] = _merged(
                (time, combine(operand.at(time) for operand in operands))
                for time in _all_begins(operands)
            )
    return runs(program.result).truths[0]


@dataclass(frozen=True, slots=True)
class _Runs:
    """A truth at all times from 0 on; each value holds until the next start."""

    begins: Sequence[int]
    truths: Sequence[Truth]

    def at(self, time: int) -> Truth:
        return self.truths[bisect_right(self.begins, time) - 1]


def _all_begins(operands: Iterable[_Runs]) -> list[int]:
    return sorted({time for operand in operands for time in operand.begins})


def _merged(runs: Iterable[tuple[int, Truth]]) -> _Runs:
    begins: list[int] = []
    truths: list[Truth] = []
    for time, truth in runs:
        if not truths or truths[-1] != truth:
            begins.append(time)
            truths.append(truth)
    return _Runs(begins, truths)


def _window_runs(
    graph: Graph, window: Window, operands: Sequence[_Runs], until: int | None
) -> _Runs:
    begins = _all_begins(operands)
    elements = [tuple(operand.at(time) for operand in operands) for time in begins]
    lo, hi = window.lo, window.hi
    changes = {0, *(time - end for time in begins for end in (lo, hi) if end is not None)}
    many = {"min": graph.all, "max": graph.any}.get(window.fold)
    combine, identity = graph.fold(window.fold), _identity(window.fold)

    def fold(time: int) -> Truth:
        first = 0 if lo is None else max(0, bisect_right(begins, time + lo) - 1)
        last = len(begins) if hi is None else bisect_right(begins, time + hi)
        if many is not None:  # one node for all elements
            return many(element[0] for element in elements[first:last])
        # Folds are idempotent, so a run counts once.
        return functools.reduce(combine, elements[first:last], identity)[-1]

    times = sorted(time for time in changes if time >= 0 and (until is None or time <= until))
    return _merged((time, fold(time)) for time in times)


def change_times(programs: Iterable[Program], most: int) -> Iterator[tuple[int, ...]]:
    """Yield sets of samples where traces may change, from few to many.

    The first trace does not change. The second changes at the corners of windows and one sample
    later, the third also halfway between, the last also at multiples of half the shortest window.
    """
    yield (0,)
    every = [positive(program) for program in programs]
    corners = sorted(set[int]().union(*map(_corners, every)))
    if len(corners) > _MAX_CORNERS:
        step = len(corners) / _MAX_CORNERS
        corners = [corners[int(i * step)] for i in range(_MAX_CORNERS)]
    times = {0, *(t for c in corners for t in (c, c + 1) if t < most)}
    if len(times) == 1:
        return
    yield tuple(sorted(times))
    finer = times | {(a + b) // 2 for a, b in itertools.pairwise(sorted(times))}
    if len(finer) > len(times):
        yield tuple(sorted(finer))
    lengths = [
        window.hi - window.lo
        for program in every
        for window in program.instructions
        if isinstance(window, Window) and window.lo is not None and window.hi is not None
    ]
    step = max(1, min((length for length in lengths if length > 1), default=2) // 2)
    if most // step <= _MAX_GRID:
        yield tuple(sorted({*times, *range(0, most, step)}))


def _corners(program: Program) -> set[int]:
    """Return the ends of windows, read from the ends of the windows around them."""
    read: list[set[int]] = [set() for _ in program.instructions]
    read[program.result] = {0}
    for register in range(program.result, program.terms - 1, -1):
        instruction, here = program.formula(register), read[register]
        if isinstance(instruction, Window):
            bounds = {instruction.lo, instruction.hi} - {None}
            here = {max(0, time + (bound or 0)) for time in here for bound in bounds or {0}}
        if len(here) > _MAX_CORNERS:
            ordered = sorted(here)
            here = {*ordered[: _MAX_CORNERS // 2], *ordered[-_MAX_CORNERS // 2 :]}
        for operand in instruction.args:
            read[operand] |= here
    return set[int]().union(*read)


ValueRange = tuple[float, float]
"""The minimum and the maximum of a variable, or of its rate of change."""


@dataclass(frozen=True, slots=True)
class VariableLimits:
    """The ranges of variables on every trace, and their rates per second or sample.

    ``steps`` has the minimum and maximum change from one sample to the next.
    """

    ranges: Mapping[str, ValueRange] = field(default_factory=dict)
    rates: Mapping[str, ValueRange] = field(default_factory=dict)
    period: Fraction | None = None
    steps: Mapping[str, ValueRange] = field(init=False)

    def __post_init__(self) -> None:
        steps = {name: _per_sample(rate, self.period) for name, rate in self.rates.items()}
        object.__setattr__(self, "steps", steps)

    def texts(self, variables: Iterable[str]) -> list[str]:
        """Return the limits of some variables in words, in the order of `truths`."""
        names = [*dict.fromkeys(variables)]
        unit = " per sample" if self.period is None else " per second"
        ranges, rates = self.ranges, self.rates
        return [
            *(
                f"declared: {name} in {range_text(ranges[name])}"
                for name in names
                if name in ranges
            ),
            *(
                f"rate: {name} in {range_text(rates[name])}{unit}"
                for name in names
                if name in rates
            ),
        ]

    def truths(
        self,
        graph: Graph,
        variables: Iterable[str],
        times: Sequence[int],
        loop: int,
        room: float = 0.0,
    ) -> list[Truth]:
        """Return a truth for each limit of some variables, which may change at some times.

        The last ``loop`` samples repeat. ``room`` is the share of a step to leave free at its ends.
        """
        names = [*dict.fromkeys(variables)]
        pairs = [*itertools.pairwise(times)]
        if loop:
            pairs.append((times[-1], times[-loop]))

        def within(term: TermKey, bounds: ValueRange) -> list[Truth]:
            lower, upper = bounds
            atoms: list[Atom] = []
            if lower > -math.inf:
                atoms.append(("at_least", term, ("const", lower)))
            if upper < math.inf:
                atoms.append(("at_least", ("const", upper), term))
            return [graph.atom(atom) for atom in atoms]

        def step(name: str, before: int, after: int) -> list[Truth]:
            lower, upper = self.steps[name]
            if room and not lower == -upper == -math.inf:
                width = min(abs(x) for x in (lower, upper, upper - lower) if math.isfinite(x))
                lower, upper = lower + room * width, upper - room * width
            term: TermKey = ("minus", ("load", name, after), ("load", name, before))
            return within(term, (lower, upper))

        ranges = (
            graph.all(t for time in times for t in within(("load", name, time), self.ranges[name]))
            for name in names
            if name in self.ranges
        )
        steps = (
            graph.all(t for pair in pairs for t in step(name, *pair))
            for name in names
            if name in self.steps
        )
        return [*ranges, *steps]

    def allow(self, columns: Mapping[str, Sequence[float]], loop: int) -> bool:
        """Return whether values keep all limits, also at the step back to a repeated sample."""
        for name, (lower, upper) in self.ranges.items():
            if not all(lower <= value <= upper for value in columns.get(name, ())):
                return False
        for name, (lower, upper) in self.steps.items():
            values = [*columns.get(name, ())]
            if loop:
                values.append(values[-loop])
            for before, after in itertools.pairwise(values):
                if before == after and lower <= 0 <= upper:
                    continue
                if not (math.isfinite(before) and math.isfinite(after)):
                    return False
                if not lower <= Fraction(after) - Fraction(before) <= upper:
                    return False
        return True


def _per_sample(rate: ValueRange, period: Fraction | None) -> ValueRange:
    lower, upper = (
        bound if period is None or math.isinf(bound) else float(Fraction(bound) * period)
        for bound in rate
    )
    return lower, upper
