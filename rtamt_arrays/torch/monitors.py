"""Formulas on integers that have the order of numbers, for compiled steps without a gradient.

A formula takes min, max and negatives of its terms. The bits of a float, read as an integer, have
the order of floats where these are positive, and the opposite one where they are negative; with all
bits but the sign turned round there, the integers have the order of numbers, -0.0 below 0.0. Then
min and max are one operation each, where those of floats take six, which keep zeros of either sign
apart, and ``~`` is the negative. Terms are found in floats, and states and readings are floats.

A graph has half as many operations so, and takes half the time to compile. In eager mode the
turning costs more than it saves.

Monitors of tensors, which write into their state where a caller wants that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic, TypeVar

import torch

from rtamt.errors import InputError
from rtamt.program.instructions import Const, Load
from rtamt.program.program import Program
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.inputs import ArrayReader, ArraySample, columns, refused, terms
from rtamt_arrays.layout import BoundsReading, EpisodeState
from rtamt_arrays.online import OnlineMonitor, OnlineReading, OnlineState
from rtamt_arrays.operations import Operations, Tensor
from rtamt_arrays.torch.operations import BITS, TorchOperations, TorchReader, differentiated

Machine = TypeVar("Machine")

_READ = ("robustness", "lower", "upper")
"""The numbers of readings."""


class OrderedFormulas(Generic[Machine]):
    """A machine that runs the formulas of a program on integers.

    Args:
        made: Makes the machine.
        program: The program.
        reader: Reads the floats of a caller.
        tables: The numbers of the machine's state, but for a ring of which a step reads few.
        check: Refuses what is no state of the machine.
        in_place: Whether a step may write into that ring.
    """

    def __init__(
        self,
        made: Callable[[Program, Operations, ArrayReader], Machine],
        program: Program,
        reader: TorchReader,
        tables: Sequence[str],
        check: Callable[[Any], None],
        *,
        in_place: bool = False,
    ) -> None:
        self._program, self._reader, self._tables = program, reader, tables
        self._check = check
        self._operations = TorchOperations(reader.device)
        inputs = program.instructions[: program.terms]
        self._given = [r for r, each in enumerate(inputs) if not isinstance(each, Const)]
        ordered = _OrderedOperations(reader.device, reader.dtype, in_place=in_place)
        self._machine = made(self._formulas(), ordered, _OrderedReader(reader.dtype))

    def _formulas(self) -> Program:
        """The program whose variables are the terms."""
        instructions = list(self._program.instructions)
        for r in self._given:
            instructions[r] = Load(str(r))
        variables = tuple(map(str, self._given))
        return replace(self._program, instructions=tuple(instructions), variables=variables)

    def run(
        self,
        step: Callable[[Machine, Any, ArraySample], tuple[Any, ...]],
        state: Any,  # noqa: ANN401 - the machine's own
        sample: ArraySample,
    ) -> Any:  # noqa: ANN401 - what the step gives
        """What a step gives; None in eager mode, and where gradients go through."""
        if not torch.compiler.is_compiling():
            return None
        self._check(state)
        o, lanes = self._operations, tuple(state.age.shape)
        values = columns(self._program, self._reader, sample, lanes)
        if differentiated(*values, *state):
            return None
        known, wrong = terms(self._program, o, self._reader.dtype, values)
        if wrong is not None:
            state = state._replace(nan=state.nan | wrong)
        tables = {n: _integers(x) for n in self._tables if len(x := getattr(state, n))}
        given = {str(r): _integers(o.broadcast(known[r], lanes)) for r in self._given}
        following, *readings = step(self._machine, state._replace(**tables), given)
        return self._floats(following, tables), *(self._floats(each, _READ) for each in readings)

    def _floats(self, arrays: Any, names: Container[str]) -> Any:  # noqa: ANN401 - a named tuple
        # In an order that is the same in all processes: caches of graphs know them by their text.
        there = [name for name in arrays._fields if name in names]
        return arrays._replace(
            **{name: _numbers(getattr(arrays, name), self._reader.dtype) for name in there}
        )


def _integers(x: Tensor) -> Tensor:
    """Integers in the order of numbers."""
    return _turned(x.view(BITS[x.dtype.itemsize]))


def _numbers(integers: Tensor, dtype: Any) -> Tensor:  # noqa: ANN401 - a kind of floats
    """The numbers of such integers."""
    return _turned(integers).view(dtype)


def _turned(bits: Tensor) -> Tensor:
    """Negative integers with all bits but that of the sign turned round."""
    return bits ^ ((bits >> (8 * bits.dtype.itemsize - 1)) & torch.iinfo(bits.dtype).max)


def _found_integer(value: float, dtype: object) -> int:
    """The integer of a number."""
    return int(_integers(torch.tensor(value, dtype=dtype, device="cpu")).item())


# Under torch.compile it is found while the graph is made, and is no part of it.
_integer = torch.compiler.assume_constant_result(_found_integer)


class _OrderedOperations(TorchOperations):
    """Operations on such integers. Floats that they are given are turned into them."""

    def __init__(self, device: object, dtype: object, *, in_place: bool) -> None:
        super().__init__(device, in_place=in_place)
        self._dtype = dtype

    def full(self, shape: tuple[int, ...], value: float, dtype: Any) -> Tensor:  # noqa: ANN401
        if dtype == self._dtype:
            value, dtype = _integer(value, dtype), BITS[dtype.itemsize]
        return super().full(shape, value, dtype)

    def constant(self, values: Sequence[float], dtype: object) -> Tensor:
        found = super().constant(values, dtype)
        return _integers(found) if dtype == self._dtype else found

    def where(self, condition: Tensor, x: Tensor | float, y: Tensor | float) -> Tensor:
        x, y = (_integer(a, self._dtype) if isinstance(a, float) else a for a in (x, y))
        return torch.where(condition, x, y)

    lesser = staticmethod(torch.minimum)
    greater = staticmethod(torch.maximum)

    def neg(self, x: Tensor) -> Tensor:
        return ~x

    def signbit(self, x: Tensor) -> Tensor:
        return x < 0

    def isnan(self, x: Tensor) -> Tensor:
        return x != x  # noqa: PLR0124 - none is: what was nan is known of the terms

    def gather(self, table: Tensor, rows: Tensor) -> Tensor:
        return _integers(super().gather(table, rows))

    def scatter(self, table: Tensor, rows: Tensor, values: Tensor) -> Tensor:
        return super().scatter(table, rows, _numbers(values, self._dtype))


class _OrderedReader:
    """Takes such integers as they are."""

    kind = "integers"
    module = "torch"
    limits = (0.0, math.inf)

    def __init__(self, dtype: object) -> None:
        self.dtype = dtype

    def taken(self, value: Tensor) -> Tensor:
        return value

    def is_array(self, value: object) -> bool:  # noqa: ARG002 - they come from terms
        return True

    def holds(self, value: object, dtype: object) -> bool:  # noqa: ARG002 - they were looked at
        return True

    def shown(self, value: object) -> str:  # noqa: ARG002 - nothing is refused here
        return ""

    def nearest(self, name: str, names: Sequence[str]) -> str:  # noqa: ARG002
        return ""

    def announce(self, text: str) -> None:
        """Nothing is refused here."""

    def mask(self, mask: object, like: Tensor) -> Tensor:  # noqa: ARG002 - nothing is reset here
        msg = "lanes are reset in floats"
        raise AssertionError(msg)


ArrayReading = TypeVar("ArrayReading", OnlineReading, BoundsReading)


class TorchOnlineMonitor(OnlineMonitor):
    """`rtamt.VectorMonitor` as functions of tensors; made by ``online``.

    Attributes:
        program: The compiled program.
        variables: Names of the variables, in the order of the last axis of a sample.
        latency: Samples by which the robustness is late.
    """

    def __init__(self, program: Program, reader: TorchReader) -> None:
        super().__init__(program, TorchOperations(reader.device), reader)
        writing = TorchOperations(reader.device, in_place=True)
        self._writing = OnlineMonitor(program, writing, reader)
        self._ordered, self._ordered_writing = (
            OrderedFormulas(
                OnlineMonitor, program, reader, ("totals",), self._check, in_place=in_place
            )
            for in_place in (False, True)
        )

    def update(self, state: OnlineState, sample: ArraySample) -> tuple[OnlineState, OnlineReading]:
        """Take in a sample in every lane; see `rtamt_arrays.online.OnlineMonitor.update`."""
        found: tuple[OnlineState, OnlineReading] | None
        found = self._ordered.run(OnlineMonitor.update, state, sample)
        following, reading = found or super().update(state, sample)
        return following, _kept(reading)

    def update_(self, state: OnlineState, sample: ArraySample) -> OnlineReading:
        """Take in a sample in every lane; the state is overwritten with the next one.

        Args:
            state: As for `update`.
            sample: As for `update`.

        Raises:
            InputError: As `update` does, and if a gradient goes through the state or the sample;
                the state is then as it was.
            InputTypeError: As `update` does; the state is then as it was.
        """
        _check_gradients(self._reader, self.variables, state, sample)
        written = self._ordered_writing.run(OnlineMonitor.update, state, sample)
        following, reading = written or self._writing.update(state, sample)
        _overwrite(state, following)
        return reading

    def reset_(self, state: OnlineState, mask: Tensor | None = None) -> None:
        """Make the lanes of the mask forget every sample; the state is overwritten.

        Args:
            state: As for `reset`.
            mask: As for `reset`.

        Raises:
            InputError: As `reset` does; the state is then as it was.
            InputTypeError: As `reset` does; the state is then as it was.
        """
        _overwrite(state, self.reset(state, mask))


class TorchEpisodeMonitor(EpisodeArrays):
    """`rtamt.VectorEpisodeMonitor` as functions of tensors; made by ``episode``.

    Attributes:
        program: The compiled program.
        variables: Names of the variables, in the order of the last axis of a sample.
    """

    def __init__(self, program: Program, reader: TorchReader) -> None:
        super().__init__(program, TorchOperations(reader.device), reader)
        tables = ("rows", "kept", "first")
        self._ordered = OrderedFormulas(EpisodeArrays, program, reader, tables, self._check)

    def update(
        self, state: EpisodeState, sample: ArraySample
    ) -> tuple[EpisodeState, BoundsReading]:
        """Take in a sample in every lane; see `rtamt_arrays.episode.EpisodeArrays.update`."""
        found: tuple[EpisodeState, BoundsReading] | None
        found = self._ordered.run(EpisodeArrays.update, state, sample)
        following, reading = found or super().update(state, sample)
        return following, _kept(reading)

    def update_and_cut(
        self, state: EpisodeState, sample: ArraySample
    ) -> tuple[EpisodeState, BoundsReading, BoundsReading]:
        """Say a cut trace too; see `rtamt_arrays.episode.EpisodeArrays.update_and_cut`."""
        found: tuple[EpisodeState, BoundsReading, BoundsReading] | None
        found = self._ordered.run(EpisodeArrays.update_and_cut, state, sample)
        following, reading, cut = found or super().update_and_cut(state, sample)
        return following, _kept(reading), _kept(cut)

    def update_(self, state: EpisodeState, sample: ArraySample) -> BoundsReading:
        """Take in a sample in every lane; the state is overwritten with the next one.

        Args:
            state: As for `update`.
            sample: As for `update`.

        Raises:
            InputError: As `update` does, and if a gradient goes through the state or the sample;
                the state is then as it was.
            InputTypeError: As `update` does; the state is then as it was.
        """
        _check_gradients(self._reader, self.variables, state, sample)
        following, reading = self.update(state, sample)
        _overwrite(state, following)
        return reading

    def reset_(self, state: EpisodeState, mask: Tensor | None = None) -> None:
        """Make the lanes of the mask forget every sample; the state is overwritten.

        Args:
            state: As for `reset`.
            mask: As for `reset`.

        Raises:
            InputError: As `reset` does; the state is then as it was.
            InputTypeError: As `reset` does; the state is then as it was.
        """
        _overwrite(state, self.reset(state, mask))


def _check_gradients(
    reader: ArrayReader,
    variables: Sequence[str],
    state: object,
    sample: ArraySample,
) -> None:
    """Refuse a gradient through what is overwritten: its graph would grow, and never go back."""
    if torch.is_grad_enabled():
        given = [sample.get(v) for v in variables] if isinstance(sample, Mapping) else [sample]
        kept = state if isinstance(state, tuple) else ()  # if it is none, a step says so
        if any(isinstance(x, torch.Tensor) and x.requires_grad for x in (*kept, *given)):
            text = (
                "expected a state and a sample that require no gradient, as update_ overwrites the "
                "state; take update, or call update_ under torch.no_grad()"
            )
            refused(reader, InputError, text)


def _kept(reading: ArrayReading) -> ArrayReading:
    """The reading with flags of its own, which stay when the state is overwritten."""
    return reading._replace(nan=reading.nan.clone())


def _overwrite(state: OnlineState | EpisodeState, following: OnlineState | EpisodeState) -> None:
    for old, new in zip(state, following, strict=True):
        if new is not old:
            old.copy_(new)
