"""Monitors of many signals in a batch, such as vectorized environments."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, ClassVar, SupportsIndex, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.arrays import kind_of
from rtamt.inputs.batch import BatchReader
from rtamt.machines.backend import BACKENDS
from rtamt.machines.protocols import End, EpisodeBatch, MachineBatch
from rtamt.monitors.online import (
    EpisodeValues,
    Late,
    MachineValue,
    Sampled,
    machine_value,
)
from rtamt.monitors.options import SampleOptions, Spec, checked_end, listed_in_signature
from rtamt.program.memory import intervals_fit, limit_discrete, limit_episode
from rtamt.program.timing import Period

_B = TypeVar("_B", bound=MachineBatch)

_UPDATE = """Update the batch entries in the mask with a sample; return the robustness of all.

A call that raises an error changes no batch entry.

Args:
    values: An array of shape (num, variables), a row for each batch entry, columns in the
        order of ``variables``. Rows outside the mask are ignored, nan or not.
    mask: num booleans: the batch entries to update. Default: all.{upper}
    **named: Instead of ``values`` an array of num numbers for each variable, as in
        ``update(x=[1, 2, 3])``. A variable with a default may be absent, as for `Monitor`.

Returns:
    A new array of shape (num,): for an updated batch entry, the robustness that the monitor of one
    signal returns; for others, their last value; nan before the first sample.

Raises:
    InputError: On a wrong shape, missing or unknown variables, values in both forms, a nan, or a
        term that is not a number (``sqrt(-1)``), with the batch entry and its sample.
    InputTypeError: On values that are not real numbers, or a mask that is not of booleans.{memory}
    StateError: If a batch entry in the mask is finished.
"""
_UPPER = """
    upper: The largest values, in an array of the same shape: then ``values`` are the smallest, and
        each value lies between the two (`UncertainValue`); by name, pass an `UncertainValue` of two
        arrays instead. Default: the values are known."""
_MEMORY = """
    SpecificationError: If unknown samples would take more memory than
        `rtamt.limits.window_bytes`."""

_MAX_ENTRIES = 2**24
"""The maximum number of entries; more would take gigabytes before their first sample."""


class _Batched(Sampled[_B]):
    """A monitor of many signals: a row of an array is the sample of a batch entry."""

    __slots__ = ("num",)

    _bounds: ClassVar = False
    update: Callable[..., NDArray[np.float64]]

    @listed_in_signature(SampleOptions)
    def __init__(
        self,
        spec: Spec,
        num: SupportsIndex,
        period: Period | None = None,
        **options: Unpack[SampleOptions],
    ) -> None:
        self.num = _counted(num)
        self._compile(spec, period, options)
        reader = BatchReader(self.program, self.num, self._nan, bounds=self._bounds)
        self._machine = self._made(reader)
        self.update = self._machine.update

    def _made(self, reader: BatchReader) -> _B:
        raise NotImplementedError

    def _arguments(self) -> dict[str, Any]:
        return super()._arguments() | {"num": self.num}

    samples: MachineValue[NDArray[np.int64]] = machine_value(
        "samples", "The number of samples of each batch entry since its reset; a new array."
    )

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget every sample of the batch entries in the mask; without a mask, of all.

        Raises:
            InputError: On a mask of another shape than (num,).
            InputTypeError: On a mask that is not of booleans.
        """
        self._machine.reset(mask)


class VectorMonitor(Late, _Batched[MachineBatch]):
    """A `Monitor` of a batch: the robustness of ``num`` signals, late by the latency.

    Each batch entry has its own time: it behaves as a separate `Monitor`, also if masks leave out
    or reset other entries.

    Args:
        spec: Text, a formula, or a parsed specification.
        num: The number of batch entries, 1 to 16,777,216.
        period: As for `Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="hold"`` keeps the variable's last value in that batch entry.

    Raises:
        SpecificationError: As for `Monitor`.
        InputError: As for `Monitor`, and on fewer batch entries than 1 or too many.
        InputTypeError: On a number of batch entries that is not a whole number.

    Example:
        >>> m = VectorMonitor("once[0:1](x - y > 0)", 3)
        >>> m.update([[1, 0], [2, 0], [3, 0]])
        array([1., 2., 3.])
        >>> m.update([[0, 0], [0, 0], [0, 0]], mask=[True, True, False])
        array([1., 2., 3.])
        >>> m.reset(mask=[True, False, False])
        >>> m.update([[0, 0], [0, 0], [0, 0]])
        array([-0., -0.,  3.])
        >>> m.samples
        array([1, 3, 2])
        >>> m.update(x=[2, 2, 2], y=[1, 0, 0])
        array([1., 2., 2.])
    """

    __slots__ = {"update": _UPDATE.format(upper="", memory="")}

    def _made(self, reader: BatchReader) -> MachineBatch:
        limit_discrete(self.program, self.num)
        return BACKENDS[self.backend].discrete_batch(self.program, self.num, reader)

    def __repr__(self) -> str:
        phrase = f"{self.num} batch entries of {self.specification.formula}"
        return f"<VectorMonitor of {phrase}, latency {self.latency}>"


