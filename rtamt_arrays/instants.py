"""The robustness of a formula at every instant, on arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from rtamt import Specification
from rtamt.typing import Align, Period
from rtamt_arrays.monitors import ArrayMonitors
from rtamt_arrays.online import OnlineReading, OnlineState
from rtamt_arrays.operations import Operations, Tensor
from rtamt_arrays.worlds import EpisodeState

__all__ = ["ArrayInstants", "InstantState"]


class InstantState(NamedTuple):
    """What is known of the instants of each lane.

    Attributes:
        newest: The state of the monitor of single instants.
        sofar: That of the monitor of the samples so far, whose robustness stands for that of the
            first instant until it is known.
    """

    newest: OnlineState
    sofar: EpisodeState


class ArrayInstants:
    """`rtamt_gym.judging.monitors.VectorInstantMonitor` as pure functions of arrays.

    Args:
        monitors: Makes the monitors.
        operations: The operations of the array library.
        spec: The specification.
        period: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`.

    Attributes:
        judge: Gives bounds and verdict of ``always(formula)`` over the same samples.

    Raises:
        SpecificationError: As `rtamt.Monitor` does.
    """

    def __init__(
        self,
        monitors: ArrayMonitors,
        operations: Operations,
        spec: Specification,
        period: Period | None,
        align: Align | None,
    ) -> None:
        self._o = operations
        self._newest = monitors.online(spec, period, align=align)
        self._sofar = monitors.episode(spec, period, align=align)
        self.judge = monitors.episode(spec.always(), period, align=align)

    def init(self, lanes: int) -> InstantState:
        """The state before the first sample."""
        return InstantState(self._newest.init(lanes), self._sofar.init(lanes))

    def reset(self, state: InstantState, mask: Tensor) -> InstantState:
        """Return the state in which the lanes of the mask have not taken a sample."""
        return InstantState(
            self._newest.reset(state.newest, mask), self._sofar.reset(state.sofar, mask)
        )

    def begin(
        self, state: InstantState, sample: Mapping[str, Tensor], mask: Tensor
    ) -> tuple[InstantState, Tensor]:
        """Lanes of the mask begin with a sample; gives its robustness."""
        newest, reading = self._newest.begin(state.newest, sample, mask)
        sofar, of_first = self._sofar.begin(state.sofar, sample, mask)
        return InstantState(newest, sofar), self._known(reading, of_first.robustness)

    def update(
        self, state: InstantState, sample: Mapping[str, Tensor]
    ) -> tuple[InstantState, Tensor]:
        """Every lane takes a sample; gives the robustness of the newest instant that is known."""
        newest, reading = self._newest.update(state.newest, sample)
        sofar, of_first = self._sofar.update(state.sofar, sample)
        return InstantState(newest, sofar), self._known(reading, of_first.robustness)

    def _known(self, reading: OnlineReading, sofar: Tensor) -> Tensor:
        return self._o.where(self._o.isnan(reading.robustness), sofar, reading.robustness)
