"""Episodes with neutral predicates or uncertain values: up to three variants of one episode.

Programs of episodes are monotone in their predicates (`rtamt.program.placement`), so two extremes
enclose every possible robustness. The robustness itself counts neutral predicates as 0.0 and takes
the smallest values.

================  ===================  =================
result            neutral predicates   uncertain values
================  ===================  =================
the lower bound   -0.0                 smallest
the robustness    0.0                  smallest
the upper bound   0.0                  largest
================  ===================  =================

Variants that do not differ are one machine: the first two without neutral predicates, and the last
two until the first uncertain value, when the third continues from the state of the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import MemberDescriptorType
from typing import Any, NamedTuple

from rtamt.inputs.between import UncertainValue
from rtamt.inputs.samples import SampleReader, SampleValues, ends_of, in_between
from rtamt.machines.episode.machine import PythonEpisodeMachine, refuse_update
from rtamt.machines.protocols import End
from rtamt.machines.readout import Readout, moved
from rtamt.machines.state import Retiring, StateFields
from rtamt.machines.terms import Registers
from rtamt.program.intervals import of_ends
from rtamt.program.placement import neutral_registers, variants_of
from rtamt.program.program import Program, ranges_of


class SampleTerms(NamedTuple):
    """The smallest and largest values of a sample and its terms; equal lists if all are known.

    Attributes:
        lower: The smallest values of the variables.
        upper: The largest values of the variables.
        least: The smallest values of the terms.
        greatest: The largest values of the terms.
    """

    lower: list[float]
    upper: list[float]
    least: Registers
    greatest: Registers


class PythonEpisodeVariants(Retiring, StateFields):
    """The episode machine of programs with neutral predicates and of uncertain values."""

    STATE = ("_known", "_largest", "_moved")
    reader: SampleReader
    _largest: list[PythonEpisodeMachine]
    _moved: float | None

    def __init__(self, program: Program, reader: SampleReader) -> None:
        self.reader = reader
        self._programs = variants_of(program)
        self._neutral = neutral_registers(program)
        self._known = [PythonEpisodeMachine(variant, reader) for variant in self._programs]
        self._result = self._known[-1]
        self._readout: Readout | None = None
        self.reset()

    @property
    def _all(self) -> list[PythonEpisodeMachine]:
        return [*self._known, *self._largest]

    @property
    def samples(self) -> int:
        return self._result.samples

    @property
    def inputs(self) -> SampleValues:
        pairs = zip(self._result.inputs, self._all[-1].inputs, strict=True)
        return [in_between(*ends) for ends in pairs] if self._largest else [*self._result.inputs]

    @property
    def finished(self) -> bool:
        return self._result.finished

    @property
    def robustness(self) -> float:
        """The smallest robustness if the episode ended now."""
        return self._result.robustness if self._moved is None else self._moved

    @property
    def result(self) -> float:
        return self.robustness

    @property
    def lower(self) -> float:
        return self._known[0].lower

    @property
    def upper(self) -> float:
        return self._all[-1].upper

    def update(self, *args: object, **named: object) -> float:
        if self.finished:
            refuse_update()
        values = self.reader.read_sample(args, named, self.samples, self.inputs)
        self.require_current()
        if self.finished:  # reading a value may run code of the caller
            refuse_update()
        self.take(self.terms(values))
        return self.robustness

    def terms(self, values: SampleValues) -> SampleTerms:
        """Return the next sample and its terms; refuse a term without a value."""
        ends = [ends_of(value) for value in values]
        lower = [low for low, _ in ends]
        if not any(isinstance(value, UncertainValue) for value in values):
            known = self._result.terms(lower)
            return SampleTerms(lower, lower, known, known)
        ranges = ranges_of(self._result.program, [of_ends(*pair) for pair in ends])
        if len(ranges) < self._result.program.terms:
            self.reader.refuse(values, self.samples)
        upper = [high for _, high in ends]
        return SampleTerms(lower, upper, [x.lower for x in ranges], [x.upper for x in ranges])

    def take(self, sample: SampleTerms) -> None:
        """Take a sample whose terms are known."""
        if sample.least is not sample.greatest and not self._largest:
            self._largest = [self._twin()]
            self._largest[0].restore(self._result.state())
        if self._neutral:
            worst = sample.least.copy()
            for register in self._neutral:
                worst[register] = -0.0
            self._known[0].take(worst, sample.lower)
        self._result.take(sample.least, sample.lower)
        for machine in self._largest:
            machine.take(sample.greatest, sample.upper)
        self._show()

    def _twin(self) -> PythonEpisodeMachine:
        return PythonEpisodeMachine(self._programs[-1], self.reader)

    def finish(self, end: End = "complete") -> float:
        machines, robustness = self._all, self.robustness
        cut = end == "cut" and len(machines) > 1 and not self.finished
        for machine in machines:
            machine.finish(end)
        if cut:
            self._moved = moved(robustness, self.lower, self.upper)
        self._show()
        return self.robustness

    def reset(self) -> None:
        self._largest, self._moved = [], None
        for machine in self._known:
            machine.reset()
        self._show()

    def restore(self, state: list[Any]) -> None:
        before = self.state()
        try:
            self._restore(state)
        except Exception:
            self._restore(before)
            raise
        self._show()

    def _restore(self, state: list[Any]) -> None:
        self._largest = [self._twin() for _ in state[self.STATE.index("_largest")]]
        super().restore(state)

    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        self._readout = Readout(monitor, slots, verdicts)
        self._show()

    def _show(self) -> None:
        if self._readout is not None:
            self._readout.show(self.robustness, self.lower, self.upper)
