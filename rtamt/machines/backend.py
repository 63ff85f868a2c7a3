"""The table of back-ends, and the choice of one: C++ if it was built; otherwise, Python.

To add a back-end, write a module next to `rtamt.machines.native`, and add its name to `BackendName`
and its factories to `BACKENDS`. `rtamt.program.encoding` encodes programs for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MemberDescriptorType
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, alternatives, brief, is_one_of
from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import BatchReader
from rtamt.inputs.clock import Clock
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given
from rtamt.inputs.samples import SampleReader
from rtamt.machines import state
from rtamt.machines.batch import (
    PYTHON_VERDICT_LOGS,
    PythonDiscreteBatch,
    PythonEpisodeBatch,
    VerdictLogFunctions,
)
from rtamt.machines.clocks import OperatorClock, PythonClockBatch
from rtamt.machines.dense.episode import PythonDenseEpisodeMachine, PythonDenseSigns, dense_values
from rtamt.machines.dense.machine import PythonDenseMachine
from rtamt.machines.dense.runs import Runs
from rtamt.machines.discrete import PythonDiscreteMachine
from rtamt.machines.episode.machine import PythonEpisodeVariants
from rtamt.machines.protocols import (
    ClockBatch,
    DenseEpisodeMachine,
    DenseMachine,
    DenseSigns,
    DiscreteMachine,
    End,
    EpisodeBatch,
    EpisodeMachine,
    EpisodeRun,
    EpisodeRuns,
    MachineBatch,
    SampleRuns,
    TraceSet,
)
from rtamt.machines.segments import FindRuns
from rtamt.machines.terms import FindRanges, term_ranges
from rtamt.machines.walk import FoldPairs
from rtamt.program.dense_lowering import DenseProgram, RegionProgram
from rtamt.program.program import Program

BackendName = Literal["native", "python"]
Backend = Literal["auto", BackendName]


class TraceFunctions(NamedTuple):
    """The functions of a back-end on many traces; `rtamt.machines.native` describes them."""

    judge: Callable[[Program, TraceSet, End, int], EpisodeRuns]
    count_failures: Callable[
        [Program, TraceSet, SampleRuns, int],
        tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    ]


@dataclass(frozen=True, slots=True)
class Factories:
    """The functions that make the machines of a back-end, with arguments as in their types.

    A reader turns arguments into samples or events, or refuses them. ``run`` and ``values`` return
    the values of the observed registers. A function is None if its other functions or NumPy are
    fast enough. ``episode_monitor_set`` also returns None for machines of other back-ends, and
    ``episode_run`` where columns are always faster.
    """

    discrete_machine: Callable[[Program, SampleReader, Sequence[int]], DiscreteMachine]
    episode_machine: Callable[[Program, SampleReader], EpisodeMachine]
    dense_machine: Callable[[DenseProgram, EventReader, Sequence[int]], DenseMachine]
    dense_episode_machine: Callable[[RegionProgram, EventReader], DenseEpisodeMachine]
    dense_signs: Callable[
        [RegionProgram, EventReader, Sequence[Given], tuple[int, int], End], DenseSigns
    ]
    dense_values: Callable[
        [RegionProgram, EventReader, Sequence[Given], tuple[int, int], End, bool],
        tuple[Runs, Runs, Runs],
    ]
    discrete_batch: Callable[[Program, int, BatchReader], MachineBatch]
    episode_batch: Callable[[Program, int, BatchReader], EpisodeBatch]
    clock_batch: Callable[[Sequence[OperatorClock], int, int], ClockBatch]
    clock: Callable[[DenseProgram], Clock]
    term_ranges: FindRanges
    episode_monitor_set: Callable[..., Any] | None = None
    episode_run: Callable[[Program, Sequence[Floats], int, End], EpisodeRun | None] | None = None
    fold_pairs: FoldPairs | None = None
    find_runs: FindRuns | None = None
    trace_runs: TraceFunctions | None = None


BACKENDS: Final[dict[BackendName, Factories]] = {
    "python": Factories(
        PythonDiscreteMachine,
        PythonEpisodeVariants,
        PythonDenseMachine,
        PythonDenseEpisodeMachine,
        PythonDenseSigns,
        dense_values,
        PythonDiscreteBatch,
        PythonEpisodeBatch,
        PythonClockBatch,
        Clock,
        term_ranges,
    )
}
"""The back-ends that are built, by name."""

read_only: Callable[[MemberDescriptorType], object] = state.read_only
"""Returns a read-only descriptor of a slot of a class; the fastest one."""

_own_logs: VerdictLogFunctions | None = None
_are_own: Callable[[Sequence[EpisodeBatch]], bool] | None = None

try:
    from rtamt.machines import native
except ModuleNotFoundError as absent:  # a module that is there but does not load is a broken build
    if absent.name != "rtamt._native":
        raise
else:
    BACKENDS["native"] = Factories(
        native.discrete_machine,
        native.episode_machine,
        native.dense_machine,
        native.dense_episode_machine,
        native.dense_signs,
        native.dense_values,
        native.discrete_batch,
        native.episode_batch,
        native.clock_batch,
        native.NativeClock,
        native.term_ranges,
        native.episode_monitor_set,
        native.episode_run,
        native.fold_pairs,
        native.find_runs,
        TraceFunctions(native.judge_traces, native.count_failures),
    )
    read_only = native.read_only
    _own_logs, _are_own = native.VERDICT_LOGS, native.are_own

BACKEND: Final[BackendName] = "native" if "native" in BACKENDS else "python"
"""``"native"`` if the C++ machines are built; otherwise, ``"python"``."""


def choose(backend: Backend) -> BackendName:
    """Return the name of the back-end for an argument, a key of `BACKENDS`."""
    known = get_args(Backend)
    if not is_one_of(backend, known):
        msg = f"expected backend={alternatives(known)}, got {brief(backend)}"
        raise InputError(msg)
    if backend == "auto":
        return BACKEND
    if backend not in BACKENDS:
        msg = f"backend={backend!r} was not built; reinstall rtamt where a C++20 compiler is found"
        raise InputError(msg)
    return backend


def logs_of(batches: Sequence[EpisodeBatch]) -> VerdictLogFunctions:
    """Return the fastest functions that read these batches."""
    if _own_logs is not None and _are_own is not None and _are_own(batches):
        return _own_logs
    return PYTHON_VERDICT_LOGS
