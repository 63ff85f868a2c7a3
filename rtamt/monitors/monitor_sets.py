"""Several monitors on the same samples: updates in one call, and a verdict log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import BatchReader, Entries
from rtamt.machines.backend import BACKENDS, logs_of
from rtamt.machines.batch import BatchOutcomes, EntryColumn, EntryValue, VerdictLogFunctions
from rtamt.machines.protocols import End, EpisodeBatch
from rtamt.monitors.monitor import EpisodeMonitor
from rtamt.monitors.options import checked_end
from rtamt.monitors.vector import VectorEpisodeMonitor

_FLAGS = np.dtype(np.bool_)


class VerdictLog:
    """The verdict log of several vector monitors of episodes.

    Each row of an array is a monitor, each column a batch entry; arrays of shape (num,) have a
    value for each entry. Arrays belong to the log and change in place; treat them as read-only. A
    call acts on all monitors.

    Args:
        monitors: One or more monitors with equal batch sizes. If they are updated separately, call
            `note` afterwards.

    Attributes:
        settled_at: The sample at which a verdict was settled, counted from 0: the sample that
            decided it, or the last sample if only the end decided it; -1 while it is open.
        open_at_end: Whether a verdict was open when its trace ended.
        violated: Whether a specification is violated.
        failed: Whether `fail` violated it.
        first: The number of the first violated monitor of a batch entry; -1 without a violation.
        violated_at: The sample at which this verdict was settled; -1 without a violation.

    Example:
        >>> near, far = (VectorEpisodeMonitor(f"always(x < {k})", 2) for k in (1, 3))
        >>> log = VerdictLog([far, near])
        >>> for sample in ([[0], [0]], [[0], [2]]):
        ...     _ = log.feed(np.array(sample, float), [(0,), (0,)])
        >>> log.settled_at.tolist(), log.first.tolist(), log.violated_at.tolist()
        ([[-1, -1], [-1, 1]], [-1, 1], [-1, 1])
        >>> log.least("robustness")
        array([ 1., -1.])
    """

    def __init__(self, monitors: Iterable[VectorEpisodeMonitor]) -> None:
        self.monitors = tuple(monitors)
        for monitor in self.monitors:
            if not isinstance(monitor, VectorEpisodeMonitor):
                msg = f"expected monitors of the class VectorEpisodeMonitor, got {monitor!r}"
                raise InputTypeError(msg)
        entries = sorted({monitor.num for monitor in self.monitors})
        if len(entries) != 1:
            got = f"monitors of {' and '.join(map(str, entries))}" if entries else "no monitor"
            raise InputError(f"expected one or more monitors with equal batch sizes, got {got}")
        (self.num,) = entries
        shape = len(self.monitors), self.num
        self.settled_at: NDArray[np.int64] = np.full(shape, -1, np.int64)
        self.open_at_end: Entries = np.zeros(shape, np.bool_)
        self.violated: Entries = np.zeros(shape, np.bool_)
        self.failed: Entries = np.zeros(shape, np.bool_)
        self.first: NDArray[np.int64] = np.full(self.num, -1, np.int64)
        self.violated_at: NDArray[np.int64] = np.full(self.num, -1, np.int64)
        self._fails = False  # whether any entry may have failed
        self._found = self._batches()

    @property
    def decided_at(self) -> NDArray[np.int64]:
        """The sample that decided a verdict; -1 if it is open or only the end decided it."""
        return np.where(self.open_at_end, np.int64(-1), self.settled_at)

    def feed(
        self, table: Floats, columns: Sequence[tuple[int, ...]], mask: ArrayLike | None = None
    ) -> Floats:
        """Update the batch entries in the mask with a sample; return their minimum robustness.

        A sample is a table of shape (num, width), fastest as float64 in Fortran order; ``columns``
        has the columns of each monitor's variables. An error leaves the monitors before it updated.
        """
        batches, functions = self._found
        functions.feed(batches, columns, table, self._mask(mask))
        functions.note(batches, None, *self._arrays())
        return functions.least(batches, "robustness", None)

    def note(self) -> None:
        """Record new decisions of the monitors, with the last sample of each batch entry."""
        batches, functions = self._found
        functions.note(batches, None, *self._arrays())

    def finish(self, mask: ArrayLike | None = None, *, end: End = "complete") -> None:
        """End the traces in the mask, as `VectorEpisodeMonitor.finish` does."""
        batches, functions = self._found
        chosen = self._mask(mask)
        functions.note(batches, None, *self._arrays())
        was_open = self.settled_at < 0
        functions.finish(batches, chosen, checked_end(end))
        functions.note(batches, chosen, *self._arrays())
        self.open_at_end |= was_open if chosen is None else was_open & chosen

    def fail(self, mask: ArrayLike | None = None) -> None:
        """Count open verdicts in the mask as violated by the last sample, if there is one."""
        chosen, begun = self._mask(mask), self.monitors[0].samples > 0
        entries = begun if chosen is None else begun & chosen
        failed = entries & (self.settled_at < 0)
        self.failed |= failed
        self.open_at_end |= failed
        self._fails = True
        self.note()

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Forget the batch entries in the mask, here and in the monitors; without a mask, all."""
        chosen = self._mask(mask)
        batches, functions = self._found
        functions.reset(batches, chosen)
        functions.forget(chosen, *self._arrays())
        self.open_at_end &= False if chosen is None else ~chosen
        self._fails = self._fails and chosen is not None

    def least(self, value: EntryValue) -> Floats:
        """Return the minimum of a value over the monitors; the upper bound of a failure is -0.0."""
        batches, functions = self._found
        return functions.least(
            batches, value, self.failed if self._fails and value == "upper" else None
        )

    def outcomes(self, entries: NDArray[np.int64] | None = None) -> BatchOutcomes:
        """Return the outcomes of the episodes so far in batch entries, by default in all."""
        batches, functions = self._found
        return functions.outcomes(batches, self._numbers(entries), self.failed, self.settled_at)

    def spread(self, columns: Sequence[EntryColumn], entries: NDArray[np.int64]) -> None:
        """Write arrays of the batch, and masks, into dictionaries, from values of some entries.

        Args:
            columns: For each key ``(place, key, mask_key, values, there)``: the dictionary, or for
                values of two dimensions a list of dictionaries; the key of the array, which is 0
                (None for objects) without an element; the key of the mask of its elements; the
                values, with entries as the last dimension; and which of them exist, None for all.
            entries: The numbers of the entries, each once.

        Example:
            >>> log = VerdictLog([VectorEpisodeMonitor("always(x < 1)", 4)])
            >>> info: dict[str, Any] = {}
            >>> known = np.array([True, False])
            >>> column = info, "at", "_at", np.array([7, 8]), known
            >>> log.spread([column], np.array([1, 3]))
            >>> info
            {'at': array([0, 7, 0, 0]), '_at': array([False,  True, False, False])}
        """
        self._found[1].spread([*columns], self._numbers(entries), self.num)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_found"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._found = self._batches()
        # Machines refuse unpickled arrays, because these have copies of the dtypes.
        for name in ("settled_at", "open_at_end", "violated", "failed", "first", "violated_at"):
            unpickled = state[name]
            array = np.empty(unpickled.shape, unpickled.dtype.type)
            array[...] = unpickled
            setattr(self, name, array)

    def _arrays(
        self,
    ) -> tuple[NDArray[np.int64], Entries, Entries, NDArray[np.int64], NDArray[np.int64]]:
        return self.settled_at, self.violated, self.failed, self.first, self.violated_at

    def _batches(self) -> tuple[tuple[EpisodeBatch, ...], VerdictLogFunctions]:
        """Return the machines of the monitors, and the fastest functions for them."""
        batches = tuple([monitor._machine for monitor in self.monitors])  # noqa: SLF001 - one room
        return batches, logs_of(batches)

    def _numbers(self, entries: NDArray[np.int64] | None) -> NDArray[np.int64]:
        if entries is None:
            return np.arange(self.num)
        return np.ascontiguousarray(entries, np.int64)

    def _mask(self, mask: ArrayLike | None) -> Entries | None:
        if mask is None:
            return None
        if type(mask) is np.ndarray and mask.dtype == np.bool_ and mask.shape == (self.num,):
            # Machines refuse an unpickled mask, because it has a copy of the dtype.
            return np.ascontiguousarray(mask if mask.dtype is _FLAGS else mask.astype(_FLAGS))
        return BatchReader(self.monitors[0].program, self.num, "raise").mask(mask)


