r"""The interface of each machine in both back-ends.

Each machine exists at least twice: in C++, in `rtamt._native`, under the name of its protocol, and
in Python, with ``Python`` in front (`PythonDiscreteMachine`). The Python machine is the definition:
if the two differ, the C++ machine is wrong.

===================  ========================================================================
`DiscreteMachine`    runs a program on samples: `rtamt.machines.discrete`
`EpisodeMachine`     bounds the robustness of an episode: `rtamt.machines.episode.machine`
`DenseMachine`       runs a program on events over dense time: `rtamt.machines.dense.machine`
`DenseSigns`         where a formula fails on a trace in dense time: `rtamt.machines.dense.episode`
`MachineBatch`       a batch of discrete machines: `rtamt.machines.batch`
`EpisodeBatch`       a batch of episode machines: `rtamt.machines.batch`
`ClockBatch`         a batch of clocks of temporal operators: `rtamt.machines.clocks`
===================  ========================================================================

To add a machine, such as one for another time domain: a protocol here, a Python class that matches
every kind of instruction and names its changing fields in ``STATE``, and a field of `Factories` in
`rtamt.machines.backend`.

To add an end mode, such as ``end="cut"``: add its name to `End`, and its worlds to `World`. mypy
then lists each ``match`` with ``assert_never`` that must read them. Also give it a meaning in

- ``walk``, ``episode/machine``, ``episode/streams`` and ``dense/regions`` of `rtamt.machines`:
  ``git grep -nE "\.cut|\.opened|== .cut"`` finds these conditions, which mypy cannot;
- ``rtamt/native``: ``core/order.hpp`` and ``python/encoding.cpp``; the compiler then warns of each
  ``switch`` that must read it. Worlds are in ``episode/polynomials.hpp`` and ``dense/regions.hpp``;
  ``git grep -nE "is_cut|kCut|End::cut|cut_lower"`` finds the other conditions, and ``git grep -nE
  "0 to 4|1 to 5 worlds"`` the errors with the number of worlds;
- `rtamt.monitors`: ``traces``, ``judgement``, ``judgements``, ``many``, ``explainer`` and
  ``evidence``, and ``TraceSpan`` in `rtamt.program.implications`;
- `rtamt.checking.encoding`, where it reads ``cut``;
- `rtamt_arrays`: ``monitor_set``, and for values of its own ``update_and_cut`` of ``episode`` and
  ``torch/monitors``, and ``_merge_cut`` of ``continuations``;
- `rtamt_gym`: ``commands/judging``, ``commands/group_judging``, ``recorded/judge`` and
  ``reports/episodes``.

Describe it in ``docs/ends.md``, in ``finish`` of the monitors, in `rtamt.judge`, and in the options
``end``, ``at_termination`` and ``at_truncation`` of `rtamt_gym.options.evaluation`, which commands,
wrappers and nodes take their choices from. ``tests/support`` defines every end mode again:
``end_oracle.py`` over samples, ``region_oracle.py`` in dense time, and ``asked_oracle.py`` for
triggers. ``git grep -nE "complete.*(cut.*open|open.*cut)|(cut|open).*complete"`` finds the tests,
errors and pages that list all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from types import MemberDescriptorType
from typing import Any, Final, Literal, NamedTuple, Protocol, assert_never

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.between import UncertainValue
from rtamt.inputs.events import GivenLike
from rtamt.program.implications import Counted, InstantRuns
from rtamt.program.instructions import Window

End = Literal["complete", "cut", "open"]
"""How a trace ends: complete, cut at an arbitrary time, or open to go on."""


class World(IntEnum):
    """The time after the last sample: the end of the trace, and the value of unseen predicates.

    ========================  ==================================================================
    ``NOW``                   nothing: windows are cut to the trace
    ``LOWER``, ``UPPER``      an open trace: unseen samples exist, except for windows that skip
                              them (`Window.skips`)
    ``CUT_LOWER/CUT_UPPER``   a cut trace: unseen samples exist for windows with an end; others
                              read the recorded samples, and an operator without a recorded
                              sample has its values of ``LOWER`` and ``UPPER``
    ========================  ==================================================================
    """

    NOW = 0
    LOWER = 1
    UPPER = 2
    CUT_LOWER = 3
    CUT_UPPER = 4

    @property
    def best(self) -> bool:
        """True if every unseen predicate is +inf."""
        return self in (World.UPPER, World.CUT_UPPER)

    @property
    def unseen(self) -> float:
        """The value of every unseen predicate; nothing reads it in ``NOW``."""
        return math.inf if self.best else -math.inf

    @property
    def cut(self) -> bool:
        """True if the trace was cut."""
        return self in (World.CUT_LOWER, World.CUT_UPPER)

    @property
    def opened(self) -> World:
        """The world with the values of an operator of which nothing was recorded."""
        if not self.cut:
            return self
        return World.UPPER if self.best else World.LOWER

    def ends(self, window: Window) -> bool:
        """Return whether a window reads only recorded samples, and the sample of its own time."""
        match self:
            case World.NOW:
                return True
            case World.LOWER | World.UPPER:
                return window.skips(best=self.best)
            case World.CUT_LOWER | World.CUT_UPPER:
                return window.hi is None
            case _ as never:
                assert_never(never)


OPEN_WORLDS: Final = (World.NOW, World.LOWER, World.UPPER)
"""The worlds whose values a machine shows after each sample."""


def worlds_of(end: End) -> tuple[World, World]:
    """Return the worlds of the lower and of the upper bound at an end of the trace."""
    match end:
        case "complete":
            return World.NOW, World.NOW
        case "cut":
            return World.CUT_LOWER, World.CUT_UPPER
        case "open":
            return World.LOWER, World.UPPER
        case _ as never:
            assert_never(never)


MachineState = Any
"""State of a machine; only machines of the same program and back-end can read it."""


class Stateful(Protocol):
    """A machine with a state that can be copied to another machine of the same program."""

    def state(self) -> MachineState:
        """Return a copy of the state, which ``restore`` takes."""

    def restore(self, state: MachineState) -> None:
        """Continue from where ``state`` was taken."""


class SampleMachine(Stateful, Protocol):
    """A machine on samples.

    Attributes:
        samples: Number of samples since the reset.
        inputs: The last sample, empty before the first.
        update: Takes one sample, in any of the argument forms; returns the robustness.
        retire: Refuses each further update, because the monitor has another machine.
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
        """Take n samples at once, all or none."""

    def evaluate(
        self, columns: Sequence[Floats], n: int, *, backwards: bool = False
    ) -> list[Floats]:
        """Return the observed registers at the times of a whole trace; the state plays no part."""


