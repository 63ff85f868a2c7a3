"""The environments of a vector environment that a live view shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rtamt import InputError
from rtamt_gym.judging.vector_monitor_set import VectorMonitorSet
from rtamt_gym.signals.columns import Entries, Floats

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView


class VectorTracks:
    """The tracks of the environments that a view shows.

    Args:
        live: The view.
        signals: The names of the columns of the tables.
        requirements: The names of the requirements.
        period: Seconds between samples; None if they have no time.
        num: The number of environments.
        render: Returns a picture of each environment.

    Raises:
        InputError: If the view shows an environment that does not exist.
    """

    def __init__(
        self,
        live: RerunView,
        signals: Sequence[str],
        requirements: Sequence[str],
        period: float | None,
        num: int,
        render: Callable[[], Any],
    ) -> None:
        for index in live.environments:
            if index not in range(num):
                raise InputError(
                    f"RerunView(environments=) has an environment {index!r}, but they are 0 to "
                    f"{num - 1}"
                )
        self._requirements = requirements
        self._render, self._every = render, live.pictures
        self._tracks: dict[int, Track] = {
            index: live.track(signals, requirements, period, f"environment {index}")
            for index in live.environments
        }
        if live.pictures is not None:
            for track in self._tracks.values():
                track.draw(None, live.pictures)

    def shows(self, entries: Entries) -> bool:
        """Return whether an environment of the mask is shown."""
        return any(entries[index] for index in self._tracks)

    def reset(self, table: Floats, monitor_set: VectorMonitorSet, entries: Entries | None) -> None:
        """Start episodes with sample 0 in the environments of the mask; None: in all."""
        for index, track in self._tracks.items():
            if entries is None or entries[index]:
                track.begin()
                self._add(index, table, monitor_set)
        self._draw([index for index in self._tracks if entries is None or entries[index]])

    def step(
        self,
        table: Floats,
        monitor_set: VectorMonitorSet,
        begun: Entries | None,
        resets: Entries | None,
    ) -> None:
        """Take a sample of every environment.

        Args:
            table: The values of the signals.
            monitor_set: The monitors.
            begun: The environments that the step has reset before; None: none.
            resets: The environments that the step has reset after the samples, and that render
                other samples; None: none.
        """
        for index, track in self._tracks.items():
            if begun is not None and begun[index]:
                track.begin()
            self._add(index, table, monitor_set)
        self._draw([index for index in self._tracks if resets is None or not resets[index]])

    def end(self, monitor_set: VectorMonitorSet, entries: Entries) -> None:
        """End the episodes in the environments of the mask."""
        for index, track in self._tracks.items():
            if entries[index]:
                track.finish(*monitor_set.values_at(index))

    def _add(self, index: int, table: Floats, monitor_set: VectorMonitorSet) -> None:
        self._tracks[index].add(table[index].tolist(), *monitor_set.values_at(index))

    def _draw(self, indexes: Sequence[int]) -> None:
        """Take the pictures of environments whose sample has one."""
        every = self._every
        if every is None:
            return
        due = [index for index in indexes if not (self._tracks[index].samples - 1) % every]
        frames: Any = self._render() if due else None
        for index in due if frames is not None else ():
            if frames[index] is not None:
                self._tracks[index].picture(frames[index])
