# The machines in C++; rtamt.machines.protocols says what their methods do.

from collections.abc import Callable, Mapping, Sequence
from types import MemberDescriptorType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.batch import BatchReader
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import EventsLike, GivenLike
from rtamt.inputs.samples import SampleReader
from rtamt.machines import batch, protocols
from rtamt.machines.clocks import OperatorClock
from rtamt.machines.protocols import End
from rtamt.machines.terms import RefusesRanges

FUNCTIONS: dict[str, int]  # names and arities of the functions of MAP
FOLDS: dict[str, int]  # names of the lattice folds of WINDOW, and the numbers in an element
KINDS: tuple[str, ...]  # names of the kinds of instructions

def read_only(slot: MemberDescriptorType) -> object: ...
def ticks(
    clock: tuple[float, int, int], times: NDArray[np.float64]
) -> NDArray[np.int64] | None: ...
def term_ranges(
    rows: Sequence[tuple[object, ...]],
    variables: int,
    observed: Sequence[int],
    reader: RefusesRanges,
    lower: Sequence[ArrayLike],
    upper: Sequence[ArrayLike],
    n: int,
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]: ...
def fold_pairs(
    p: NDArray[np.int64],
    q: NDArray[np.int64],
    before: int,
    is_max: bool,
    backwards: bool,
) -> NDArray[np.int64]: ...
def negative_runs(
    signs: NDArray[np.int64], values: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]: ...
def judge_traces(
    terms: Sequence[tuple[object, ...]],
    formulas: Sequence[tuple[object, ...]],
    initial: Sequence[int],
    streams: Sequence[int],
    variables: int,
    columns: Sequence[NDArray[np.float64]],
    begins: NDArray[np.int64],
    lengths: NDArray[np.int64],
    end: End,
    threads: int,
) -> tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.int64],
    NDArray[np.bool_],
]: ...
def count_failures(
    rows: Sequence[tuple[object, ...]],
    terms: int,
    variables: int,
    result: int,
    columns: Sequence[NDArray[np.float64]],
    begins: NDArray[np.int64],
    lengths: NDArray[np.int64],
    class_of: NDArray[np.int64],
    ends: NDArray[np.int64],
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    threads: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]: ...
def feed_batches(
    batches: Sequence[protocols.EpisodeBatch],
    columns: Sequence[tuple[int, ...]],
    table: NDArray[np.float64],
    mask: NDArray[np.bool_] | None,
) -> int: ...
def least_of_batches(
    batches: Sequence[protocols.EpisodeBatch], name: str, failed: NDArray[np.bool_] | None
) -> NDArray[np.float64]: ...
def finish_batches(
    batches: Sequence[protocols.EpisodeBatch], mask: NDArray[np.bool_] | None, end: End
) -> bool: ...
def note_verdicts(
    batches: Sequence[protocols.EpisodeBatch],
    mask: NDArray[np.bool_] | None,
    settled_at: NDArray[np.int64],
    violated: NDArray[np.bool_],
    failed: NDArray[np.bool_],
    first: NDArray[np.int64],
    violated_at: NDArray[np.int64],
) -> None: ...
def forget_verdicts(
    mask: NDArray[np.bool_] | None,
    specs: int,
    num: int,
    settled_at: NDArray[np.int64],
    violated: NDArray[np.bool_],
    failed: NDArray[np.bool_],
    first: NDArray[np.int64],
    violated_at: NDArray[np.int64],
) -> None: ...
def outcomes_of_batches(
    batches: Sequence[protocols.EpisodeBatch],
    entries: NDArray[np.int64],
    failed: NDArray[np.bool_],
    settled_at: NDArray[np.int64],
) -> tuple[
    NDArray[np.float64],
    NDArray[np.int8],
    NDArray[np.int64],
    NDArray[np.bool_],
    NDArray[np.bool_],
    NDArray[np.bool_],
    NDArray[np.bool_],
    NDArray[np.bool_],
]: ...
def spread_entries(
    columns: list[batch.EntryColumn], entries: NDArray[np.int64], num: int
) -> int: ...
def reset_batches(
    batches: Sequence[protocols.EpisodeBatch], mask: NDArray[np.bool_] | None
) -> None: ...

class DiscreteMachine:
    def __init__(
        self,
        rows: Sequence[tuple[object, ...]],
        terms: int,
        variables: tuple[str, ...],
        result: int,
        observed: Sequence[tuple[int, int]],
        reader: SampleReader,
    ) -> None: ...
    @property
    def samples(self) -> int: ...
    @property
    def registers(self) -> list[float]: ...
    @property
    def inputs(self) -> list[float]: ...
    def update(self, *args: object, **named: object) -> float: ...
    def run(self, columns: Sequence[ArrayLike], n: int) -> list[NDArray[np.float64]]: ...
    def evaluate(
        self, columns: Sequence[ArrayLike], n: int, *, backwards: bool = False
    ) -> list[NDArray[np.float64]]: ...
    def retire(self) -> None: ...
    def reset(self) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class EpisodeMachine:
    def __init__(
        self,
        terms: Sequence[tuple[object, ...]],
        formulas: Sequence[tuple[object, ...]],
        initial: Sequence[int],
        streams: Sequence[int],
        variables: tuple[str, ...],
        reader: SampleReader,
        neutral: Sequence[int] = (),
    ) -> None: ...
    @property
    def samples(self) -> int: ...
    @property
    def inputs(self) -> list[float]: ...
    def update(self, *args: object, **named: object) -> float: ...
    @property
    def robustness(self) -> float: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def finished(self) -> bool: ...
    def judge(
        self, columns: Sequence[NDArray[np.float64]], n: int, end: End
    ) -> tuple[float, float, float, float, int | None] | None: ...
    def finish(self, end: End = "complete") -> float: ...
    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None: ...
    def retire(self) -> None: ...
    def reset(self) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class EpisodeMonitorSet:
    def __init__(
        self,
        machines: Sequence[EpisodeMachine],
        places: Sequence[Sequence[int]],
        reads: Sequence[object],
        decided: Callable[[int], object] | None,
        seen: Callable[[list[float]], object] | None,
        number: type[float],
    ) -> None: ...
    def feed(self, *args: object) -> tuple[float, float, float]: ...
    def take(self, *args: object) -> None: ...
    def look(self) -> tuple[float, float, float]: ...

