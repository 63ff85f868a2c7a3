"""Triggers: how often the left sides of a formula's implications held on a trace.

An implication is triggered if the formula reads it and its left side holds for certain: then its
right side is needed. If it is never triggered, or if its right side does not matter, a satisfied
formula is weaker evidence than it seems (`rtamt.monitors.implications`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Generic, TypeVar

from rtamt.language.formula import Formula
from rtamt.program.implications import implications
from rtamt.program.interface import Interface
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


@functools.lru_cache(maxsize=512)
def reads_hidden(formula: Formula, interface: Interface) -> bool:
    """Return whether a left side has a predicate that counts 0 by the semantics of the verdict."""
    lefts = (implication.args[0].nodes() for implication in implications(formula))
    return any(
        interface.reading(node) == "zero"
        for nodes in lefts
        for node in nodes
        if node.op is not None and node.op.holds is not None
    )