class VectorEpisodeMonitor(
    EpisodeValues[NDArray[np.float64], NDArray[np.bool_]], _Batched[EpisodeBatch]
):
    """An `EpisodeMonitor` of a batch: robustness, bounds and verdicts of ``num`` signals.

    Each batch entry has its own episode, which starts with its first sample after a reset.
    ``robustness``, ``lower``, ``upper``, ``verdict`` and ``finished`` are new arrays of shape
    (num,): they do not change with the next update.

    Args:
        spec: Text, a formula, or a parsed specification.
        num: The number of batch entries, 1 to 16,777,216.
        period: As for `Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="hold"`` keeps the variable's last value in that batch entry, and
            ``nan="unknown"`` reads nan as an unknown value.

    Raises:
        SpecificationError: As for `EpisodeMonitor`.
        InputError: As for `EpisodeMonitor`, and on fewer batch entries than 1 or too many.
        InputTypeError: On a number of batch entries that is not a whole number.

    Example:
        >>> e = VectorEpisodeMonitor("always[0:100](x > 1)", 3)
        >>> e.update([[5], [2], [0]]), e.upper, e.verdict
        (array([ 4.,  1., -1.]), array([ 4.,  1., -1.]), array([ 0,  0, -1], dtype=int8))
        >>> e.finish(mask=[True, False, False])
        array([ 4.,  1., -1.])
        >>> e.lower, e.verdict
        (array([  4., -inf, -inf]), array([ 1,  0, -1], dtype=int8))

        >>> e = VectorEpisodeMonitor("always(x > 1)", 2)
        >>> e.update([[3], [0]], upper=[[5], [4]]), e.finish(), e.upper, e.verdict
        (array([ 2., -1.]), array([ 2., -1.]), array([4., 3.]), array([1, 0], dtype=int8))
    """

    __slots__ = {"update": _UPDATE.format(upper=_UPPER, memory=_MEMORY)}

    _bounds: ClassVar = True

    def _made(self, reader: BatchReader) -> EpisodeBatch:
        limit_episode(self.program, self.num, unknown=self._nan == "unknown")
        reader.intervals_fit = intervals_fit(self.program, self.num)
        return BACKENDS[self.backend].episode_batch(self.program, self.num, reader)

    verdict: MachineValue[NDArray[np.int8]] = machine_value(
        "verdict", "The verdict on each batch entry: -1 violated, 0 undecided, 1 satisfied."
    )

    unknown: MachineValue[NDArray[np.bool_]] = machine_value(
        "unknown",
        "Whether each value of the last sample of each batch entry is an `UncertainValue`; "
        "a row for each batch entry, a column for each variable.",
    )

    def finish(
        self, mask: ArrayLike | None = None, *, end: End = "complete"
    ) -> NDArray[np.float64]:
        """End the traces of the batch entries in the mask; without a mask, of all.

        Each entry ends as in `EpisodeMonitor.finish`. Finished entries stay as they are.

        Args:
            mask: num booleans: the batch entries that end. Default: all.
            end: The end mode: ``"complete"``, ``"cut"`` or ``"open"``.

        Returns:
            ``robustness`` of all batch entries, finished or not, as a new array.

        Raises:
            StateError: If an entry in the mask has no sample; then no entry is finished.
            InputError: On a mask of another shape than (num,), or another end mode.
            InputTypeError: On a mask that is not of booleans.
        """
        if isinstance(mask, str):
            raise InputTypeError(
                f"expected a mask of {self.num} booleans, got {kind_of(mask)}; "
                "pass the end mode by name, as in end='cut'"
            )
        return self._machine.finish(mask, checked_end(end))

    def __repr__(self) -> str:
        return f"<VectorEpisodeMonitor of {self.num} batch entries of {self.specification.formula}>"


def _counted(num: object) -> int:
    """Return the batch size."""
    if isinstance(num, bool | np.bool_) or not isinstance(num, SupportsIndex):
        raise InputTypeError(
            f"expected a whole number of batch entries, got {num!r}; the period is the third "
            "argument"
        )
    entries = operator.index(num)
    if entries < 1:
        raise InputError(f"expected 1 or more batch entries, got {entries}")
    if entries > _MAX_ENTRIES:
        raise InputError(f"expected at most {_MAX_ENTRIES} batch entries, got {entries}")
    return entries
