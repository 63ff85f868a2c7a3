"""Traces that a search has found, and whether the monitors judge them as was asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from rtamt.checking.graph import TRUE, Graph
from rtamt.checking.samples import known_samples
from rtamt.checking.truths import World, truth
from rtamt.machines.protocols import End
from rtamt.monitors.judgement import Judgement, judge
from rtamt.monitors.verdict import Verdict
from rtamt.program.program import Program

__all__ = ["ExampleTrace", "Goal", "judged_so", "shortened"]


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


def judged_so(
    trace: ExampleTrace, goals: Sequence[Goal], period: Fraction | None, end: End
) -> bool:
    """Whether the monitors judge a trace as all goals want it.

    Args:
        trace: The trace.
        goals: What it is to be like.
        period: Seconds between samples, or None.
        end: How the end of a trace is read that does not repeat.
    """
    for goal in goals:
        program = goal.program
        try:
            if trace.loop:
                samples, world = known_samples(trace.columns), World.ENDLESS
                found = truth(Graph(), samples, program, trace.samples, world, trace.loop)
                if (found == TRUE) is not goal.holds:
                    return False
            # The monitors see a part of a trace that does not end; it must not say otherwise.
            verdict = _judged(trace, program, period, "open" if trace.loop else end).verdict
        except ValueError:
            return False
        wanted = Verdict.SATISFIED if goal.holds else Verdict.VIOLATED
        if verdict is not wanted and not (trace.loop and verdict is Verdict.UNDECIDED):
            return False
    return True


def shortened(
    trace: ExampleTrace, goals: Sequence[Goal], period: Fraction | None, end: End
) -> ExampleTrace:
    """The begin of a trace that is judged as all goals want it.

    It ends at the sample at which the verdicts are certain, or soon after a first one that is
    judged so, where the reading of the end has a part in the verdict.
    """
    decided = [_judged(trace, goal.program, period, end).decided_at for goal in goals]
    count = 1 + max((int(at) for at in decided if at is not None), default=0)
    while count < trace.samples:
        columns = {name: values[:count] for name, values in trace.columns.items()}
        short = ExampleTrace(columns, count, 0)
        if judged_so(short, goals, period, end):
            return short
        count *= 2
    return trace


def _judged(trace: ExampleTrace, program: Program, period: Fraction | None, end: End) -> Judgement:
    columns = {name: trace.unrolled(name) for name in program.variables}
    n = None if columns else trace.samples
    return judge(program.specification, columns, period, end, n=n)
