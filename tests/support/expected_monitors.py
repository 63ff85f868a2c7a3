"""The Python monitors that an exported monitor must equal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import rtamt
from rtamt import EpisodeMonitor, Monitor, SpecificationError
from rtamt.monitors.options import Spec


def _judge(spec: Spec, period: float, **options: Any) -> Monitor | EpisodeMonitor:  # noqa: ANN401
    """Return a monitor of a named formula; of episodes if no online monitor can run it."""
    try:
        return Monitor(spec, period, **options)
    except SpecificationError:
        return EpisodeMonitor(spec, period, **options)


class Expected:
    """The Python monitors of the episode and of the named formulas.

    Args:
        spec: The exported specification. *parts: The named formulas.
        period: Seconds between samples. **options: The options of `EpisodeMonitor`.
    """

    def __init__(self, spec: Spec, *parts: Spec, period: float = 1, **options: Any) -> None:  # noqa: ANN401
        options = {"backend": "python", **options}
        self.episode = EpisodeMonitor(spec, period, **options)
        self._monitors = [_judge(part, period, **options) for part in parts]
        self._last = [math.nan] * len(parts)

    @property
    def named(self) -> int:
        """The number of named formulas."""
        return len(self._monitors)

    @property
    def names(self) -> tuple[str, ...]:
        """The variables of the episode."""
        return self.episode.variables

    def update(self, values: Mapping[str, float]) -> None:
        self._last = [
            monitor.update({name: values[name] for name in monitor.variables})
            for monitor in self._monitors
        ]
        self.episode.update(values)

    @property
    def values(self) -> list[float]:
        """Return robustness, bounds and verdict, and the named formulas."""
        e = self.episode
        return [e.robustness, e.lower, e.upper, float(e.verdict), *self._last]


class DenseExpected:
    """The Python monitors in dense time of the episode and of the named formulas.

    Args:
        spec: The exported specification. *parts: The named formulas. **options: The options of
            `rtamt.dense.EpisodeMonitor`.
    """

    def __init__(self, spec: Spec, *parts: Spec, **options: Any) -> None:  # noqa: ANN401
        options = {"backend": "python", **options}
        self.episode = rtamt.dense.EpisodeMonitor(spec, **options)
        self._monitors: list[rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor] = []
        for part in parts:
            try:
                self._monitors.append(rtamt.dense.Monitor(part, **options))
            except SpecificationError:
                self._monitors.append(rtamt.dense.EpisodeMonitor(part, **options))

    @property
    def names(self) -> tuple[str, ...]:
        """The variables of the episode."""
        return self.episode.variables

    def update(self, time: float, values: Mapping[str, float]) -> None:
        """Update all variables with an event."""
        for monitor in (*self._monitors, self.episode):
            monitor.update({name: [(time, values[name])] for name in monitor.variables})

    @property
    def values(self) -> list[float]:
        """Return robustness, bounds and verdict, and the named formulas."""
        e = self.episode
        named = [
            m.robustness if isinstance(m, rtamt.dense.EpisodeMonitor) else [*m.values.values()][-1]
            for m in self._monitors
        ]
        return [e.robustness, e.lower, e.upper, float(e.verdict), *named]
