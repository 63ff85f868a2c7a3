"""The monitors of one specification: of the episode, or with ``view="step"`` of every instant."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

import rtamt
from rtamt import InputError, RtamtError
from rtamt.errors import Argument
from rtamt_gym.judging.first_sample import first_sample_error
from rtamt_gym.options.evaluation import Reading

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Floats, Lanes

__all__ = [
    "InstantMonitor",
    "VectorInstantMonitor",
    "machine_state",
    "make_monitors",
    "require_known",
]


class InstantMonitor:
    """The robustness of a formula at every instant, and a judge of ``always(formula)``.

    Attributes:
        robustness: The robustness at the newest instant whose horizon has passed; before the first
            such instant, the robustness of the samples so far.
        judge: Gives bounds and verdict of ``always(formula)`` over the same samples.
    """

    def __init__(
        self,
        spec: rtamt.Specification,
        *,
        history: bool = False,
        **options: Any,  # noqa: ANN401 - of `rtamt.EpisodeMonitor`
    ) -> None:
        self._instant = rtamt.Monitor(spec, **options)
        self._sofar = rtamt.EpisodeMonitor(spec, **options)
        self.judge = rtamt.EpisodeMonitor(spec.always(), history=history, **options)
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
        for monitor in self._parts():
            monitor.reset()

    def state(self) -> tuple[Any, ...]:
        return [machine_state(monitor) for monitor in self._parts()], self.robustness

    def restore(self, state: tuple[Any, ...]) -> None:
        states, self.robustness = state
        for monitor, held in zip(self._parts(), states, strict=True):
            monitor.__setstate__(held)

    def _parts(self) -> list[rtamt.Monitor | rtamt.EpisodeMonitor]:
        return [self._instant, self._sofar, self.judge]


class VectorInstantMonitor:
    """The vector twin of `InstantMonitor`: its numbers are arrays, one element an environment."""

    def __init__(
        self,
        spec: rtamt.Specification,
        num: int,
        **options: Any,  # noqa: ANN401 - of `rtamt.EpisodeMonitor`
    ) -> None:
        self._instant = rtamt.VectorMonitor(spec, num, **options)
        self._sofar = rtamt.VectorEpisodeMonitor(spec, num, **options)
        self.judge = rtamt.VectorEpisodeMonitor(spec.always(), num, **options)
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
    """The state of a monitor, for ``__setstate__`` of one of the same specification."""
    return monitor.__reduce__()[2]


def require_known(reading: Reading, asked: Argument) -> None:
    """Refuses what needs robustness of instants where samples may be unknown.

    Args:
        reading: How samples are judged.
        asked: What needs it.

    Raises:
        InputError: If samples may be unknown.
    """
    if reading.nan == "unknown":
        raise InputError(
            Argument("nan", "unknown"),
            " leaves a robustness between two bounds, and ",
            asked,
            " needs that of every instant; expected ",
            Argument("nan", "raise"),
            " or ",
            Argument("nan", "hold"),
            " with it",
        )


def make_monitors(
    specs: Mapping[str, rtamt.Specification],
    reading: Reading,
    of_episode: Callable[..., Any],
    of_instants: Callable[..., Any],
) -> dict[str, tuple[Any, Any]]:
    """Makes the monitors of each specification: ``(robustness source, judge)``.

    The source is fed, and gives the robustness; the judge gives bounds and verdict of the episode,
    and is the source itself or fed by it.

    Args:
        specs: Specifications by name.
        reading: How samples are judged.
        of_episode: Makes the monitor of a specification for ``view="episode"``.
        of_instants: Makes the monitor of a specification for ``view="step"``.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, if the formula speaks of
            the first sample only and ``view`` is ``"episode"``, or if its future has no bound and
            ``view`` is ``"step"``.
        InputError: If the inputs and outputs do not fit; a note names the specification if there
            are several.
    """
    monitors: dict[str, tuple[Any, Any]] = {}
    view = reading.view
    if view == "step":
        require_known(reading, Argument("view", "step"))
    for name, options in reading.of_monitors(specs).items():
        spec = specs[name]
        if view == "episode" and not spec.looks_ahead:  # the first sample judges no episode
            raise first_sample_error(f"specification {name!r}", spec, Argument("view", "step"))
        make = of_instants if view == "step" else of_episode
        try:
            source = make(spec, **options)
        except RtamtError as error:
            if len(specs) > 1:
                error.add_note(f"in specification {name!r}")
            raise
        monitors[name] = source, source.judge if view == "step" else source
    return monitors