class BoundingMachine(Stateful, Protocol):
    """Evaluates a program at the start of a trace, with bounds; its future may have no end.

    Attributes:
        robustness: The robustness if the trace ended now.
        lower: The smallest robustness over all continuations and ends.
        upper: The largest robustness over all continuations and ends.
        finished: Whether the trace has ended.
        update: Takes a sample or new events; returns the robustness.
    """

    @property
    def robustness(self) -> float: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def finished(self) -> bool: ...
    @property
    def update(self) -> Callable[..., float]: ...
    def finish(self, end: End = "complete") -> float:
        """End the trace, set the bounds for its end mode, and return the robustness.

        A cut trace may have its robustness outside the bounds; it moves to the nearest one.
        """

    def reset(self) -> None: ...


class EpisodeMachine(SampleMachine, BoundingMachine, Protocol):
    """Bounds the robustness of an episode of samples."""

    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        """Update slots of a monitor while it lives, as in `rtamt.machines.state`."""


class EpisodeRun(NamedTuple):
    """The result of an episode machine for a whole trace.

    ``complete`` is the robustness of the complete trace; ``robustness`` is inside the bounds.
    ``decided_at`` is the first sample after which the verdict was decided; None if never.
    """

    robustness: float
    complete: float
    lower: float
    upper: float
    decided_at: int | None


class TraceSet(NamedTuple):
    """Traces of unequal length in shared columns.

    Attributes:
        columns: The contiguous values of every variable, of all traces.
        begins: The place of the first sample of each trace, as int64.
        lengths: The number of samples of each trace, as int64.
    """

    columns: Sequence[NDArray[np.float64]]
    begins: NDArray[np.int64]
    lengths: NDArray[np.int64]

    def select(self, traces: NDArray[np.intp]) -> TraceSet:
        """Return some of the traces, in the same columns."""
        return TraceSet(self.columns, self.begins[traces], self.lengths[traces])


