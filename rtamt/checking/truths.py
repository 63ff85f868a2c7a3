"""The truth of a program's result on a trace whose samples are unknown numbers, for a solver.

The sign bit of the robustness is the truth of the formula, so a register is a truth here, not a
number: a minimum is a conjunction, a maximum a disjunction, and folds of windows act on truths as
they do on numbers. `rtamt.machines.episode.machine` tells of the worlds, and of
what a window skips in them; here a world may be endless too: a trace that repeats its last samples
for ever.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from rtamt.checking.graph import FALSE, TRUE, Graph, Truth
from rtamt.checking.samples import TermTruths
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Window
from rtamt.program.placement import positive
from rtamt.program.program import Program

__all__ = ["COMBINED", "World", "read_until", "truth"]

_Element = tuple[Truth, ...]


class World(Enum):
    """What follows the last sample; see `rtamt.machines.episode.machine`."""

    COMPLETE = "complete"
    LOWER = "lower"
    UPPER = "upper"
    CUT_LOWER = "cut lower"
    CUT_UPPER = "cut upper"
    ENDLESS = "endless"

    @property
    def open(self) -> World:
        """The world whose values a future without end has where nothing was recorded."""
        return World.LOWER if self is World.CUT_LOWER else World.UPPER

    @property
    def cut(self) -> bool:
        """Whether windows with an end are there in full."""
        return self in {World.CUT_LOWER, World.CUT_UPPER}

    @property
    def best(self) -> bool:
        """Whether unseen predicates hold."""
        return self in {World.UPPER, World.CUT_UPPER}


def truth(
    graph: Graph,
    samples: TermTruths,
    program: Program,
    count: int,
    world: World,
    loop: int = 1,
    deadline: float = math.inf,
) -> Truth:
    """Whether the result holds at the first sample.

    Args:
        graph: Where truths are made.
        samples: The samples.
        program: The program.
        count: How many samples there are.
        world: What follows the last sample.
        loop: How many of the last samples repeat for ever in the endless world.
        deadline: When to give up, as `time.monotonic` tells the time.

    Raises:
        TimeoutError: If it is too late.
    """
    read = positive(program).with_zero(0.0 if world.best else -0.0)
    return _Encoding(graph, samples, read, count, loop, deadline).at_begin(world)


@dataclass(frozen=True, slots=True)
class _Course:
    """A truth at all times from 0 on: the last ``loop`` of its values repeat for ever."""

    values: Sequence[Truth]
    loop: int

    def at(self, time: int) -> Truth:
        over = time - len(self.values)
        return self.values[time if over < 0 else len(self.values) - self.loop + over % self.loop]

    @property
    def start(self) -> int:
        """The time from which on it repeats."""
        return len(self.values) - self.loop


class _Encoding:
    def __init__(
        self,
        graph: Graph,
        samples: TermTruths,
        program: Program,
        count: int,
        loop: int,
        deadline: float,
    ) -> None:
        self.graph, self.samples, self.program, self.loop = graph, samples, program, loop
        self.last, self.deadline = count - 1, deadline
        self.until = read_until(program)
        self.known: dict[tuple[int, World], _Course] = {}

    def at_begin(self, world: World) -> Truth:
        """Whether the result holds at the first sample; depth first, without recursion."""
        stack = [(self.program.result, world)]
        while stack:
            key = stack[-1]
            missing = [need for need in self._needs(*key) if need not in self.known]
            if missing:
                stack.extend(missing)
                continue
            stack.pop()
            if key not in self.known:
                self.known[key] = self._found(*key)
        return self.known[self.program.result, world].at(0)

    def _needs(self, register: int, world: World) -> list[tuple[int, World]]:
        if register < self.program.terms:
            return []
        instruction = self.program.formula(register)
        needs = [(a, world) for a in instruction.args]
        if isinstance(instruction, Window) and _has_open_values(instruction, world):
            needs.append((register, world.open))
        return needs

    def _found(self, register: int, world: World) -> _Course:
        if register < self.program.terms:
            return self._predicate(register, world)
        instruction = self.program.formula(register)
        if isinstance(instruction, Window):
            return self._window(register, instruction, world)
        operands = [self.known[a, world] for a in instruction.args]
        combine = self.graph.all if instruction.function == "min" else self.graph.any
        start = max(operand.start for operand in operands)
        return self._made(register, start, lambda i: combine(o.at(i) for o in operands))

    def _made(self, register: int, start: int, value: Callable[[int], Truth]) -> _Course:
        """A course that repeats from a time on; without the times that nobody reads."""
        until, loop = self.until[register], self.loop
        if until is not None and until < start + loop:
            start, loop = until, 1
        values = []
        for i in range(start + loop):
            if time.monotonic() > self.deadline:
                raise TimeoutError
            values.append(value(i))
        return _Course(values, loop)

    def _predicate(self, register: int, world: World) -> _Course:
        if isinstance(self.program.instructions[register], Const):
            return _Course([self.samples(self.program, register, 0)] * self.loop, self.loop)
        start = self.last + 1 if world is not World.ENDLESS else self.last + 1 - self.loop

        def value(i: int) -> Truth:
            if i > self.last:
                return TRUE if world.best else FALSE
            return self.samples(self.program, register, i)

        return self._made(register, start, value)

    def _window(self, register: int, window: Window, world: World) -> _Course:
        operands = [self.known[a, world] for a in window.args]
        ahead = window.hi is None or window.hi > 0
        skips = world in {World.LOWER, World.UPPER} and window.skips(best=world.best)
        ends = ahead and (world is World.COMPLETE or skips or (world.cut and window.hi is None))
        folds = _Folds(self.graph, window.fold, operands, self.last if ends else None, self.loop)
        start = folds.start + _behind(window, self.loop)
        if world is not World.ENDLESS:
            start = max(start, self.last + 1)
        others = self.known[register, world.open] if _has_open_values(window, world) else None
        others_from = self.last + 1 - window.begin
        if others is not None:
            start = max(start, others.start, others_from)

        def value(i: int) -> Truth:
            if others is not None and i >= others_from:
                return others.at(i)
            if skips and i > self.last:
                return operands[-1].at(i) if window.lo == 0 else folds.nothing[-1]
            return folds.over(i, window.lo, window.hi)[-1]

        return self._made(register, start, value)


def _has_open_values(window: Window, world: World) -> bool:
    """Whether it has the values of the open reading where nothing of its operator was recorded."""
    return world.cut and (window.endless or window.hi is None)


def _behind(window: Window, loop: int) -> int:
    """For how long after its operands a window does not repeat yet."""
    if window.lo is None:
        return loop + max(0, -(window.hi or 0))
    return max(0, -window.lo)


def read_until(program: Program) -> list[int | None]:
    """The last time at which each register is read; None: there is none."""
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


class _Folds:
    """Folds of truths over windows, which share what they have in common.

    Attributes:
        start: The time from which on the elements repeat.
        nothing: The element outside of the trace.
    """

    def __init__(
        self, graph: Graph, fold: str, operands: Sequence[_Course], end: int | None, loop: int
    ) -> None:
        self.nothing: _Element = tuple(TRUE if x > 0 else FALSE for x in FOLDS[fold].identity)
        self.start = max(operand.start for operand in operands)
        if end is not None:
            self.start = max(self.start, end + 1)
        self._operands, self._end, self._loop = operands, end, loop
        self._combine = functools.partial(COMBINED[fold], graph)
        self._blocks: dict[tuple[int, int], _Element] = {}
        self._prefixes: list[_Element] = []
        self._suffixes: dict[int, _Element] = {}

    def over(self, time: int, lo: int | None, hi: int | None) -> _Element:
        """The fold over offsets lo to hi from a time."""
        if lo is None:
            return self._prefix(time + (hi or 0))
        begin = max(0, time + lo)
        if hi is None:
            return self._suffix(begin)
        length = time + hi - begin + 1
        if self._end is not None:
            length = min(length, self._end - begin + 1)
        # A fold over more than what repeats, once, is the same: folds are idempotent.
        length = min(length, max(0, self.start - begin) + 2 * self._loop)
        folded = self.nothing
        size = 0
        while length > 0:
            if length & 1:
                folded = self._combine(folded, self._block(begin, size))
                begin += 1 << size
            length >>= 1
            size += 1
        return folded

    def _element(self, time: int) -> _Element:
        if self._end is not None and time > self._end:
            return self.nothing
        return tuple(operand.at(time) for operand in self._operands)

    def _block(self, begin: int, size: int) -> _Element:
        """The fold of 2**size elements."""
        if begin > self.start:
            begin = self.start + (begin - self.start) % self._loop
        key = begin, size
        if key not in self._blocks:
            if size == 0:
                self._blocks[key] = self._element(begin)
            else:
                half = (
                    self._block(begin, size - 1),
                    self._block(begin + (1 << (size - 1)), size - 1),
                )
                self._blocks[key] = self._combine(*half)
        return self._blocks[key]

    def _prefix(self, end: int) -> _Element:
        if end < 0:
            return self.nothing
        repeats = self.start + self._loop
        if end > repeats:
            end = repeats + (end - repeats) % self._loop
        while len(self._prefixes) <= end:
            before = self._prefixes[-1] if self._prefixes else self.nothing
            self._prefixes.append(self._combine(before, self._element(len(self._prefixes))))
        return self._prefixes[end]

    def _suffix(self, begin: int) -> _Element:
        if begin > self.start:
            begin = self.start + (begin - self.start) % self._loop
        if begin not in self._suffixes:
            time = min(begin, self.start)
            folded = self.nothing
            for i in range(max(begin, self.start) + self._loop - 1, max(begin, self.start) - 1, -1):
                folded = self._combine(self._element(i), folded)
            if begin >= self.start:
                self._suffixes[begin] = folded
            else:
                for i in range(self.start - 1, time - 1, -1):
                    folded = self._combine(self._element(i), folded)
                    self._suffixes[i] = folded
        return self._suffixes[begin]


def _until(g: Graph, x: _Element, y: _Element) -> _Element:
    return g.all([x[0], y[0]]), g.any([x[1], g.all([x[0], y[1]])])


def _release(g: Graph, x: _Element, y: _Element) -> _Element:
    return g.any([x[0], y[0]]), g.all([x[1], g.any([x[0], y[1]])])


def _since(g: Graph, x: _Element, y: _Element) -> _Element:
    return g.all([x[0], y[0]]), g.any([y[1], g.all([y[0], x[1]])])


def _trigger(g: Graph, x: _Element, y: _Element) -> _Element:
    return g.any([x[0], y[0]]), g.all([y[1], g.any([y[0], x[1]])])


COMBINED: Mapping[str, Callable[[Graph, _Element, _Element], _Element]] = {
    "min": lambda g, x, y: (g.all([x[0], y[0]]),),
    "max": lambda g, x, y: (g.any([x[0], y[0]]),),
    "until": _until,
    "release": _release,
    "since": _since,
    "trigger": _trigger,
}
"""The folds of `rtamt.program.algebra`, on truths."""
