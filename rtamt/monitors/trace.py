"""A trace with a verdict, for its judgement: samples or dense time, over one clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, Protocol

from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.machines.protocols import DenseSigns
from rtamt.machines.segments import PlaceRuns
from rtamt.program.implications import Counted, Reads, TraceSpan
from rtamt.program.program import Program


class TraceClock(NamedTuple):
    """The times of the places of a trace.

    Attributes:
        tick: Seconds from one instant to the next; None: times are numbers of samples.
        start: The instant of place 0.
        step: Places of an instant: 1 for samples; 2 for dense time, where the place 2t + 1 is the
            open interval after tick t.
    """

    tick: Fraction | None
    start: int = 0
    step: int = 1

    @property
    def unit(self) -> str:
        """The unit of times."""
        return "samples" if self.tick is None else "s"

    def time(self, place: int) -> float:
        """Return the time of a place, as a whole number if it is one."""
        time = (self.start + place // self.step) * (1 if self.tick is None else self.tick)
        return int(time) if time.denominator == 1 else float(time)

    def end(self, place: int) -> float:
        """Return the time at which a place ends."""
        return self.time(place + self.step - 1)


class UnseenPlace(NamedTuple):
    """A place after the trace at which a formula fails for certain.

    Attributes:
        place: The place.
        robustness: The largest possible robustness there.
    """

    place: int
    robustness: float


@dataclass(frozen=True)
class TraceRegisters:
    """The registers of a program over a trace that goes on.

    Attributes:
        program: The program, whose windows may be limited to the trace.
        clock: The clock of the trace.
        last: The last place of the trace.
        beyond: The first place after the recorded time.
        cut: Whether the trace was cut; otherwise, anything may follow.
        undecided: Returns the places at which a register may have either sign.
        reach: Returns the formula of a window, and its first and last place relative to its own;
            None without a last place.
    """

    program: Program
    clock: TraceClock
    last: int
    beyond: int
    cut: bool
    undecided: Callable[[int], PlaceRuns]
    reach: Callable[[int], tuple[Node, int, int | None]]


class JudgedTrace(Protocol):
    """A trace with a verdict: `SampleTrace` or `DenseTrace`."""

    @property
    def formula(self) -> Formula:
        """The formula that was judged."""

    @property
    def extent(self) -> TraceSpan:
        """The places of the trace."""

    @property
    def hides(self) -> bool:
        """Whether the semantics of the verdict hides values that left sides need."""

    def reads(self) -> Mapping[Formula, Reads]:
        """Return where the formula reads its implications."""

    def opposite(self, left: Formula) -> DenseSigns:
        """Return the signs of the negation of a left side, by standard semantics."""

    def satisfied_without(self, answered: Sequence[Formula]) -> bool:
        """Return whether the verdict is SATISFIED with ``false`` as right side of implications."""

    def triggers(self, text: str, counted: Counted, *, vacuous: bool) -> object:
        """Return how often an implication was triggered, in the unit of the trace."""

    def registers(self) -> TraceRegisters:
        """Return the registers of the formula, for an end that is not complete."""

    def decided_at(self) -> float | None:
        """Return when the open end was decided."""

    def early_end(self) -> str:
        """Return how a variable ends the trace before others do; empty if none does."""
