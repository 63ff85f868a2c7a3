"""Which machines run: the C++ ones where they were built, else the Python ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError
from rtamt.inputs.events import Column, EventReader
from rtamt.inputs.lanes import LaneReader
from rtamt.inputs.samples import SampleReader
from rtamt.machines import bank, discrete
from rtamt.machines.dense import machine as dense
from rtamt.machines.episode import machine as episode
from rtamt.program.dense_lowering import DenseProgram, encoded_dense
from rtamt.program.placement import place
from rtamt.program.program import Program
from rtamt.program.schedule import encoded

try:
    import rtamt._native as _native  # noqa: PLR0402 - `from` would hide which module is absent
except ModuleNotFoundError as absent:  # a module that is there but does not load is a broken build
    if absent.name != "rtamt._native":
        raise
    _built: Literal["native", "python"] = "python"
else:
    _built = "native"

__all__ = [
    "BACKEND",
    "Backend",
    "DenseMachine",
    "DiscreteBank",
    "DiscreteMachine",
    "EpisodeBank",
    "EpisodeMachine",
    "LaneMachine",
    "Machine",
    "Stateful",
    "choose",
    "dense_machine",
    "discrete_bank",
    "discrete_machine",
    "episode_bank",
    "episode_machine",
]

BACKEND: Final = _built
"""``"native"`` where the C++ machines are built, ``"python"`` where no compiler was at hand."""

Backend = Literal["auto", "native", "python"]


Snapshot = Any
"""State of a machine; only the machine of the same back-end knows what is in it."""


class Stateful(Protocol):
    """What can be stopped and continued elsewhere."""

    def state(self) -> object:
        """What ``restore`` needs to continue from here."""

    def restore(self, state: Snapshot) -> None:
        """Continue from where ``state`` was taken."""


class Machine(Stateful, Protocol):
    """What the machines of both back-ends offer to a monitor."""

    @property
    def samples(self) -> int:
        """Samples taken in since the reset."""

    @property
    def inputs(self) -> Sequence[float]:
        """The last sample, empty before the first."""

    @property
    def update(self) -> Callable[..., float]:
        """Take in one sample, in any of the argument forms."""

    def reset(self) -> None:
        """Forget every sample."""


class DiscreteMachine(Machine, Protocol):
    """Runs a program on samples; `rtamt.machines.discrete.Machine` says what it means."""

    @property
    def registers(self) -> Sequence[float]:
        """The value of every register."""

    def run(
        self, columns: Sequence[NDArray[np.float64]], n: int, *, final: bool
    ) -> list[NDArray[np.float64]]:
        """Take in n samples at once, all or none; the observed registers at each."""


class EpisodeMachine(Machine, Protocol):
    """Bounds the robustness of an episode, as `rtamt.machines.episode.machine` defines it."""

    @property
    def robustness(self) -> float:
        """Robustness if the episode ended now."""

    @property
    def lower(self) -> float:
        """The least over all continuations."""

    @property
    def upper(self) -> float:
        """The greatest over all continuations."""

    def bounds(self) -> tuple[float, float]:
        """Both bounds in one call."""

    @property
    def finished(self) -> bool:
        """Whether the trace has ended."""

    def finish(self) -> float:
        """End the trace."""


class DenseMachine(Stateful, Protocol):
    """Runs a program on events; `rtamt.machines.dense.machine.Machine` says what it means."""

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
        """Take in new events; the steps of the result that are settled by them."""

    def finish(self) -> list[tuple[float, float]]:
        """End the trace; the steps that are left."""

    def run(self, columns: Sequence[Column]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times and values of the result over the whole trace of a new machine."""

    def reset(self) -> None:
        """Forget every event."""


class LaneMachine(Stateful, Protocol):
    """Runs many signals in lockstep; `rtamt.machines.bank.Bank` says what each call means."""

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples taken in by every lane since its reset."""

    def update(self, values: ArrayLike, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """Take in a sample in every lane that the mask chooses; the result of every lane."""

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget every sample of the lanes that the mask chooses."""


