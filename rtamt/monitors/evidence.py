"""The evidence for a verdict: how often implications were triggered, and what was not recorded.

An implication is triggered if the formula reads it and its left side holds for certain: then its
right side is needed. If it is never triggered, or if its right side does not matter, a satisfied
formula is weaker evidence than it seems.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.machines.segments import PlaceRuns
from rtamt.program.implications import TraceSpan, implications
from rtamt.program.instructions import Map, Window
from rtamt.program.program import Program
from rtamt.renamed import OldName

_A = TypeVar("_A")


@dataclass(frozen=True, slots=True)
class TriggerCount:
    """How often an implication was triggered on a trace of samples.

    It is triggered at the recorded samples at which the formula reads it and its left side holds
    for certain. ``str`` returns a text such as ``triggered 2 times, first at sample 1``.

    Attributes:
        text: The implication as text.
        samples: The number of these samples.
        count: The number of runs of neighbouring samples; a run at the start of the trace
            counts.
        first: The first of these samples; None if it is never triggered.
        vacuous: Whether the verdict is SATISFIED, and would be with ``false`` as the right side of
            this implication.
    """

    text: str
    samples: int
    count: int
    first: int | None
    vacuous: bool

    occasions = OldName("count")

    def __str__(self) -> str:
        return _in_words(self, f"sample {self.first}")


@dataclass(frozen=True, slots=True)
class DenseTriggerCount:
    """How often an implication was triggered on a trace in dense time.

    It is triggered at the recorded instants at which the formula reads it and its left side holds
    for certain. ``str`` returns a text such as ``triggered 2 times, first at time 1.5``.

    Attributes:
        text: The implication as text.
        duration: How long it was triggered, in seconds; a single instant lasts 0 s.
        count: The number of runs of triggered instants; a run at the start of the trace counts.
        first: The start of the first run, of the kind of the events' times; None if it is never
            triggered. It may be triggered right after that time.
        vacuous: Whether the verdict is SATISFIED, and would be with ``false`` as the right side of
            this implication.
    """

    text: str
    duration: float
    count: int
    first: float | None
    vacuous: bool

    occasions = OldName("count")

    def __str__(self) -> str:
        first = self.first
        time = f"{first:.12g}" if isinstance(first, float | int) else str(first)
        return _in_words(self, f"time {time}")


def _in_words(row: TriggerCount | DenseTriggerCount, first: str) -> str:
    if row.first is None:
        return "never triggered"
    answer = ", satisfied without an answer" if row.vacuous else ""
    times = "time" if row.count == 1 else "times"
    return f"triggered {row.count} {times}, first at {first}{answer}"


@dataclass(frozen=True, slots=True)
class Evidence(Generic[_A]):
    """The evidence for a verdict; returned by `Implications`, and part of a `Judgement`.

    Attributes:
        triggers: For each implication a `TriggerCount` or a `rtamt.dense.TriggerCount`, in the
            order of the text, the outer implication first.
        vacuous: Whether the verdict is SATISFIED, and would be with ``false`` as all right sides.
        never_triggered: Whether the verdict is SATISFIED, the formula has implications, and they
            were never triggered.
    """

    triggers: tuple[_A, ...]
    vacuous: bool
    never_triggered: bool

    asked = OldName("triggers")
    never_asked = OldName("never_triggered")


@functools.lru_cache(maxsize=512)
def text_of(formula: Formula) -> str:
    """Return the formula as text."""
    return str(formula)


def texts_of(formula: Formula) -> tuple[str, ...]:
    """Return the implications of a formula that count, as text."""
    return tuple(text_of(implication) for implication in implications(formula))


@dataclass(frozen=True, slots=True)
class Unrecorded:
    """A formula whose value at a time needs more than was recorded.

    ``str`` returns a text such as ``always[20:30](x > 5): not recorded: 20 s to 30 s``.

    Attributes:
        formula: The formula as text.
        at: The time at which its value is needed, in seconds; in samples without a period.
        start: The start of the unrecorded interval, in the same unit.
        end: The end of the interval; None without an end.
        unit: ``"s"`` or ``"samples"``.
    """

    formula: str
    at: float
    start: float
    end: float | None
    unit: str

    begin = OldName("start")

    def __str__(self) -> str:
        where = f" at {self._moment(self.at)}" if self.at else ""
        return f"{self.formula}{where}: not recorded: {self._interval()}"

    def _interval(self) -> str:
        if self.end is None:
            return f"{self._moment(self.start)} and later"
        if self.end == self.start:
            return self._moment(self.start)
        if self.unit == "s":
            return f"{self._moment(self.start)} to {self._moment(self.end)}"
        return f"samples {self.start:.12g} to {self.end:.12g}"

    def _moment(self, time: float) -> str:
        return f"{time:.12g} s" if self.unit == "s" else f"sample {time:.12g}"


class TraceRegisters(NamedTuple):
    """The registers of a program over a trace that goes on.

    ``undecided`` returns the places at which a register may have either sign. ``reach`` returns the
    formula of a window, and its first and last place relative to its own; None without a last one.
    """

    program: Program
    undecided: Callable[[int], PlaceRuns]
    reach: Callable[[int], tuple[Node, int, int | None]]


def unrecorded_intervals(
    registers: TraceRegisters, span: TraceSpan
) -> dict[tuple[Node, int], tuple[int, int | None]]:
    """Return the outermost formulas, their places, and the unrecorded intervals that they need.

    The search goes from the root to operands, at the first place at which they are undecided.
    """
    program, last = registers.program, span.last
    undecided = functools.cache(registers.undecided)
    beyond = last if span.dense else last + 1  # the last tick is the end of the trace
    intervals: dict[tuple[Node, int], tuple[int, int | None]] = {}
    stack, seen = [(program.result, 0)], set[tuple[int, int]]()
    while stack:
        key = register, sample = stack.pop()
        if key in seen or register < program.terms:
            continue
        seen.add(key)
        instruction = program.instructions[register]
        if isinstance(instruction, Map):
            below = [operand for operand in instruction.args if operand >= program.terms]
            stack += [
                (r, sample) for r in below if undecided(r).first_between(sample, sample) is not None
            ]
        elif isinstance(instruction, Window):
            begin = 0 if instruction.lo is None else max(0, sample + instruction.lo)
            end = None if instruction.hi is None else sample + instruction.hi
            missing = _lacks(instruction, sample, last, cut=span.cut)
            for operand in instruction.args:
                places = undecided(operand)
                first = places.first_between(begin, last if end is None else min(end, last))
                if first is not None:
                    stack.append((operand, first))
                if not missing and end is not None:
                    missing = places.first_between(max(begin, last + 1), end) is not None
            if missing:
                node, lo, hi = registers.reach(register)
                interval = max(beyond, sample + lo), None if hi is None else sample + hi
                known = intervals.get((node, sample), interval)
                intervals[node, sample] = _joined(known, interval)
    return intervals


def _lacks(window: Window, at: int, last: int, *, cut: bool) -> bool:
    """Return whether a window at a place ends after the trace, for any operands."""
    if cut:
        unbounded = window.endless or window.hi is None
        return unbounded and at + window.begin > last
    # A sample after the trace may not exist, except at the window's own time.
    return window.hi is None or (window.hi > 0 and at + window.hi > last)


def _joined(one: tuple[int, int | None], other: tuple[int, int | None]) -> tuple[int, int | None]:
    end = None if one[1] is None or other[1] is None else max(one[1], other[1])
    return min(one[0], other[0]), end