JointRead = int | str | tuple[int, ...] | tuple[Floats, int] | Callable[..., float]
"""The source of a number of a sample: a key of the first argument, an array and the index of an
element, or a function."""


class JointFeed(Protocol):
    """Several monitors on the same samples; returned by `joint_feed`."""

    def feed(self, *args: object) -> tuple[float, float, float]:
        """Update all monitors; return the minimum robustness, lower and upper bound."""

    def take(self, *args: object) -> None:
        """Update all monitors without computing the numbers of `look`."""

    def look(self) -> tuple[float, float, float]:
        """Return the numbers of `feed` for the samples so far."""


def joint_feed(
    monitors: Sequence[EpisodeMonitor],
    names: Sequence[str],
    reads: Sequence[JointRead],
    *,
    decided: Callable[[int], object] | None = None,
    seen: Callable[[list[float]], object] | None = None,
    number: type[float] = float,
) -> JointFeed | None:
    """Return an object that updates several C++ monitors in one call, or None.

    None if a monitor runs in Python or stores a history: then update one after the other. After an
    error, the monitors before the one with the error are updated.

    ``names`` are the numbers of a sample, ``reads`` their sources in the arguments of ``feed``.
    ``decided`` is called after a sample with the number of decided verdicts, unless it is 0, then
    ``seen`` with the numbers. ``number`` is the class of returned numbers.
    """
    make = BACKENDS[monitors[0].backend].episode_monitor_set if monitors else None
    machines = [monitor.fed_machine for monitor in monitors]
    if make is None or None in machines:
        return None
    places = [[names.index(name) for name in monitor.variables] for monitor in monitors]
    feed: JointFeed | None = make(machines, places, list(reads), decided, seen, number)
    return feed