class DenseMachine:
    def __init__(
        self,
        rows: Sequence[tuple[object, ...]],
        terms: int,
        variables: tuple[str, ...],
        result: int,
        clock: tuple[float, int, int],
        declared: Sequence[float],
        observed: Sequence[int],
        reader: EventReader,
    ) -> None: ...
    @property
    def settled(self) -> float: ...
    @property
    def finished(self) -> bool: ...
    @property
    def values(self) -> list[float]: ...
    def update(
        self, *events: Mapping[str, EventsLike], **named: EventsLike
    ) -> list[tuple[float, float]]: ...
    def finish(self) -> list[tuple[float, float]]: ...
    def run(
        self, given: Sequence[GivenLike]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def retire(self) -> None: ...
    def reset(self) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class DenseEpisodeMachine:
    def __init__(
        self,
        readings: Sequence[tuple[Sequence[tuple[object, ...]], tuple[object, ...]]],
        variables: tuple[str, ...],
        clock: tuple[float, int, int],
        declared: Sequence[float],
        reach: int,
        reader: EventReader,
    ) -> None: ...
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
    def update(self, *events: Mapping[str, EventsLike], **named: EventsLike) -> float: ...
    def finish(self, end: str = "complete") -> float: ...
    def run(self, given: Sequence[GivenLike], *, decided: bool = False) -> None: ...
    def complete(self) -> tuple[float, float]: ...
    def retire(self) -> None: ...
    def reset(self) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class DenseRegions:
    def __init__(
        self,
        terms: int,
        constants: Sequence[tuple[int, float]],
        rows: Sequence[tuple[object, ...]],
        initial: Sequence[int],
        streams: Sequence[int],
        unknowns: Sequence[int],
    ) -> None: ...
    @property
    def t(self) -> int: ...
    def advance(
        self, positions: NDArray[np.int64], terms: Sequence[NDArray[np.float64]], t: int
    ) -> None: ...
    def look(self, worlds: int) -> tuple[float, ...]: ...
    def reset(self) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class DenseSigns:
    def __init__(
        self,
        terms: Sequence[tuple[object, ...]],
        rows: Sequence[tuple[object, ...]],
        result: int,
        clock: tuple[float, int, int],
        reader: EventReader,
        given: Sequence[GivenLike],
        begin: int,
        last: int,
        end: str,
        numbers: bool = False,
    ) -> None: ...
    def result(self, world: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]: ...
    def fails_at(self, instants: Sequence[tuple[int, float]]) -> tuple[int, int, int | None]: ...
    def holds_at(self, instants: Sequence[tuple[int, float]]) -> bool: ...

class ClockBatch:
    def __init__(self, rows: Sequence[OperatorClock], parts: int, num: int) -> None: ...
    @property
    def samples(self) -> NDArray[np.int64]: ...
    @property
    def fractions(self) -> NDArray[np.float64]: ...
    @property
    def margins(self) -> NDArray[np.float64]: ...
    def feed(self, values: NDArray[np.float64], mask: NDArray[np.bool_] | None = None) -> None: ...
    def reset(self, mask: NDArray[np.bool_] | None = None) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class DiscreteBatch:
    def __init__(
        self,
        rows: Sequence[tuple[object, ...]],
        terms: int,
        variables: tuple[str, ...],
        result: int,
        latency: int,
        num: int,
        reader: BatchReader,
    ) -> None: ...
    @property
    def samples(self) -> NDArray[np.int64]: ...
    @property
    def inputs(self) -> NDArray[np.float64]: ...
    def update(
        self, values: ArrayLike = ..., mask: ArrayLike | None = None, **named: object
    ) -> NDArray[np.float64]: ...
    def reset(self, mask: ArrayLike | None = None) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class EpisodeBatch:
    def __init__(
        self,
        terms: Sequence[tuple[object, ...]],
        formulas: Sequence[tuple[object, ...]],
        initial: Sequence[int],
        streams: Sequence[int],
        variables: tuple[str, ...],
        num: int,
        reader: BatchReader,
        neutral: Sequence[int] = (),
    ) -> None: ...
    @property
    def samples(self) -> NDArray[np.int64]: ...
    @property
    def inputs(self) -> NDArray[np.float64]: ...
    def update(
        self,
        values: ArrayLike = ...,
        mask: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        **named: object,
    ) -> NDArray[np.float64]: ...
    @property
    def robustness(self) -> NDArray[np.float64]: ...
    @property
    def lower(self) -> NDArray[np.float64]: ...
    @property
    def upper(self) -> NDArray[np.float64]: ...
    @property
    def unknown(self) -> NDArray[np.bool_]: ...
    @property
    def verdict(self) -> NDArray[np.int8]: ...
    @property
    def finished(self) -> NDArray[np.bool_]: ...
    def finish(
        self, mask: ArrayLike | None = None, end: End = "complete"
    ) -> NDArray[np.float64]: ...
    def reset(self, mask: ArrayLike | None = None) -> None: ...
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...
