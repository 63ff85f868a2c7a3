"""What makes the monitors of an array library."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from rtamt import Specification
from rtamt.typing import Align, Period
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.online import OnlineMonitor

__all__ = ["ArrayMonitors", "MakesEpisodes", "MakesOnline"]


class MakesEpisodes(Protocol):
    """The function ``episode`` of an array library."""

    def __call__(
        self, spec: Specification, period: Period | None, *, align: Align | None
    ) -> EpisodeArrays:
        """The monitor of a specification."""


class MakesOnline(Protocol):
    """The function ``online`` of an array library."""

    def __call__(
        self, spec: Specification, period: Period | None, *, align: Align | None
    ) -> OnlineMonitor:
        """The monitor of a specification."""


class ArrayMonitors(NamedTuple):
    """Both functions, for one kind of floats.

    Attributes:
        episode: Makes monitors of episodes.
        online: Makes monitors of every instant.
    """

    episode: MakesEpisodes
    online: MakesOnline
