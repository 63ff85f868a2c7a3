"""What a machine offers, whichever back-end it comes from.

Each machine exists at least twice: in C++, in `rtamt._native`, by the name that its protocol has
here, and in Python, with ``Python`` in front (`PythonDiscreteMachine`). The Python machine is the
definition: where the two differ, the C++ machine is wrong.

===================  ========================================================================
`DiscreteMachine`    runs a program on samples: `rtamt.machines.discrete`
`EpisodeMachine`     bounds the robustness of an episode: `rtamt.machines.episode.machine`
`DenseMachine`       runs a program on events over dense time: `rtamt.machines.dense.machine`
`DenseSigns`         where a formula fails on a trace in dense time: `rtamt.machines.dense.outlook`
`DiscreteBank`       many discrete machines in lockstep: `rtamt.machines.bank`
`EpisodeBank`        many episode machines in lockstep: `rtamt.machines.bank`
`ClockBank`          clocks of temporal operators in lockstep: `rtamt.machines.clocks`
===================  ========================================================================

To add a machine, such as one for another time domain: a protocol here, a Python class that matches
every kind of instruction and names its changing fields in ``STATE``, and a field of `Factories` in
`rtamt.machines.backend`.

To add an end mode, such as ``end="cut"``: add its name to `End`, and decide in
`rtamt.program.instructions.Window` how windows read unseen samples. Then follow an existing name
through `rtamt.machines` (``bounds``, ``walk``, ``episode`` and ``dense``), ``rtamt/native``
(``core/end.hpp`` and ``python/encoding.cpp`` first) and the options of `rtamt_gym`.
``tests/support/end_oracle.py`` defines every end mode again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import MemberDescriptorType
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.between import UncertainValue
from rtamt.inputs.events import GivenLike
from rtamt.program.implications import Counted, InstantRuns

Floats = NDArray[np.float64]
End = Literal["complete", "cut", "open"]
"""How a trace ends: with nothing after it, at a time that no one chose, or as a mere beginning."""
MachineState = Any
"""State of a machine; only a machine of the same program and back-end knows what is in it."""


class Stateful(Protocol):
    """A machine whose state can be taken, and given to another one of the same program."""

    def state(self) -> MachineState:
        """Return a copy of the state, which ``restore`` takes."""

    def restore(self, state: MachineState) -> None:
        """Continue from where ``state`` was taken."""


class SampleMachine(Stateful, Protocol):
    """A machine that takes in samples.

    Attributes:
        samples: Samples taken in since the reset.
        inputs: The last sample, empty before the first.
        update: Takes in one sample, in any of the argument forms; returns the robustness.
        retire: Refuses each further update, as the monitor has another machine.
    """

    @property
    def samples(self) -> int: ...
    @property
    def inputs(self) -> Sequence[float | UncertainValue]: ...
    @property
    def update(self) -> Callable[..., float]: ...
    def retire(self) -> None: ...
    def reset(self) -> None: ...


class DiscreteMachine(SampleMachine, Protocol):
    """Runs a program whose every register has a latency."""

    @property
    def inputs(self) -> Sequence[float]: ...
    @property
    def registers(self) -> Sequence[float]: ...
    def run(self, columns: Sequence[Floats], n: int) -> list[Floats]:
        """Take in n samples at once, all or none."""

    def evaluate(
        self, columns: Sequence[Floats], n: int, *, backwards: bool = False
    ) -> list[Floats]:
        """Return the observed registers at the times of a whole trace; the state plays no part."""


class EpisodeMachine(SampleMachine, Protocol):
    """Evaluates a program at time 0 of an episode, with bounds; its future may have no end.

    Attributes:
        robustness: The robustness if the episode ended now.
        lower: The smallest robustness over all continuations and ends.
        upper: The largest robustness over all continuations and ends.
        finished: Whether the trace has ended.
    """

    @property
    def robustness(self) -> float: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def finished(self) -> bool: ...
    def finish(self, end: End = "complete") -> float:
        """End the trace, set the bounds as this reading says, and return the robustness.

        The robustness is moved to the nearest bound if it is outside, which it can be if the trace
        was cut.
        """

    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        """Keep slots of a monitor up to date while it lives, as `rtamt.machines.readout` says."""


class EpisodeRun(NamedTuple):
    """What an episode machine says of a whole trace.

    Attributes:
        robustness: The robustness, inside the bounds.
        complete: The robustness if the trace is all there is.
        lower: The smallest robustness that the reading of the end leaves possible.
        upper: The largest.
        decided_at: The first sample after which the verdict was decided; None: there is no such.
    """

    robustness: float
    complete: float
    lower: float
    upper: float
    decided_at: int | None


class DenseMachine(Stateful, Protocol):
    """Runs a program on events, each variable at its own pace.

    Attributes:
        settled: The time before which the result is known; -inf until every variable has an event.
        finished: Whether the trace has ended.
        values: The last known values of the observed registers; after `finish`, those at the end.
        update: Takes in new events; returns the breakpoints of the result that they settle.
    """

    @property
    def settled(self) -> float: ...
    @property
    def finished(self) -> bool: ...
    @property
    def values(self) -> Sequence[float]: ...
    @property
    def update(self) -> Callable[..., list[tuple[float, float]]]: ...
    def finish(self) -> list[tuple[float, float]]:
        """End the trace where the first variable ends; return the breakpoints that are left."""

    def run(self, given: Sequence[GivenLike]) -> tuple[Floats, Floats]:
        """Times and values of the result over the whole trace of a new machine."""

    def reset(self) -> None: ...


class DenseEpisodeMachine(Stateful, Protocol):
    """Bounds the robustness at the start of a trace from events; its future may have no end.

    Attributes:
        robustness: The robustness if the trace ended at the last time at which all is known.
        lower: The smallest robustness over all continuations and ends.
        upper: The largest robustness over all continuations and ends.
        settled: The last time at which all variables are known; -inf before there is one.
        span: The first and the last tick of the trace, which has begun.
        decided_at: The first time after which the bounds have one sign bit; None: no such.
        finished: Whether the trace has ended.
        update: Takes in new events; returns the robustness.
    """

    @property
    def robustness(self) -> float: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def settled(self) -> float: ...
    @property
    def span(self) -> tuple[int, int]: ...
    @property
    def decided_at(self) -> float | None: ...
    @property
    def finished(self) -> bool: ...
    @property
    def update(self) -> Callable[..., float]: ...
    def finish(self, end: End = "complete") -> float:
        """End the trace, set the bounds as this reading says, and return the robustness."""

    def run(self, given: Sequence[GivenLike], *, decided: bool = False) -> None:
        """Take in a whole trace, with times as they were given."""

    def complete(self) -> tuple[float, float]:
        """Return the bounds if the trace is all there is.

        They are the same unless they hang on neutral predicates, or on what is not known.
        """

    def reset(self) -> None: ...


class DenseSigns(Protocol):
    """Where a formula fails or holds for certain on a whole trace in dense time."""

    def fails_at(self, instants: InstantRuns) -> Counted:
        """How often it fails at recorded ones of some positions."""

    def holds_at(self, instants: InstantRuns) -> bool:
        """Return whether it holds at all of some positions, which have one or more."""


class Bank(Stateful, Protocol):
    """Machines of one program in lockstep, each in a lane with a time of its own."""

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples taken in by every lane since its reset."""

    @property
    def inputs(self) -> Floats:
        """The last sample of every lane, the smallest values where they are not known."""

    @property
    def update(self) -> Callable[..., Floats]:
        """Takes in a sample in every lane of a mask; returns every lane's result.

        Its arguments are values, mask and, if it gives bounds, upper values: then a sample lies
        between the two. Instead of values it takes columns by name.
        """

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget every sample of the lanes that the mask chooses."""


class ClockBank(Protocol):
    """Clocks of temporal operators over the same parts, in lanes that have a time of their own.

    Attributes:
        samples: The number of samples of every lane since its reset.
        fractions: A row for each clock: from 0 to 1 in every lane.
        margins: A row for each operand of each clock: its newest known value, 0 before it.
    """

    @property
    def samples(self) -> NDArray[np.int64]: ...
    @property
    def fractions(self) -> Floats: ...
    @property
    def margins(self) -> Floats: ...
    def feed(self, values: Floats, mask: NDArray[np.bool_] | None = None) -> None:
        """Take in a sample in the lanes of the mask: a contiguous row of each part."""

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None: ...
    def state(self) -> MachineState: ...
    def restore(self, state: MachineState) -> None: ...


class DiscreteBank(Bank, Protocol):
    """Discrete machines in lockstep."""


class EpisodeBank(Bank, Protocol):
    """Episode machines in lockstep, with the attributes of `EpisodeMachine` for every lane.

    Attributes:
        verdict: 1 where the sign bit of lower is clear, -1 where upper's is set, else 0.
        unknown: Which values of the last samples are not known: a row for each lane, a column for
            each variable.
    """

    @property
    def robustness(self) -> Floats: ...
    @property
    def lower(self) -> Floats: ...
    @property
    def upper(self) -> Floats: ...
    @property
    def verdict(self) -> NDArray[np.int8]: ...
    @property
    def unknown(self) -> NDArray[np.bool_]: ...
    @property
    def finished(self) -> NDArray[np.bool_]: ...
    def finish(self, mask: ArrayLike | None = None, end: End = "complete") -> Floats:
        """End the traces of the lanes that the mask chooses; return every lane's robustness."""
