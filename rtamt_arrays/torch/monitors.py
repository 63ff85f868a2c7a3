"""Monitors of tensors, which write into their state where a caller wants that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import torch

from rtamt.errors import InputError
from rtamt.program.program import Program
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.online import OnlineMonitor, OnlineReading, OnlineState
from rtamt_arrays.operations import Tensor
from rtamt_arrays.terms import ArrayReader, ArraySample, refused
from rtamt_arrays.torch.operations import TorchOperations, TorchReader
from rtamt_arrays.torch.ordered import OrderedFormulas
from rtamt_arrays.worlds import BoundsReading, EpisodeState

__all__ = ["TorchEpisodeMonitor", "TorchOnlineMonitor"]

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
