# The machines in C++; rtamt.machines.protocols says what their methods do.

from collections.abc import Callable, Mapping, Sequence
from types import MemberDescriptorType
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import BatchReader, Entries
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

_Rows: TypeAlias = Sequence[tuple[object, ...]]
_Batches: TypeAlias = Sequence[protocols.EpisodeBatch]
_Integers: TypeAlias = NDArray[np.int64]
_Clock: TypeAlias = tuple[float, int, int]

def read_only(slot: MemberDescriptorType) -> object: ...
def ticks(clock: _Clock, times: Floats) -> _Integers | None: ...
def term_ranges(
    rows: _Rows,
    variables: int,
    observed: Sequence[int],
    reader: RefusesRanges,
    lower: Sequence[ArrayLike],
    upper: Sequence[ArrayLike],
    n: int,
) -> tuple[list[Floats], list[Floats]]: ...
def fold_pairs(
    p: _Integers, q: _Integers, before: int, is_max: bool, backwards: bool
) -> _Integers: ...
def negative_runs(
    signs: _Integers, values: _Integers
) -> tuple[_Integers, _Integers, _Integers, _Integers]: ...
def judge_traces(
    terms: _Rows,
    formulas: _Rows,
    initial: Sequence[int],
    streams: Sequence[int],
    variables: int,
    columns: Sequence[Floats],
    begins: _Integers,
    lengths: _Integers,
    end: End,
    threads: int,
) -> tuple[Floats, Floats, Floats, Floats, _Integers, Entries]: ...
def count_failures(
    rows: _Rows,
    terms: int,
    variables: int,
    result: int,
    columns: Sequence[Floats],
    begins: _Integers,
    lengths: _Integers,
    class_of: _Integers,
    ends: _Integers,
    first: _Integers,
    last: _Integers,
    threads: int,
) -> tuple[_Integers, _Integers, _Integers]: ...
def feed_batches(
    batches: _Batches, columns: Sequence[tuple[int, ...]], table: Floats, mask: Entries | None
) -> int: ...
def least_of_batches(batches: _Batches, name: str, failed: Entries | None) -> Floats: ...
def finish_batches(batches: _Batches, mask: Entries | None, end: End) -> bool: ...
def note_verdicts(
    batches: _Batches,
    mask: Entries | None,
    settled_at: _Integers,
    violated: Entries,
    failed: Entries,
    first: _Integers,
    violated_at: _Integers,
) -> None: ...
def forget_verdicts(
    mask: Entries | None,
    specs: int,
    num: int,
    settled_at: _Integers,
    violated: Entries,
    failed: Entries,
    first: _Integers,
    violated_at: _Integers,
) -> None: ...
def outcomes_of_batches(
    batches: _Batches, entries: _Integers, failed: Entries, settled_at: _Integers
) -> tuple[Floats, NDArray[np.int8], _Integers, Entries, Entries, Entries, Entries, Entries]: ...
def spread_entries(columns: list[batch.EntryColumn], entries: _Integers, num: int) -> int: ...
def reset_batches(batches: _Batches, mask: Entries | None) -> None: ...

