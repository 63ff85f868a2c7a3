"""The monitors of several specifications, fed together, and what they have decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import rtamt
from rtamt import EpisodeMonitor
from rtamt_gym.episodes import outcome
from rtamt_gym.signals import Read
from rtamt_gym.specs import InstantMonitor, Sample, View, machine_state, make_monitor, sampler

__all__ = ["Panel"]


class Panel:
    """A panel of judges: a monitor for every specification.

    The lockstep of a vector environment, `rtamt_gym.lockstep.Lockstep`, is its vector version.

    Attributes:
        variables: By specification, the names of what it reads.
        settled: How many verdicts are decided.
        violated_by: The specification that was violated first; None while none is.

    Args:
        specs: By name.
        period: Time between samples.
        view: Whether formulas speak of the episode or of every instant.

    Raises:
        SpecificationError: As `rtamt_gym.specs.make_monitor` does.
    """

    def __init__(
        self, specs: Mapping[str, rtamt.Specification], period: float | str | None, view: View
    ) -> None:
        self.variables = {name: spec.variables for name, spec in specs.items()}
        self._monitors = [
            (name, *make_monitor(name, spec, period, view)) for name, spec in specs.items()
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

    def sampler(self, names: Sequence[str], reads: Sequence[Read]) -> Sample:
        """The function that reads signals of these names and feeds all monitors."""
        feeds = [
            (monitor.update, self.variables[name], judge) for name, monitor, judge in self._monitors
        ]
        return sampler(names, reads, feeds)

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
        judges = [judge for _, _, judge in self._monitors]
        for judge in judges:
            judge.finish()
        return (
            min(judge.lower for judge in judges),
            min(judge.upper for judge in judges),
            sum(judge.verdict != 0 for judge in judges),
        )

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
        return monitors, dict(self._decided), self.violated_by

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state` of a panel of the same specifications."""
        monitors, decided, self.violated_by = state
        for (_, monitor, _), held in zip(self._monitors, monitors, strict=True):
            if isinstance(monitor, InstantMonitor):
                monitor.restore(held)
            else:
                monitor.__setstate__(held)
        self._decided = dict(decided)
        self.settled = len(self._decided)
