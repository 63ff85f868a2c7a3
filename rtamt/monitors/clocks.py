"""Clocks of temporal operators: the age of their pending obligations, in a batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError
from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import Entries
from rtamt.machines.backend import BACKENDS, Backend, choose
from rtamt.machines.clocks import OperatorClock


class OperatorClocks:
    """Clocks of temporal operators, with the newest values of their operands.

    `feed` takes the values of parts, such as the robustness from a `VectorMonitor`: late by the
    latency of the part, and nan before it is known. The newest value of an operand that fits the
    other operands is then L samples old; L is the ``late`` of its clock. An operator with the
    window [a, b] over such values equals an operator with the window [a + L, b + L] over values
    without latency. These bounds are ``begin`` and ``end`` of the clock, and a and b below. Let t
    be the newest sample, and s an instant at which the operator is required.

    * ``"oldest"`` of ``eventually[a:b] q``: an instant s is pending until q holds in s + a to
      s + b. The clock counts the instants from the oldest pending instant to t, both included, as a
      fraction of b + 1. It is 0 if no instant is pending, and 1 from the sample at which the oldest
      is overdue until q holds.
    * ``"oldest"`` of ``always[a:b] p``: as before, with p failing instead of q holding. The clock
      is 1 once p has held throughout the window of an instant.
    * ``"oldest"`` of ``p until[a:b] q``: if p fails while an instant is pending, the instant is
      overdue at once: the clock is 1 at this sample, and counts later instants from there on. For
      ``p unless[a:b] q``: if p fails, nothing is pending any more, and q at its time makes the
      clock 1.
    * ``"newest"``: the remaining part of the window of the newest instant, ``(b - (t - s)) / b``.
      For ``until`` it falls to 0 when p fails, for ``unless`` when q holds.
    * ``"last"``: the samples since the operand of ``once[a:b]``, ``prev`` or ``rise`` last held, or
      the operand of ``historically[a:b]`` or ``fall`` last failed, as a fraction of b + 1. It is 1
      if that was longer ago or never. For ``since`` it is also 1 if p has failed after q.

    A window without an end has no fraction. Its clock is 0 if nothing is pending; otherwise, for
    a = 0, it is 1/2 (``until``, ``eventually``, ``unless`` and ``always``, from the oldest) or 1.
    If a > 0, it grows to that value over the first samples. For ``once`` and similar operators it
    is 1 before the operand has held, and 0 afterwards. An operator that is required only at the
    first instant keeps a clock of 1.

    A batch entry without a sample stays as it is, so each entry has its own time. Objects can be
    copied and pickled in the middle of a trace. A clock that no machine can count is an InputError.

    Example:
        >>> answer = OperatorClock("oldest", "holds", 0, 3, 0, operands=((0, 0),))
        >>> clocks = OperatorClocks([answer], parts=1, num=2)
        >>> for gnt in ([-1, -1], [-1, 5], [-1, 2]):
        ...     clocks.feed([gnt])
        >>> clocks.fractions, clocks.margins
        (array([[0.75, 0.  ]]), array([[-1.,  2.]]))
    """

    def __init__(
        self, clocks: Sequence[OperatorClock], parts: int, num: int, backend: Backend = "auto"
    ) -> None:
        self._clocks, self._shape, self._backend = tuple(clocks), (parts, num), backend
        for clock in self._clocks:
            _check(clock, parts)
        self._batch = BACKENDS[choose(backend)].clock_batch(self._clocks, parts, num)

    def feed(self, values: ArrayLike, mask: Entries | None = None) -> None:
        """Update the entries of the mask with the newest values, of shape (parts, num)."""
        table = np.ascontiguousarray(values, dtype=np.float64)
        if table.shape != self._shape:
            raise InputError(
                f"expected values of the shape {self._shape}, a row for each part, "
                f"got {table.shape}"
            )
        self._batch.feed(table, None if mask is None else self._mask(mask))

    def reset(self, mask: Entries | None = None) -> None:
        """Forget every sample of the entries in the mask; without a mask, of all entries."""
        self._batch.reset(None if mask is None else self._mask(mask))

    @property
    def samples(self) -> NDArray[np.int64]:
        """The number of samples of every entry since its reset; a fresh array."""
        return self._batch.samples

    @property
    def fractions(self) -> Floats:
        """A row for each clock: from 0 to 1 in every entry; a fresh array."""
        return self._batch.fractions

    @property
    def margins(self) -> Floats:
        """A row for each operand of each clock: its newest value, 0 before it; a fresh array."""
        return self._batch.margins

    def _mask(self, mask: Entries) -> Entries:
        chosen: Entries = np.ascontiguousarray(mask)
        if chosen.dtype != np.bool_ or chosen.shape != self._shape[1:]:
            raise InputError(
                f"expected a mask of {self._shape[1]} booleans, one for each batch entry, got "
                f"{chosen.dtype} of the shape {chosen.shape}"
            )
        return chosen

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[Any, ...], object]:
        make = partial(type(self), backend=self._backend)
        return make, (self._clocks, *self._shape), self._batch.state()

    def __setstate__(self, state: Any) -> None:  # noqa: ANN401 - each batch has its own
        self._batch.restore(state)

    def __repr__(self) -> str:
        parts, num = self._shape
        return f"<OperatorClocks: {len(self._clocks)} over {parts} parts in {num} batch entries>"


def _check(clock: OperatorClock, parts: int) -> None:
    """Raise InputError for a clock that no machine can count."""
    read = [part for part, _ in clock.operands]
    for part in read if clock.asked is None else [*read, clock.asked]:
        if not 0 <= part < parts:
            raise InputError(f"expected clocks of the parts 0 to {parts - 1}, got part {part}")
    count = 1 if clock.event in {"holds", "fails"} else 2
    if len(read) != count:
        raise InputError(
            f"expected {count} operand{'s' * (count > 1)} for {clock.event!r}, got {len(read)}"
        )
    end = clock.begin if clock.end is None else clock.end
    waiting = sorted(wait for _, wait in clock.operands)
    if not 0 <= waiting[0] <= waiting[-1] <= clock.late <= clock.begin <= end:
        raise InputError(
            "expected operands that wait 0 samples or more, late no less, begin no less than late, "
            f"and end no less than begin, got {clock}"
        )