class EpisodeRuns(NamedTuple):
    """`EpisodeRun` for many traces, with -1 for never.

    The machine refuses a trace with a nan or a term that is one; then the other numbers have no
    meaning.
    """

    robustness: NDArray[np.float64]
    complete: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    decided_at: NDArray[np.int64]
    refused: NDArray[np.bool_]


class SampleRuns(NamedTuple):
    """Runs of samples for several classes of traces, all as int64.

    Class c has the runs ``ends[c]`` to ``ends[c + 1] - 1``; ``class_of`` has each trace's class.
    """

    ends: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    class_of: NDArray[np.int64]


class DenseMachine(Stateful, Protocol):
    """Runs a program on events, each variable at its own pace.

    Attributes:
        settled: The time before which the result is known; -inf until every variable has an event.
        finished: Whether the trace has ended.
        values: The last known values of the observed registers; after `finish`, those at the end.
        update: Takes new events; returns the breakpoints of the result that they settle.
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
        """End the trace at the end of the first variable; return the remaining breakpoints."""

    def run(self, given: Sequence[GivenLike]) -> tuple[Floats, Floats]:
        """Return times and values of the result over the whole trace of a new machine."""

    def reset(self) -> None: ...


class DenseEpisodeMachine(BoundingMachine, Protocol):
    """Bounds the robustness at the start of a trace, from events.

    ``settled`` is the last time at which all variables are known, or -inf, and ``span`` the first
    and the last tick of the trace. The bounds have one sign bit after ``decided_at``.
    """

    @property
    def settled(self) -> float: ...
    @property
    def span(self) -> tuple[int, int]: ...
    @property
    def decided_at(self) -> float | None: ...
    def run(self, given: Sequence[GivenLike], *, decided: bool = False) -> None:
        """Read a whole trace, with times as the caller passed them."""

    def complete(self) -> tuple[float, float]:
        """Return the bounds of the complete trace.

        They are equal unless neutral predicates or unknown values matter.
        """


class DenseSigns(Protocol):
    """The instants of a whole trace in dense time at which a formula fails or holds for certain."""

    def fails_at(self, instants: InstantRuns) -> Counted:
        """Return how often it fails at recorded positions among some."""

    def holds_at(self, instants: InstantRuns) -> bool:
        """Return whether it holds at all of some positions, one or more."""


class MachineBatch(Stateful, Protocol):
    """A batch of machines of one program; each entry has its own time."""

    @property
    def samples(self) -> NDArray[np.int64]:
        """The number of samples of every entry since its reset."""

    @property
    def inputs(self) -> Floats:
        """The last sample of every entry, with the smallest of uncertain values."""

    @property
    def update(self) -> Callable[..., Floats]:
        """Takes a sample in every entry of a mask; returns every entry's result.

        Its arguments are values, mask and, for bounds, upper values: then a sample lies between the
        two. Instead of values it takes columns by name.
        """

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget every sample of the entries in the mask."""


class ClockBatch(Protocol):
    """Clocks of temporal operators over the same parts, in batch entries with their own time.

    Attributes:
        samples: The number of samples of every entry since its reset.
        fractions: A row for each clock: from 0 to 1 in every entry.
        margins: A row for each operand of each clock: its newest known value, 0 before it.
    """

    @property
    def samples(self) -> NDArray[np.int64]: ...
    @property
    def fractions(self) -> Floats: ...
    @property
    def margins(self) -> Floats: ...
    def feed(self, values: Floats, mask: NDArray[np.bool_] | None = None) -> None:
        """Take a sample in the entries of the mask: a contiguous row of each part."""

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None: ...
    def state(self) -> MachineState: ...
    def restore(self, state: MachineState) -> None: ...


class EpisodeBatch(MachineBatch, Protocol):
    """A batch of episode machines, with the attributes of `EpisodeMachine` for every entry.

    Attributes:
        verdict: 1 if the sign bit of lower is clear, -1 if the sign bit of upper is set, or 0.
        unknown: Which values of the last samples are uncertain: a row per entry, a column per
            variable.
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
        """End the traces of the entries in the mask; return every entry's robustness."""
