"""The Python machines of a batch: lists of single ones, all of which take a sample or none."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import BatchReader, numbers_of
from rtamt.inputs.between import UncertainValue
from rtamt.inputs.samples import ends_of, in_between
from rtamt.machines.discrete import PythonDiscreteMachine
from rtamt.machines.episode.machine import PythonEpisodeVariants
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdicts_of
from rtamt.machines.state import StateFields
from rtamt.program.program import Program

_Machine = PythonDiscreteMachine | PythonEpisodeVariants
_M = TypeVar("_M", PythonDiscreteMachine, PythonEpisodeVariants)


class _PythonBatch(StateFields, Generic[_M]):
    """Machines of one program, each with its own time."""

    STATE = ("_machines",)

    def __init__(self, machines: Iterable[_M], reader: BatchReader) -> None:
        self._machines: list[_M] = list(machines)
        self._reader = reader

    @property
    def samples(self) -> NDArray[np.int64]:
        return np.array([machine.samples for machine in self._machines], dtype=np.int64)

    def reset(self, mask: ArrayLike | None = None) -> None:
        for entry in numbers_of(self._reader.mask(mask), len(self._machines)):
            self._machines[entry].reset()

    def _each(self, name: str) -> Floats:
        return np.array([getattr(machine, name) for machine in self._machines], dtype=np.float64)


def _inputs(machine: _Machine, width: int) -> Sequence[float | UncertainValue]:
    """Return the last sample of a machine without the rates; 0 before the first."""
    return machine.inputs[:width] or [0.0] * width


def _rates(machine: _Machine, values: Sequence[float | UncertainValue]) -> list[Any]:
    """Return the rates of the next sample of a machine, which follow its values."""
    return machine.reader.rates.of_sample(values, machine.inputs)


def _absent(values: object) -> bool:
    """Return whether there are no values, because they are passed by name."""
    return isinstance(values, tuple) and not values


class PythonDiscreteBatch(_PythonBatch[PythonDiscreteMachine]):
    """Machines on samples in a batch."""

    def __init__(self, program: Program, num: int, reader: BatchReader) -> None:
        machines = (PythonDiscreteMachine(program, reader.entry(i), ()) for i in range(num))
        super().__init__(machines, reader)
        self._variables = program.inputs

    @property
    def inputs(self) -> Floats:
        width = len(self._variables)
        return np.array([_inputs(machine, width) for machine in self._machines])

    def update(
        self, values: ArrayLike = (), mask: ArrayLike | None = None, **named: object
    ) -> Floats:
        if named or _absent(values):
            return self._reader.update(self, values, mask, **named)
        table, chosen = self._reader.values(values), self._reader.mask(mask)
        entries = numbers_of(chosen, len(self._machines))
        inputs = np.array([_inputs(m, table.shape[1]) for m in self._machines])
        table = self._reader.without_nan(table, chosen, self.samples, inputs)
        rows = table.tolist()
        for entry in entries:
            rows[entry] += _rates(self._machines[entry], rows[entry])
        terms = [self._machines[entry].terms(rows[entry]) for entry in entries]
        for entry, known in zip(entries, terms, strict=True):
            self._machines[entry].take(known, rows[entry])
        return self._each("result")


class PythonEpisodeBatch(_PythonBatch[PythonEpisodeVariants]):
    """Machines that bound the robustness of episodes, in a batch."""

    def __init__(self, program: Program, num: int, reader: BatchReader) -> None:
        super().__init__(
            (PythonEpisodeVariants(program, reader.entry(i)) for i in range(num)), reader
        )
        self._variables = program.inputs

    def update(
        self,
        values: ArrayLike = (),
        mask: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        **named: object,
    ) -> Floats:
        if named or _absent(values):
            return self._reader.update(self, values, mask, upper, **named)
        table = self._reader.values(values)
        above = None if upper is None else self._reader.values(upper)
        chosen = self._reader.mask(mask)
        entries = numbers_of(chosen, len(self._machines))
        self._require_open(entries)
        last = [_inputs(m, table.shape[1]) for m in self._machines]
        before = tuple(np.array([[ends_of(x)[i] for x in row] for row in last]) for i in (0, 1))
        ends = self._reader.ends(table, above, chosen, self.samples, (before[0], before[1]))
        lower, upper_ends = (column.tolist() for column in ends)
        samples = []
        for entry in entries:
            machine = self._machines[entry]
            row = [*map(in_between, lower[entry], upper_ends[entry])]
            samples.append(machine.terms(row + _rates(machine, row)))
        for entry, sample in zip(entries, samples, strict=True):
            self._machines[entry].take(sample)
        return self._each("result")

    @property
    def inputs(self) -> Floats:
        rows = [_inputs(machine, len(self._variables)) for machine in self._machines]
        return np.array([[ends_of(value)[0] for value in row] for row in rows])

    @property
    def robustness(self) -> Floats:
        return self._each("robustness")

    @property
    def lower(self) -> Floats:
        return self._each("lower")

    @property
    def upper(self) -> Floats:
        return self._each("upper")

    @property
    def unknown(self) -> NDArray[np.bool_]:
        rows = [_inputs(m, len(self._variables)) for m in self._machines]
        return np.array(
            [[isinstance(x, UncertainValue) for x in row] for row in rows], dtype=np.bool_
        )

    @property
    def verdict(self) -> NDArray[np.int8]:
        return verdicts_of(self.lower, self.upper)

    @property
    def finished(self) -> NDArray[np.bool_]:
        return np.array([machine.finished for machine in self._machines])

    def finish(self, mask: ArrayLike | None = None, end: End = "complete") -> Floats:
        entries = numbers_of(self._reader.mask(mask), len(self._machines))
        for entry in entries:
            if self._machines[entry].samples == 0:
                self._reader.refuse_finish(entry)
        for entry in entries:
            self._machines[entry].finish(end)
        return self.robustness

    def _require_open(self, entries: Sequence[int]) -> None:
        for entry in entries:
            if self._machines[entry].finished:
                self._reader.refuse_update(entry)
