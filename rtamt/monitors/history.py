"""A machine that keeps its samples."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import StateError
from rtamt.machines.backend import EpisodeMachine, Snapshot

__all__ = ["Recorder"]


class Recorder:
    """An episode machine, and every sample that it has taken in since its reset.

    Args:
        machine: A new one.
    """

    def __init__(self, machine: EpisodeMachine) -> None:
        self._machine = machine
        self._kept = array("d")
        self.update = _recording(machine, self._kept)

    @property
    def table(self) -> NDArray[np.float64]:
        """The samples, of shape (samples, variables).

        Raises:
            StateError: Before the first sample.
        """
        if not self.samples:
            msg = "explain() needs at least one sample, got none since reset"
            raise StateError(msg)
        return np.array(self._kept).reshape(self.samples, len(self.inputs))

    @property
    def samples(self) -> int:
        """Samples taken in since the reset."""
        return self._machine.samples

    @property
    def inputs(self) -> Sequence[float]:
        """The last sample, empty before the first."""
        return self._machine.inputs

    @property
    def robustness(self) -> float:
        """Robustness if the episode ended now."""
        return self._machine.robustness

    @property
    def lower(self) -> float:
        """The least over all continuations."""
        return self._machine.lower

    @property
    def upper(self) -> float:
        """The greatest over all continuations."""
        return self._machine.upper

    def bounds(self) -> tuple[float, float]:
        """Both bounds in one call."""
        return self._machine.bounds()

    @property
    def finished(self) -> bool:
        """Whether the trace has ended."""
        return self._machine.finished

    def finish(self) -> float:
        """End the trace."""
        return self._machine.finish()

    def reset(self) -> None:
        """Forget every sample."""
        self._machine.reset()
        del self._kept[:]

    def state(self) -> object:
        """What ``restore`` needs to continue from here."""
        return self._machine.state(), self._kept.tobytes()

    def restore(self, state: Snapshot) -> None:
        """Continue from where ``state`` was taken."""
        of_machine, kept = state
        self._machine.restore(of_machine)
        self._kept[:] = array("d", kept)


def _recording(machine: EpisodeMachine, kept: array[float]) -> Callable[..., float]:
    update, keep = machine.update, kept.extend

    def recorded(*args: object, **named: object) -> float:
        robustness = update(*args, **named)
        keep(machine.inputs)
        return robustness

    return recorded
