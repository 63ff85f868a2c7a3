"""Episodes some of whose samples are not known, or not exactly: each is a pair of episodes.

Until the first such sample, one machine runs alone. From there on a twin goes on from its state:
the one takes the least values of all terms, the twin the greatest. Programs of episodes are
monotone in their predicates (`rtamt.program.placement`), so whatever the samples are inside their
intervals, their robustness lies between the one's and the twin's, and their bounds lie between its
lower bound and the twin's upper one.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import MemberDescriptorType
from typing import Any, NamedTuple

from rtamt.inputs.between import Between
from rtamt.inputs.samples import SampleReader, SampleValues, ends_of, in_between
from rtamt.machines.episode.machine import PythonEpisodeMachine, refuse_update
from rtamt.machines.protocols import End
from rtamt.machines.readout import Readout, moved
from rtamt.machines.state import Retiring, StateFields
from rtamt.machines.terms import Registers
from rtamt.program.intervals import of_ends
from rtamt.program.placement import place
from rtamt.program.program import Program, ranges_of


class SampleTerms(NamedTuple):
    """A sample and its terms, with the least and the greatest value of each.

    Attributes:
        lower: The least values of the variables.
        upper: The greatest values; the same list if all are known.
        least: The least values of the terms.
        greatest: The greatest values; the same list if all are known.
    """

    lower: list[float]
    upper: list[float]
    least: Registers
    greatest: Registers


class PythonUncertainEpisode(Retiring, StateFields):
    """A machine that bounds an episode, whatever the values are that are not known."""

    STATE = ("_apart", "_least", "_greatest", "_moved")
    reader: SampleReader
    _apart: bool
    _moved: float | None

    def __init__(self, program: Program, reader: SampleReader) -> None:
        self._program = place(program).program
        self.reader = reader
        self._least = PythonEpisodeMachine(program, reader)
        self._greatest = PythonEpisodeMachine(program, reader)
        self._readout: Readout | None = None
        self.reset()

    @property
    def samples(self) -> int:
        return self._least.samples

    @property
    def inputs(self) -> SampleValues:
        if not self._apart:
            return [*self._least.inputs]
        ends = zip(self._least.inputs, self._greatest.inputs, strict=True)
        return [in_between(*each) for each in ends]

    @property
    def finished(self) -> bool:
        return self._least.finished

    @property
    def robustness(self) -> float:
        """The least robustness if the episode ended now."""
        return self._least.robustness if self._moved is None else self._moved

    @property
    def result(self) -> float:
        return self.robustness

    @property
    def lower(self) -> float:
        return self._least.lower

    @property
    def upper(self) -> float:
        return (self._greatest if self._apart else self._least).upper

    def update(self, *args: object, **named: object) -> float:
        if self.finished:
            refuse_update()
        values = self.reader.read_sample(args, named, self.samples, self.inputs)
        self.require_current()
        if self.finished:  # by what a value runs when it is read
            refuse_update()
        self.take(self.terms(values))
        return self.robustness

    def terms(self, values: SampleValues) -> SampleTerms:
        """The next sample and its terms, refused if one has no value; changes nothing."""
        ends = [ends_of(value) for value in values]
        lower = [each[0] for each in ends]
        if not any(isinstance(value, Between) for value in values):
            known = self._least.terms(lower)
            return SampleTerms(lower, lower, known, known)
        found = ranges_of(self._program, [of_ends(*each) for each in ends])
        if len(found) < self._program.terms:
            self.reader.refuse(values, self.samples)
        upper = [each[1] for each in ends]
        return SampleTerms(lower, upper, [x.lower for x in found], [x.upper for x in found])

    def take(self, sample: SampleTerms) -> None:
        """Take in a sample whose terms are known."""
        if sample.least is not sample.greatest and not self._apart:
            self._greatest.restore(self._least.state())
            self._apart = True
        self._least.take(sample.least, sample.lower)
        if self._apart:
            self._greatest.take(sample.greatest, sample.upper)
        self._show()

    def finish(self, end: End = "complete") -> float:
        cut, robustness = end == "cut" and self._apart and not self.finished, self.robustness
        self._least.finish(end)
        if self._apart:
            self._greatest.finish(end)
        if cut:  # inside the bounds of both
            self._moved = moved(robustness, self.lower, self.upper)
        self._show()
        return self.robustness

    def reset(self) -> None:
        self._apart, self._moved = False, None
        for machine in (self._least, self._greatest):
            machine.reset()
        self._show()

    def restore(self, state: list[Any]) -> None:
        super().restore(state)
        self._show()

    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        self._readout = Readout(monitor, slots, verdicts)
        self._show()

    def _show(self) -> None:
        if self._readout is not None:
            self._readout.show(self.robustness, self.lower, self.upper)