class _Stateful:
    def state(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class _Machine(_Stateful):
    def retire(self) -> None: ...
    def reset(self) -> None: ...

class _SampleMachine(_Machine):
    @property
    def samples(self) -> int: ...
    @property
    def inputs(self) -> list[float]: ...
    def update(self, *args: object, **named: object) -> float: ...

class _EventMachine(_Machine):
    @property
    def settled(self) -> float: ...
    @property
    def finished(self) -> bool: ...

class _Batch(_Stateful):
    @property
    def samples(self) -> _Integers: ...
    @property
    def inputs(self) -> Floats: ...
    def reset(self, mask: ArrayLike | None = None) -> None: ...

class DiscreteMachine(_SampleMachine):
    def __init__(
        self,
        rows: _Rows,
        terms: int,
        variables: tuple[str, ...],
        result: int,
        observed: Sequence[tuple[int, int]],
        reader: SampleReader,
    ) -> None: ...
    @property
    def registers(self) -> list[float]: ...
    def run(self, columns: Sequence[ArrayLike], n: int) -> list[Floats]: ...
    def evaluate(
        self, columns: Sequence[ArrayLike], n: int, *, backwards: bool = False
    ) -> list[Floats]: ...

class EpisodeMachine(_SampleMachine):
    def __init__(
        self,
        terms: _Rows,
        formulas: _Rows,
        initial: Sequence[int],
        streams: Sequence[int],
        variables: tuple[str, ...],
        reader: SampleReader,
        neutral: Sequence[int] = (),
    ) -> None: ...
    @property
    def robustness(self) -> float: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def finished(self) -> bool: ...
    def judge(
        self, columns: Sequence[Floats], n: int, end: End
    ) -> tuple[float, float, float, float, int | None] | None: ...
    def finish(self, end: End = "complete") -> float: ...
    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None: ...

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

class DenseMachine(_EventMachine):
    def __init__(
        self,
        rows: _Rows,
        terms: int,
        variables: tuple[str, ...],
        result: int,
        clock: _Clock,
        declared: Sequence[float],
        observed: Sequence[int],
        reader: EventReader,
    ) -> None: ...
    @property
    def values(self) -> list[float]: ...
    def update(
        self, *events: Mapping[str, EventsLike], **named: EventsLike
    ) -> list[tuple[float, float]]: ...
    def finish(self) -> list[tuple[float, float]]: ...
    def run(self, given: Sequence[GivenLike]) -> tuple[Floats, Floats]: ...

class DenseEpisodeMachine(_EventMachine):
    def __init__(
        self,
        readings: Sequence[tuple[_Rows, tuple[object, ...]]],
        variables: tuple[str, ...],
        clock: _Clock,
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
    def span(self) -> tuple[int, int]: ...
    @property
    def decided_at(self) -> float | None: ...
    def update(self, *events: Mapping[str, EventsLike], **named: EventsLike) -> float: ...
    def finish(self, end: str = "complete") -> float: ...
    def run(self, given: Sequence[GivenLike], *, decided: bool = False) -> None: ...
    def complete(self) -> tuple[float, float]: ...

class DenseRegions(_Stateful):
    def __init__(
        self,
        terms: int,
        constants: Sequence[tuple[int, float]],
        rows: _Rows,
        initial: Sequence[int],
        streams: Sequence[int],
        unknowns: Sequence[int],
    ) -> None: ...
    @property
    def t(self) -> int: ...
    def advance(self, positions: _Integers, terms: Sequence[Floats], t: int) -> None: ...
    def look(self, worlds: int) -> tuple[float, ...]: ...
    def reset(self) -> None: ...

class DenseSigns:
    def __init__(
        self,
        terms: _Rows,
        rows: _Rows,
        result: int,
        clock: _Clock,
        reader: EventReader,
        given: Sequence[GivenLike],
        begin: int,
        last: int,
        end: str,
        numbers: bool = False,
    ) -> None: ...
    def result(self, world: int) -> tuple[_Integers, Floats]: ...
    def fails_at(self, instants: Sequence[tuple[int, float]]) -> tuple[int, int, int | None]: ...
    def holds_at(self, instants: Sequence[tuple[int, float]]) -> bool: ...

class ClockBatch(_Stateful):
    def __init__(self, rows: Sequence[OperatorClock], parts: int, num: int) -> None: ...
    @property
    def samples(self) -> _Integers: ...
    @property
    def fractions(self) -> Floats: ...
    @property
    def margins(self) -> Floats: ...
    def feed(self, values: Floats, mask: Entries | None = None) -> None: ...
    def reset(self, mask: Entries | None = None) -> None: ...

class DiscreteBatch(_Batch):
    def __init__(
        self,
        rows: _Rows,
        terms: int,
        variables: tuple[str, ...],
        result: int,
        latency: int,
        num: int,
        reader: BatchReader,
    ) -> None: ...
    def update(
        self, values: ArrayLike = ..., mask: ArrayLike | None = None, **named: object
    ) -> Floats: ...

class EpisodeBatch(_Batch):
    def __init__(
        self,
        terms: _Rows,
        formulas: _Rows,
        initial: Sequence[int],
        streams: Sequence[int],
        variables: tuple[str, ...],
        num: int,
        reader: BatchReader,
        neutral: Sequence[int] = (),
    ) -> None: ...
    def update(
        self,
        values: ArrayLike = ...,
        mask: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        **named: object,
    ) -> Floats: ...
    @property
    def robustness(self) -> Floats: ...
    @property
    def lower(self) -> Floats: ...
    @property
    def upper(self) -> Floats: ...
    @property
    def unknown(self) -> Entries: ...
    @property
    def verdict(self) -> NDArray[np.int8]: ...
    @property
    def finished(self) -> Entries: ...
    def finish(self, mask: ArrayLike | None = None, end: End = "complete") -> Floats: ...
