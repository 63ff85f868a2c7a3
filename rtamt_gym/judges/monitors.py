"""The monitors of one specification: of the episode, or with ``view="step"`` of every instant."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import rtamt
from rtamt import SpecificationError
from rtamt_gym.judges.specs import Nan, View
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = [
    "InstantMonitor",
    "VectorInstantMonitor",
    "machine_state",
    "make_monitor",
    "make_vector_monitor",
]

Period = float | str | None


class InstantMonitor:
    """The robustness of instant after instant, and a judge of ``always(formula)``.

    Attributes:
        robustness: That of the newest instant whose horizon has passed; before the first, that of
            the samples so far.
        judge: Gives bounds and verdict of ``always(formula)``, of the same samples.
    """

    def __init__(self, spec: rtamt.Specification, period: Period, nan: Nan) -> None:
        self._instant = rtamt.Monitor(spec, period=period, nan=nan)
        self._sofar = rtamt.EpisodeMonitor(spec, period=period, nan=nan)
        self.judge = rtamt.EpisodeMonitor(spec.always(), period=period, nan=nan)
        self.robustness = math.nan

    def update(self, *values: float) -> float:
        """Feeds one sample; returns the robustness."""
        robustness = self._instant.update(*values)
        self.judge.update(*values)
        if math.isnan(robustness):
            robustness = self._sofar.update(*values)
        self.robustness = robustness
        return robustness

    def reset(self) -> None:
        """Forgets every sample."""
        for monitor in self._parts():
            monitor.reset()

    def state(self) -> tuple[Any, ...]:
        """What `restore` takes."""
        return [machine_state(monitor) for monitor in self._parts()], self.robustness

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state`."""
        states, self.robustness = state
        for monitor, held in zip(self._parts(), states, strict=True):
            monitor.__setstate__(held)

    def _parts(self) -> list[rtamt.Monitor | rtamt.EpisodeMonitor]:
        return [self._instant, self._sofar, self.judge]


class VectorInstantMonitor:
    """The vector twin of `InstantMonitor`: its numbers are arrays, one element an environment."""

    def __init__(self, spec: rtamt.Specification, num: int, period: Period, nan: Nan) -> None:
        self._instant = rtamt.VectorMonitor(spec, num, period, nan=nan)
        self._sofar = rtamt.VectorEpisodeMonitor(spec, num, period, nan=nan)
        self.judge = rtamt.VectorEpisodeMonitor(spec.always(), num, period, nan=nan)
        self.robustness = np.full(num, np.nan)

    def update(self, values: Floats, mask: Lanes | None = None) -> Floats:
        """Feeds one sample to the environments of the mask; returns the robustness."""
        robustness = self._instant.update(values, mask)
        self.judge.update(values, mask)
        early = np.isnan(robustness)
        if early.any():
            fed = early if mask is None else early & mask
            robustness = np.where(early, self._sofar.update(values, fed), robustness)
        self.robustness = robustness
        return robustness

    def reset(self, mask: Lanes | None = None) -> None:
        """Forgets every sample of the environments of the mask; None: of all."""
        for monitor in (self._instant, self._sofar, self.judge):
            monitor.reset(mask)


def machine_state(monitor: rtamt.Monitor | rtamt.EpisodeMonitor) -> Any:  # noqa: ANN401 - opaque
    """What ``__setstate__`` of a monitor of the same specification takes."""
    return monitor.__reduce__()[2]


def make_monitor(
    name: str, spec: rtamt.Specification, period: Period, view: View, nan: Nan
) -> tuple[rtamt.EpisodeMonitor | InstantMonitor, rtamt.EpisodeMonitor]:
    """The monitors of a specification: ``(robustness source, judge)``.

    The source is fed, and gives the robustness; the judge gives bounds and verdict of the episode,
    and is the source itself or fed by it.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, if the formula speaks of
            the first sample only and ``view`` is ``"episode"``, or if its future has no bound and
            ``view`` is ``"step"``.
    """
    if view == "step":
        source = InstantMonitor(spec, period, nan)
        return source, source.judge
    _check_looks_ahead(name, spec)
    judge = rtamt.EpisodeMonitor(spec, period=period, nan=nan)
    return judge, judge


def make_vector_monitor(
    name: str, spec: rtamt.Specification, num: int, period: Period, view: View, nan: Nan
) -> tuple[rtamt.VectorEpisodeMonitor | VectorInstantMonitor, rtamt.VectorEpisodeMonitor]:
    """The monitors of a specification in ``num`` environments, as `make_monitor` has them.

    Raises:
        SpecificationError: As `make_monitor` does.
    """
    if view == "step":
        source = VectorInstantMonitor(spec, num, period, nan)
        return source, source.judge
    _check_looks_ahead(name, spec)
    judge = rtamt.VectorEpisodeMonitor(spec, num, period, nan=nan)
    return judge, judge


def _check_looks_ahead(name: str, spec: rtamt.Specification) -> None:
    """Refuses a formula that the first sample alone decides: no episode can be judged by it."""
    if not spec.looks_ahead:
        raise SpecificationError(
            f"specification {name!r} speaks of the first sample only: {spec.formula}; "
            f"write always({spec.formula}) or view='step'"
        )
