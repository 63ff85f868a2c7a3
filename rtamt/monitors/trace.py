"""Places and times of a judged trace: samples or dense time, over one clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from rtamt.language.node import Node
from rtamt.machines.segments import PlaceRuns
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
