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
from rtamt_gym.signals.signals import Read

__all__ = ["Assessment", "Feed", "Panel"]

Assessment = tuple[float, float, float]
"""Robustness of the samples so far, and the lower and upper bound of what it can become."""

Feed = Callable[..., Assessment]
"""Feeds one sample to the monitors of a panel; takes the arguments of a `Read`."""


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

    def read(self) -> Assessment:
        """Least robustness, lower and upper bound, of the samples so far."""
        if len(self._monitors) == 1:
            ((_, monitor, judge),) = self._monitors
            return monitor.robustness, judge.lower, judge.upper
        return self.robustness, self.lower, self.upper

    def feeder(
        self,
        names: Sequence[str],
        reads: Sequence[Read] | None = None,
        *,
        decide: Callable[[], None] | None = None,
        curves: Sequence[list[Assessment]] | None = None,
    ) -> Feed:
        """Makes the function that feeds one sample to all monitors.

        It takes the arguments of a `Read`, and returns the least robustness and the least lower and
        upper bound over the specifications.

        Args:
            names: Names of the signals, the variables of all specifications among them.
            reads: What reads each signal; None: the first argument is the sample itself, with a
                value for each signal.
            decide: Called after a sample that has decided a verdict, in place of `note`.
            curves: For each specification a list, which gets the three numbers of every sample.
        """
        note = decide or self.note
        if len(self._monitors) == 1 and reads is not None and len(reads) == 1 and curves is None:
            return self._feeder_of_one(reads[0], note)
        parts = self._parts(names, curves)

        def feed(*step: Any) -> Assessment:  # noqa: ANN401
            values = step[0] if reads is None else [read(*step) for read in reads]
            robustness = lower = upper = math.inf
            decided = 0
            for update, alone, pick, bounds, keep in parts:
                value = update(*pick(values)) if alone is None else update(values[alone])
                low, high = bounds()
                if keep is not None:
                    keep((value, low, high))
                if high < 0.0 or low > 0.0:
                    decided += 1
                # Calls of min() would cost as much as all the rest.
                if value < robustness:  # noqa: PLR1730
                    robustness = value
                if low < lower:  # noqa: PLR1730
                    lower = low
                if high < upper:  # noqa: PLR1730
                    upper = high
            if decided > self.settled:
                note()
            return robustness, lower, upper

        return feed

    def _feeder_of_one(self, read: Read, note: Callable[[], None]) -> Feed:
        """The `feeder` of one signal for one monitor, the common case: without lists and loops."""
        ((_, monitor, judge),) = self._monitors
        update, bounds = monitor.update, judge.bounds

        def feed(
            obs: Any = None,  # noqa: ANN401
            action: Any = None,  # noqa: ANN401
            reward: Any = None,  # noqa: ANN401
            info: Any = None,  # noqa: ANN401
        ) -> Assessment:
            robustness = update(read(obs, action, reward, info))
            lower, upper = bounds()
            if (upper < 0.0 or lower > 0.0) and not self.settled:
                note()
            return robustness, lower, upper

        return feed

    def _parts(
        self, names: Sequence[str], curves: Sequence[list[Assessment]] | None
    ) -> list[tuple[Any, ...]]:
        """What `feeder` needs of each specification."""
        parts: list[tuple[Any, ...]] = []
        for place, (name, monitor, judge) in enumerate(self._monitors):
            indices = tuple(names.index(variable) for variable in self.variables[name])
            alone = indices[0] if len(indices) == 1 else None
            keep = None if curves is None else curves[place].append
            parts.append((monitor.update, alone, _pick(indices), judge.bounds, keep))
        return parts

    def reset(self) -> None:
        """Forgets every sample."""
        for _, monitor, _ in self._monitors:
            monitor.reset()
        self._decided = {}
        self.settled = 0
        self.violated_by = None

    def note(self) -> None:
        """Records the verdicts that the last sample, or the end of the trace, has decided."""
        for name, _, judge in self._monitors:
            if judge.verdict != 0 and name not in self._decided:
                self._decided[name] = judge.samples - 1
                if judge.verdict < 0 and self.violated_by is None:
                    self.violated_by = name
        self.settled = len(self._decided)

    def finish(self) -> tuple[float, float]:
        """Ends the trace, which settles the bounds; returns the least of each."""
        for _, _, judge in self._monitors:
            judge.finish()
        self.note()
        return self.lower, self.upper

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


def _pick(indices: tuple[int, ...]) -> Callable[[Sequence[float]], tuple[float, ...]]:
    """The function that takes the elements at some indices."""
    if len(indices) > 1:
        return itemgetter(*indices)
    return lambda values: tuple(values[index] for index in indices)
