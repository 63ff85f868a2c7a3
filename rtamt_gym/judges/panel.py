"""The monitors of several specifications, fed together, and what they have decided."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from operator import itemgetter
from typing import Any

import rtamt
from rtamt import EpisodeMonitor, InputError
from rtamt_gym.judges.episodes import outcome
from rtamt_gym.judges.specs import InstantMonitor, Nan, View, machine_state, make_monitor
from rtamt_gym.signals.signals import Number, Read

__all__ = ["Panel", "Sample", "pick"]

Sample = Callable[[Any, Any, Any, dict[str, Any]], tuple[float, float, float, int]]
"""Feeds what a step gives; least robustness, lower and upper bound, and verdicts decided."""


class Panel:
    """A panel of judges: a monitor for every specification.

    `rtamt_gym.judges.vector_panel.Lockstep` is its vector version.

    Attributes:
        variables: By specification, the names of what it reads.
        settled: How many verdicts are decided.
        violated_by: The specification that was violated first; None while none is.

    Args:
        specs: By name.
        period: Time between samples.
        view: Whether formulas speak of the episode or of every instant.
        nan: Whether a signal that is nan is refused, or keeps its last value.

    Raises:
        SpecificationError: As `rtamt_gym.judges.specs.make_monitor` does.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        period: float | str | None,
        view: View,
        nan: Nan = "raise",
    ) -> None:
        self.variables = {name: spec.variables for name, spec in specs.items()}
        self._described = {name: str(spec.formula) for name, spec in specs.items()}
        self._monitors = [
            (name, *make_monitor(name, spec, period, view, nan)) for name, spec in specs.items()
        ]
        self._decided: dict[str, int] = {}
        self.settled = 0
        self.violated_by: str | None = None

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None where bounds count samples."""
        return self._monitors[0][2].period

    @property
    def samples(self) -> int:
        """Samples fed since the reset."""
        return self._monitors[0][2].samples

    @property
    def monitors(self) -> dict[str, tuple[EpisodeMonitor | InstantMonitor, EpisodeMonitor]]:
        """Of every specification, what says the robustness and who judges the episode."""
        return {name: (monitor, judge) for name, monitor, judge in self._monitors}

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation; None while there is none."""
        return None if self.violated_by is None else self._decided[self.violated_by]

    @property
    def all_decided(self) -> bool:
        """Whether no verdict is open."""
        return self.settled == len(self._monitors)

    @property
    def robustness(self) -> float:
        """The least robustness over the specifications; nan before the first sample."""
        return min(monitor.robustness for _, monitor, _ in self._monitors)

    @property
    def lower(self) -> float:
        """The least that it can still become."""
        return min(judge.lower for _, _, judge in self._monitors)

    @property
    def upper(self) -> float:
        """The greatest that it can still become."""
        return min(judge.upper for _, _, judge in self._monitors)

    def read(self) -> tuple[float, float, float, int]:
        """Least robustness, lower and upper bound, and verdicts decided, of the samples so far."""
        if len(self._monitors) == 1:
            ((_, monitor, judge),) = self._monitors
            return monitor.robustness, judge.lower, judge.upper, self.settled
        return self.robustness, self.lower, self.upper, self.settled

    def sampler(self, names: Sequence[str], reads: Sequence[Read]) -> Sample:
        """The function that reads a step once and feeds all monitors.

        Most of the time that monitoring takes is spent here and in `feeder`, so the common case,
        one signal for one monitor, has a way of its own in both.
        """
        if len(self._monitors) == len(reads) == 1:
            (read,), ((_, monitor, judge),) = reads, self._monitors
            update, bounds = monitor.update, judge.bounds

            def sample(
                obs: Any,  # noqa: ANN401
                action: Any,  # noqa: ANN401
                reward: Any,  # noqa: ANN401
                info: dict[str, Any],
            ) -> tuple[float, float, float, int]:
                robustness = update(read(obs, action, reward, info))
                lower, upper = bounds()
                return robustness, lower, upper, upper < 0.0 or lower > 0.0

            return sample

        feed = self._feed_all(names)
        return lambda obs, action, reward, info: feed(
            [read(obs, action, reward, info) for read in reads]
        )

    def feeder(
        self, names: Sequence[str], reads: Sequence[Number], decide: Callable[[], None]
    ) -> Number:
        """The function that reads a simulation once, feeds all monitors, and gives the robustness.

        Args:
            names: Of the signals.
            reads: What reads them.
            decide: Called after a sample that has decided a verdict; must call `note`.
        """
        if len(self._monitors) == len(reads) == 1:
            (read,), ((_, monitor, judge),) = reads, self._monitors
            update, bounds = monitor.update, judge.bounds

            def feed() -> float:
                robustness = update(read())
                if not self.settled:
                    lower, upper = bounds()
                    if upper < 0.0 or lower > 0.0:
                        decide()
                return robustness

            return feed

        feed_all = self._feed_all(names)

        def feed_each() -> float:
            robustness, _, _, decided = feed_all([read() for read in reads])
            if decided > self.settled:
                decide()
            return robustness

        return feed_each

    def _feed_all(
        self, names: Sequence[str]
    ) -> Callable[[list[float]], tuple[float, float, float, int]]:
        picks = [
            (
                monitor.update,
                indices[0] if len(indices) == 1 else None,
                pick(indices),
                judge.bounds,
            )
            for name, monitor, judge in self._monitors
            for indices in [tuple(names.index(variable) for variable in self.variables[name])]
        ]

        def feed(values: list[float]) -> tuple[float, float, float, int]:
            robustness = lower = upper = math.inf
            decided = 0
            for update, index, picked, bounds in picks:
                value = update(*picked(values)) if index is None else update(values[index])
                low, high = bounds()
                if high < 0.0 or low > 0.0:
                    decided += 1
                # Calls of min() would cost as much as all the rest.
                if value < robustness:  # noqa: PLR1730
                    robustness = value
                if low < lower:  # noqa: PLR1730
                    lower = low
                if high < upper:  # noqa: PLR1730
                    upper = high
            return robustness, lower, upper, decided

        return feed

    def reset(self) -> None:
        """Forgets every sample."""
        for _, monitor, _ in self._monitors:
            monitor.reset()
        self._decided = {}
        self.settled = 0
        self.violated_by = None

    def note(self) -> None:
        """Notes the verdicts that the last sample, or the end of the trace, has decided."""
        for name, _, judge in self._monitors:
            if judge.verdict != 0 and name not in self._decided:
                self._decided[name] = judge.samples - 1
                if judge.verdict < 0 and self.violated_by is None:
                    self.violated_by = name
        self.settled = len(self._decided)

    def finish(self) -> tuple[float, float, int]:
        """Ends the trace; the bounds, and how many verdicts are decided."""
        for _, _, judge in self._monitors:
            judge.finish()
        return self.lower, self.upper, sum(judge.verdict != 0 for _, _, judge in self._monitors)

    def describe(self) -> dict[str, dict[str, Any]]:
        """The state of every specification."""
        return {
            name: {
                "robustness": monitor.robustness,
                "lower": judge.lower,
                "upper": judge.upper,
                "verdict": judge.verdict.name,
            }
            for name, monitor, judge in self._monitors
        }

    def outcomes(self) -> dict[str, dict[str, Any]]:
        """What became of every specification so far."""
        return {
            name: outcome(judge.robustness, judge.verdict.name, self._decided.get(name))
            for name, _, judge in self._monitors
        }

    def state(self) -> tuple[Any, ...]:
        """What `restore` takes; small, and fit for pickle."""
        monitors = [
            monitor.state() if isinstance(monitor, InstantMonitor) else machine_state(monitor)
            for _, monitor, _ in self._monitors
        ]
        return self._described, monitors, dict(self._decided), self.violated_by

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state` of a panel of the same specifications.

        Raises:
            InputError: If they are others.
        """
        described, monitors, decided, violated_by = state
        if described != self._described:
            raise InputError(
                f"expected a state of the specifications {self._described}, got one of {described}"
            )
        for (_, monitor, _), held in zip(self._monitors, monitors, strict=True):
            if isinstance(monitor, InstantMonitor):
                monitor.restore(held)
            else:
                monitor.__setstate__(held)
        self._decided = dict(decided)
        self.settled = len(self._decided)
        self.violated_by = violated_by


def pick(indices: tuple[int, ...]) -> Callable[[Sequence[float]], tuple[float, ...]]:
    """The function that takes the elements at some indices."""
    if len(indices) > 1:
        return itemgetter(*indices)
    return lambda values: tuple(values[index] for index in indices)
