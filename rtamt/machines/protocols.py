"""What a machine offers, whichever back-end it comes from.

Each machine exists at least twice: in C++, in `rtamt._native`, by the name that its protocol has
here, and in Python, with ``Python`` in front (`PythonDiscreteMachine`). The Python machine is the
definition: where the two differ, the C++ machine is wrong.

===================  ========================================================================
`DiscreteMachine`    runs a program on samples: `rtamt.machines.discrete`
`EpisodeMachine`     bounds the robustness of an episode: `rtamt.machines.episode.machine`
`DenseMachine`       runs a program on events over dense time: `rtamt.machines.dense.machine`
`DiscreteBank`       many discrete machines in lockstep: `rtamt.machines.bank`
`EpisodeBank`        many episode machines in lockstep: `rtamt.machines.bank`
===================  ========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.events import Column

__all__ = [
    "Bank",
    "DenseMachine",
    "DiscreteBank",
    "DiscreteMachine",
    "EpisodeBank",
    "EpisodeMachine",
    "SampleMachine",
    "Snapshot",
    "Stateful",
]

Snapshot = Any
"""State of a machine; only a machine of the same program and back-end knows what is in it."""


class Stateful(Protocol):
    """What can be stopped and continued elsewhere."""

    def state(self) -> Snapshot:
        """A copy of the state, which ``restore`` takes."""

    def restore(self, state: Snapshot) -> None:
        """Continue from where ``state`` was taken."""


class SampleMachine(Stateful, Protocol):
    """A machine that takes in samples."""

    @property
    def samples(self) -> int:
        """Samples taken in since the reset."""

    @property
    def inputs(self) -> Sequence[float]:
        """The last sample, empty before the first."""

    @property
    def update(self) -> Callable[..., float]:
        """Take in one sample, in any of the argument forms; the robustness."""

    def reset(self) -> None:
        """Forget every sample."""


class DiscreteMachine(SampleMachine, Protocol):
    """Runs a program whose every register has a latency."""

    @property
    def registers(self) -> Sequence[float]:
        """The value of every register."""

    def run(
        self, columns: Sequence[NDArray[np.float64]], n: int, *, final: bool
    ) -> list[NDArray[np.float64]]:
        """Take in n samples at once, all or none; the observed registers at each."""


class EpisodeMachine(SampleMachine, Protocol):
    """Runs a program at time 0, future without end included."""

    @property
    def robustness(self) -> float:
        """The robustness if the episode ended now."""

    @property
    def lower(self) -> float:
        """The least robustness over all continuations."""

    @property
    def upper(self) -> float:
        """The greatest robustness over all continuations."""

    def bounds(self) -> tuple[float, float]:
        """Both bounds in one call."""

    @property
    def finished(self) -> bool:
        """Whether the trace has ended."""

    def finish(self) -> float:
        """End the trace; its robustness."""


class DenseMachine(Stateful, Protocol):
    """Runs a program on events, each variable at its own pace."""

    @property
    def settled(self) -> float:
        """The time before which the result is known."""

    @property
    def finished(self) -> bool:
        """Whether the trace has ended."""

    @property
    def values(self) -> Sequence[float]:
        """The observed registers just before they are unknown."""

    @property
    def update(self) -> Callable[..., list[tuple[float, float]]]:
        """Take in new events; the breakpoints of the result that are settled by them."""

    def finish(self) -> list[tuple[float, float]]:
        """End the trace; the breakpoints that are left."""

    def run(self, columns: Sequence[Column]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times and values of the result over the whole trace of a new machine."""

    def reset(self) -> None:
        """Forget every event."""


class Bank(Stateful, Protocol):
    """Machines of one program in lockstep, each in a lane with a time of its own."""

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples taken in by every lane since its reset."""

    def update(self, values: ArrayLike, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """Take in a sample in every lane that the mask chooses; the result of every lane."""

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget every sample of the lanes that the mask chooses."""


class DiscreteBank(Bank, Protocol):
    """Discrete machines in lockstep."""


class EpisodeBank(Bank, Protocol):
    """Episode machines in lockstep."""

    @property
    def robustness(self) -> NDArray[np.float64]:
        """The robustness of every lane if its episode ended now."""

    @property
    def lower(self) -> NDArray[np.float64]:
        """The least robustness over all continuations."""

    @property
    def upper(self) -> NDArray[np.float64]:
        """The greatest robustness over all continuations."""

    @property
    def verdict(self) -> NDArray[np.int8]:
        """1 where lower is above 0, -1 where upper is below, else 0."""

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Whether the traces have ended."""

    def finish(self, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """End the traces of the lanes that the mask chooses; the robustness of every lane."""
