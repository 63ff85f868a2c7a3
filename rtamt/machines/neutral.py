"""Episodes whose formula has neutral predicates: each is a pair of episodes.

A predicate that counts 0 under interface-aware semantics neither holds nor fails. In one episode it
is -0.0, which gives the lower bound; in the other it is 0.0, which gives the upper bound and the
robustness. Programs of episodes are monotone in their predicates (`rtamt.program.placement`), so
every other reading lies between these two. What hangs on such a predicate stays undecided: -0.0 is
its lower bound, and 0.0 its upper.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from types import MemberDescriptorType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.between import Between
from rtamt.inputs.lanes import LaneReader
from rtamt.inputs.samples import SampleReader
from rtamt.machines.protocols import End, EpisodeBank, EpisodeMachine, MachineState, Stateful
from rtamt.machines.readout import Readout, moved, verdicts_of
from rtamt.program.algebra import greater, lesser
from rtamt.program.placement import positive
from rtamt.program.program import Program

Floats = NDArray[np.float64]
MakeEpisodeMachine = Callable[[Program, SampleReader], EpisodeMachine]
MakeBank = Callable[[Program, int, LaneReader], EpisodeBank]

_S = TypeVar("_S", bound=Stateful)


def machine_with_neutrals(make: MakeEpisodeMachine) -> MakeEpisodeMachine:
    """The function that makes a machine of a back-end, for programs with neutral predicates too."""

    def made(program: Program, reader: SampleReader) -> EpisodeMachine:
        readings = _readings(program)
        if readings is None:
            return make(program, reader)
        worst, best = readings
        return _NeutralMachine(make(worst, reader), make(best, reader), len(program.inputs))

    return made


def bank_with_neutrals(make: MakeBank) -> MakeBank:
    """The function that makes a bank of a back-end, for programs with neutral predicates too."""

    def made(program: Program, num: int, reader: LaneReader) -> EpisodeBank:
        readings = _readings(program)
        if readings is None:
            return make(program, num, reader)
        worst, best = readings
        return _NeutralBank(make(worst, num, reader), make(best, num, reader))

    return made


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _readings(program: Program) -> tuple[Program, Program] | None:
    """The program with -0.0 and with 0.0 for its neutral predicates; None if it has none."""
    if not program.neutral:
        return None
    program = positive(program)  # a negated one is as neutral, and its worst reading is -0.0 too
    return program.reading(-0.0), program.reading(0.0)


def _parts(state: MachineState) -> tuple[MachineState, MachineState, Any]:
    """The states of the two readings, and the robustness of what was cut."""
    if not isinstance(state, tuple) or len(state) != 3:
        raise ValueError(
            "expected a state that a machine with predicates that count 0 gave; those of other "
            "programs do not fit"
        )
    return state


def _restore(pairs: Sequence[tuple[_S, MachineState]]) -> None:
    """Restore all machines, or none."""
    before = [machine.state() for machine, _ in pairs]
    try:
        for machine, state in pairs:
            machine.restore(state)
    except Exception:
        for (machine, _), state in zip(pairs, before, strict=True):
            machine.restore(state)
        raise


class _NeutralMachine:
    """A machine that bounds an episode, from the two readings of its neutral predicates.

    Args:
        worst: The machine of one reading.
        best: The machine of the other.
        width: The number of values of a sample, without rates.
    """

    def __init__(self, worst: EpisodeMachine, best: EpisodeMachine, width: int) -> None:
        self._worst, self._best = worst, best
        self._width = width
        self._moved: float | None = None  # the robustness, if the trace was cut
        self._readout: Readout | None = None

    @property
    def samples(self) -> int:
        return self._best.samples

    @property
    def inputs(self) -> Sequence[float | Between]:
        return self._best.inputs

    @property
    def finished(self) -> bool:
        return self._best.finished

    @property
    def robustness(self) -> float:
        return self._best.robustness if self._moved is None else self._moved

    @property
    def lower(self) -> float:
        return self._worst.lower

    @property
    def upper(self) -> float:
        return self._best.upper

    def update(self, *args: object, **named: object) -> float:
        robustness = self._best.update(*args, **named)
        self._worst.update(list(self._best.inputs[: self._width]))
        self._show()
        return robustness

    def finish(self, end: End = "complete") -> float:
        cut, robustness = end == "cut" and not self.finished, self.robustness
        self._best.finish(end)
        self._worst.finish(end)
        if cut:
            self._moved = moved(robustness, self.lower, self.upper)
        self._show()
        return self.robustness

    def retire(self) -> None:
        for machine in (self._worst, self._best):
            machine.retire()

    def reset(self) -> None:
        for machine in (self._worst, self._best):
            machine.reset()
        self._moved = None
        self._show()

    def state(self) -> MachineState:
        return self._worst.state(), self._best.state(), self._moved

    def restore(self, state: MachineState) -> None:
        worst, best, robustness = _parts(state)
        _restore([(self._worst, worst), (self._best, best)])
        self._moved = robustness
        self._show()

    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        self._readout = Readout(monitor, slots, verdicts)
        self._show()

    def _show(self) -> None:
        if self._readout is not None:
            self._readout.show(self.robustness, self.lower, self.upper)


class _NeutralBank:
    """A bank of machines that bound episodes, from the two readings of neutral predicates."""

    def __init__(self, worst: EpisodeBank, best: EpisodeBank) -> None:
        self._worst, self._best = worst, best
        self._moved = np.full(len(best.samples), np.nan)  # the robustness of lanes that were cut

    @property
    def samples(self) -> NDArray[np.int64]:
        return self._best.samples

    @property
    def finished(self) -> NDArray[np.bool_]:
        return self._best.finished

    @property
    def robustness(self) -> Floats:
        return np.where(np.isnan(self._moved), self._best.robustness, self._moved)

    @property
    def lower(self) -> Floats:
        return self._worst.lower

    @property
    def upper(self) -> Floats:
        return self._best.upper

    @property
    def unknown(self) -> NDArray[np.bool_]:
        return self._best.unknown

    @property
    def inputs(self) -> Floats:
        return self._best.inputs

    @property
    def verdict(self) -> NDArray[np.int8]:
        return verdicts_of(self.lower, self.upper)

    def update(
        self, values: ArrayLike, mask: ArrayLike | None = None, upper: ArrayLike | None = None
    ) -> Floats:
        self._best.update(values, mask, upper)
        self._worst.update(values, mask, upper)
        return self.robustness

    def finish(self, mask: ArrayLike | None = None, end: End = "complete") -> Floats:
        before, robustness = self.finished, self.robustness
        self._best.finish(mask, end)
        self._worst.finish(mask, end)
        if end == "cut":
            ended = self.finished & ~before
            inside = greater(self.lower, lesser(robustness, self.upper))
            self._moved = np.where(ended, inside, self._moved)
        return self.robustness

    def reset(self, mask: ArrayLike | None = None) -> None:
        for bank in (self._worst, self._best):
            bank.reset(mask)
        self._moved = np.where(self.finished, self._moved, np.nan)

    def state(self) -> MachineState:
        return self._worst.state(), self._best.state(), self._moved.copy()

    def restore(self, state: MachineState) -> None:
        worst, best, robustness = _parts(state)
        _restore([(self._worst, worst), (self._best, best)])
        self._moved = robustness.copy()