DiscreteBank = LaneMachine


class EpisodeBank(LaneMachine, Protocol):
    """Bounds of an episode in every lane."""

    @property
    def robustness(self) -> NDArray[np.float64]:
        """Robustness if the episodes ended now."""

    @property
    def lower(self) -> NDArray[np.float64]:
        """The least over all continuations."""

    @property
    def upper(self) -> NDArray[np.float64]:
        """The greatest over all continuations."""

    @property
    def verdict(self) -> NDArray[np.int8]:
        """1 where lower is above 0, -1 where upper is below, else 0."""

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Whether the traces have ended."""

    def finish(self, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """End the traces of the lanes that the mask chooses; the robustness of every lane."""


def choose(backend: Backend) -> Literal["native", "python"]:
    """The back-end that is meant.

    Raises:
        InputError: If it is unknown, or native and not built.
    """
    if backend == "auto":
        return BACKEND
    if backend not in ("native", "python"):
        msg = f"expected backend='auto', 'native' or 'python', got {backend!r}"
        raise InputError(msg)
    if backend == "native" != BACKEND:
        msg = "backend='native' was not built; reinstall rtamt where a C++20 compiler is found"
        raise InputError(msg)
    return backend


def discrete_machine(
    backend: Backend, program: Program, reader: SampleReader, observed: Sequence[int]
) -> DiscreteMachine:
    """The machine on samples of a back-end.

    Args:
        backend: Which one.
        program: What to run; every register has a latency.
        reader: Turns arguments into samples, and refuses them.
        observed: Registers whose values ``run`` returns.
    """
    if choose(backend) == "python":
        return discrete.Machine(program, reader, observed)
    return _native.DiscreteMachine(
        encoded(program),
        program.terms,
        program.variables,
        program.result,
        [(register, program.latencies[register] or 0) for register in (program.result, *observed)],
        reader,
    )


def episode_machine(backend: Backend, program: Program, reader: SampleReader) -> EpisodeMachine:
    """The machine of a back-end for the bounds of an episode."""
    if choose(backend) == "python":
        return episode.EpisodeMachine(program, reader)
    placement = place(program)
    return _native.EpisodeMachine(
        placement.encoded_terms,
        placement.encoded_formulas,
        placement.tops,
        placement.streams,
        placement.program.variables,
        reader,
    )


def dense_machine(
    backend: Backend, program: DenseProgram, reader: EventReader, observed: Sequence[int]
) -> DenseMachine:
    """The machine over dense time of a back-end.

    Args:
        backend: Which one.
        program: What to run; online, every register has a latency.
        reader: Turns arguments into events, and refuses them.
        observed: Registers that ``values`` lists.
    """
    if choose(backend) == "python":
        return dense.Machine(program, reader, observed)
    return _native.DenseMachine(
        encoded_dense(program),
        program.program.terms,
        program.program.variables,
        program.program.result,
        observed,
        reader,
    )


def discrete_bank(backend: Backend, program: Program, num: int, reader: LaneReader) -> DiscreteBank:
    """The machines on samples of a back-end, in lockstep."""
    if choose(backend) == "python":
        machines = [discrete.Machine(program, reader.lane(i), ()) for i in range(num)]
        return bank.Bank(machines, reader)
    return _native.DiscreteBank(
        encoded(program),
        program.terms,
        program.variables,
        program.result,
        program.latency or 0,
        num,
        reader,
    )


def episode_bank(backend: Backend, program: Program, num: int, reader: LaneReader) -> EpisodeBank:
    """The machines of a back-end for the bounds of episodes, in lockstep."""
    if choose(backend) == "python":
        machines = [episode.EpisodeMachine(program, reader.lane(i)) for i in range(num)]
        return bank.EpisodeBank(machines, reader)
    placement = place(program)
    return _native.EpisodeBank(
        placement.encoded_terms,
        placement.encoded_formulas,
        placement.tops,
        placement.streams,
        placement.program.variables,
        num,
        reader,
    )
