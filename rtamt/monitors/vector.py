"""Monitors of many signals in lockstep, such as those of vectorised environments."""

from __future__ import annotations

import operator
from typing import Any, SupportsIndex, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.lanes import LaneReader
from rtamt.inputs.samples import NanPolicy
from rtamt.machines.backend import (
    Backend,
    DiscreteBank,
    EpisodeBank,
    LaneMachine,
    discrete_bank,
    episode_bank,
)
from rtamt.monitors.online import Online, Spec
from rtamt.program.interface import Names, Semantics
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["VectorEpisodeMonitor", "VectorMonitor"]

_B = TypeVar("_B", bound=LaneMachine)


class _Lockstep(Online[_B]):
    """Many signals: a row of an array is the sample of a lane."""

    __slots__ = ("num",)

    def __init__(
        self,
        spec: Spec,
        num: SupportsIndex,
        period: Period | None = None,
        *,
        backend: Backend = "auto",
        nan: NanPolicy = "raise",
        semantics: Semantics = "standard",
        inputs: Names | None = None,
        outputs: Names | None = None,
    ) -> None:
        self.num = _counted(num)
        super().__init__(
            spec,
            period,
            backend=backend,
            nan=nan,
            semantics=semantics,
            inputs=inputs,
            outputs=outputs,
        )

    def _made(self) -> _B:
        return self._machine_of(LaneReader(self.program, self.num, self._nan))

    def _machine_of(self, reader: LaneReader) -> _B:
        raise NotImplementedError

    def _arguments(self) -> tuple[Any, ...]:
        return self.specification, self.num, self._period

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples that each lane has taken in since it was made or reset; a fresh array."""
        return self._machine.samples

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget every sample of the lanes where the mask is true; without a mask, of all.

        Raises:
            InputError: On a mask of another shape than (num,).
            InputTypeError: On a mask that is not of booleans.
        """
        self._machine.reset(mask)


class VectorMonitor(_Lockstep[DiscreteBank]):
    """`Monitor` of ``num`` signals in lockstep: robustness of every lane, late by the latency.

    Lanes have a time each: a lane that a mask leaves out of an update, or that is reset, goes on
    as a `Monitor` of its own would.

    Args:
        spec: Text, a formula, or a parsed specification.
        num: How many lanes, 1 or more.
        period: Seconds between samples, as a number or as text (``"100ms"``). None: the bounds of
            the formula are numbers of samples.
        backend: ``"auto"`` takes the C++ machine where it was built.
        nan: ``"raise"`` refuses nan; ``"hold"`` keeps the variable's last value in that lane.
        semantics: ``"standard"``, or an interface-aware one: ``"output-robustness"``,
            ``"input-vacuity"``, ``"input-robustness"`` or ``"output-vacuity"``.
        inputs: Variables that the system reads; a message stands for its fields. None: those that
            the text declares ``input``. Only interface-aware semantics ask for them.
        outputs: Variables that the system sets; likewise.

    Raises:
        SpecificationError: As `Monitor` does.
        InputError: On fewer lanes than 1.
        InputTypeError: On a number of lanes that is no whole number.

    Example:
        >>> m = VectorMonitor("once[0:1](x - y > 0)", 3)
        >>> m.update([[1, 0], [2, 0], [3, 0]])
        array([1., 2., 3.])
        >>> m.update([[0, 0], [0, 0], [0, 0]], mask=[True, True, False])
        array([1., 2., 3.])
        >>> m.reset(mask=[True, False, False])
        >>> m.update([[0, 0], [0, 0], [0, 0]])
        array([0., 0., 3.])
        >>> m.samples
        array([1, 3, 2])
    """

    __slots__ = ()

    def _compiled(self) -> Program:
        return compile_program(
            self.specification, self._period, interface=self.interface, online=True
        )

    def _machine_of(self, reader: LaneReader) -> DiscreteBank:
        return discrete_bank(self.backend, self.program, self.num, reader)

    @property
    def latency(self) -> int:
        """Samples by which the robustness is late."""
        return self.program.latency or 0

    def update(self, values: ArrayLike, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """Take in a sample in every lane, and give each lane's robustness at time t - latency.

        Args:
            values: An array of shape (num, variables), a row for each lane, columns in the order
                of ``variables``. Rows of lanes that the mask leaves out are ignored, nan or not.
            mask: num booleans: the lanes that take a sample. None: all.

        Returns:
            A fresh array of shape (num,): for a lane that took a sample what `Monitor.update`
            gives, nan before the latency; for one that did not the value that it had, nan before
            its first sample.

        Raises:
            InputError: On a wrong shape, a nan, or a term that is not a number (``sqrt(-1)``), with
                the lane and its sample. All lanes are as they were before the call.
            InputTypeError: On values that are no real numbers, or a mask that is not of booleans.
        """
        return self._machine.update(values, mask)

    def __repr__(self) -> str:
        what = f"{self.num} lanes of {self.specification.formula}"
        return f"<VectorMonitor of {what}, latency {self.latency}>"


class VectorEpisodeMonitor(_Lockstep[EpisodeBank]):
    """`EpisodeMonitor` of ``num`` signals in lockstep: robustness, bounds and verdict of each lane.

    Every lane is in an episode of its own, which begins with its first sample after a reset. Arrays
    are handed out fresh: they do not change with the next update.

    Args:
        spec: Text, a formula, or a parsed specification.
        num: How many lanes, 1 or more.
        period: Seconds between samples, as a number or as text (``"100ms"``). None: the bounds of
            the formula are numbers of samples.
        backend: ``"auto"`` takes the C++ machine where it was built.
        nan: ``"raise"`` refuses nan; ``"hold"`` keeps the variable's last value in that lane.
        semantics: ``"standard"``, or an interface-aware one: ``"output-robustness"``,
            ``"input-vacuity"``, ``"input-robustness"`` or ``"output-vacuity"``.
        inputs: Variables that the system reads; a message stands for its fields. None: those that
            the text declares ``input``. Only interface-aware semantics ask for them.
        outputs: Variables that the system sets; likewise.

    Raises:
        SpecificationError: As `EpisodeMonitor` does.
        InputError: On fewer lanes than 1.
        InputTypeError: On a number of lanes that is no whole number.

    Example:
        >>> e = VectorEpisodeMonitor("always[0:100](x > 1)", 3)
        >>> e.update([[5], [2], [0]]), e.upper, e.verdict
        (array([ 4.,  1., -1.]), array([ 4.,  1., -1.]), array([ 0,  0, -1], dtype=int8))
        >>> e.finish(mask=[True, False, False])
        array([ 4.,  1., -1.])
        >>> e.lower, e.verdict
        (array([  4., -inf, -inf]), array([ 1,  0, -1], dtype=int8))
    """

    __slots__ = ()

    def _compiled(self) -> Program:
        return compile_program(self.specification, self._period, interface=self.interface)

    def _machine_of(self, reader: LaneReader) -> EpisodeBank:
        return episode_bank(self.backend, self.program, self.num, reader)

    def update(self, values: ArrayLike, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """Take in a sample in every lane, and give each lane's robustness if it ended now.

        Args:
            values: An array of shape (num, variables), a row for each lane, columns in the order
                of ``variables``. Rows of lanes that the mask leaves out are ignored, nan or not.
            mask: num booleans: the lanes that take a sample. None: all.

        Returns:
            ``robustness``, as a fresh array of shape (num,); nan in a lane without samples.

        Raises:
            InputError: On a wrong shape, a nan, or a term that is not a number (``sqrt(-1)``), with
                the lane and its sample. All lanes are as they were before the call.
            InputTypeError: On values that are no real numbers, or a mask that is not of booleans.
            StateError: If a lane that is to take a sample is finished; likewise.
        """
        return self._machine.update(values, mask)

    @property
    def robustness(self) -> NDArray[np.float64]:
        """Robustness of each lane if its episode ended with its last sample; nan before any."""
        return self._machine.robustness

    @property
    def lower(self) -> NDArray[np.float64]:
        """The least robustness of each lane over all continuations."""
        return self._machine.lower

    @property
    def upper(self) -> NDArray[np.float64]:
        """The greatest robustness of each lane over all continuations."""
        return self._machine.upper

    @property
    def verdict(self) -> NDArray[np.int8]:
        """What is certain about each lane: -1 violated, 1 satisfied, 0 undecided."""
        return self._machine.verdict

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Whether `finish` has ended the trace of each lane."""
        return self._machine.finished

    def finish(self, mask: ArrayLike | None = None) -> NDArray[np.float64]:
        """End the traces of the lanes where the mask is true, without a mask of all.

        In each of these lanes what `EpisodeMonitor.finish` says holds. Lanes that are finished
        already stay as they are.

        Returns:
            ``robustness`` of all lanes, finished or not, as a fresh array.

        Raises:
            StateError: If one of these lanes has no sample; then no lane is finished.
            InputError: On a mask of another shape than (num,).
            InputTypeError: On a mask that is not of booleans.
        """
        return self._machine.finish(mask)

    def __repr__(self) -> str:
        return f"<VectorEpisodeMonitor of {self.num} lanes of {self.specification.formula}>"


def _counted(num: object) -> int:
    """The number of lanes.

    Raises:
        InputError: If it is less than 1.
        InputTypeError: If it is no whole number.
    """
    if isinstance(num, bool | np.bool_) or not isinstance(num, SupportsIndex):
        msg = f"expected a whole number of lanes, got {num!r}; the period is the third argument"
        raise InputTypeError(msg)
    lanes = operator.index(num)
    if lanes < 1:
        msg = f"expected 1 or more lanes, got {lanes}"
        raise InputError(msg)
    return lanes
