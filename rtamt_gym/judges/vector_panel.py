"""The monitors of several specifications in many environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import VectorEpisodeMonitor
from rtamt_gym.judges.infos import VERDICTS, outcome, spec_state
from rtamt_gym.judges.interface import Interface
from rtamt_gym.judges.monitors import VectorInstantMonitor, make_monitors
from rtamt_gym.judges.specs import Align, Nan, View
from rtamt_gym.shaping import least
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["MonitorValues", "VectorMonitors", "VectorPanel"]

VectorMonitors = dict[str, tuple[VectorEpisodeMonitor | VectorInstantMonitor, VectorEpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""

Numbers = NDArray[np.integer[Any]]


class MonitorValues(NamedTuple):
    """The values of the monitors after a sample: for each specification an array.

    Attributes:
        robustness: The robustness of the sources.
        judged: The robustness of the judges: that of the whole episode.
        lower: The lower bounds of ``judged``.
        upper: The upper bounds of ``judged``.
        samples: Samples of every environment since its reset.
    """

    robustness: list[Floats]
    judged: list[Floats]
    lower: list[Floats]
    upper: list[Floats]
    samples: NDArray[np.int64]


class VectorPanel:
    """The vector twin of `Panel`: its arrays have an element for every environment.

    Attributes:
        monitors: The monitors of each specification: ``(robustness source, judge)``.
        settled: How many verdicts are decided, in all environments together.
        violated_by: The specification that was violated first; None where none is.
        violated_at: The sample that showed it; -1 where there is none.
        robustness: The least robustness over the specifications.
        lower: The least that the robustness can still become.
        upper: The greatest that the robustness can still become.

    The arguments are those of `Panel`, the number of environments, and the names of the columns of
    the tables that are fed.

    Raises:
        SpecificationError: As `Panel` does.
        InputError: As `Panel` does.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        num: int,
        period: float | str | None,
        view: View,
        nan: Nan,
        columns: Sequence[str],
        interface: Interface,
        align: Align | None = None,
    ) -> None:
        self.monitors: VectorMonitors = make_monitors(
            specs,
            view,
            interface,
            of_episode=partial(VectorEpisodeMonitor, num=num, period=period, nan=nan, align=align),
            of_instants=partial(VectorInstantMonitor, num=num, period=period, nan=nan, align=align),
        )
        self._judges = [judge for _, judge in self.monitors.values()]
        # The columns that each specification reads; None: all of them, in their order.
        picks = [[columns.index(name) for name in spec.variables] for spec in specs.values()]
        self._picks = [None if pick == list(range(len(columns))) else pick for pick in picks]
        # By specification and environment the sample that decided it, -1 while it is open.
        self._decided_at = np.full((len(specs), num), -1)
        self.violated_by = np.full(num, None)
        self.violated_at = np.full(num, -1)
        self.settled = 0
        self.robustness = self.lower = self.upper = np.full(num, np.nan)

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None where bounds count samples."""
        return self._judges[0].period

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples fed since the reset; a fresh array."""
        return self._judges[0].samples

    @property
    def all_decided(self) -> Lanes:
        """For every environment, whether all its verdicts are decided."""
        return np.asarray(np.all(self._decided_at >= 0, axis=0))

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        for source, _ in self.monitors.values():
            source.reset(lanes)
        which = slice(None) if lanes is None else lanes
        self._decided_at[:, which] = -1
        self.violated_by[which] = None
        self.violated_at[which] = -1
        self.settled = int(np.count_nonzero(self._decided_at >= 0))

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all."""
        found = [
            source.update(table if pick is None else table[:, pick], lanes)
            for (source, _), pick in zip(self.monitors.values(), self._picks, strict=True)
        ]
        self.robustness = least(found)
        self.note()

    def note(self) -> None:
        """Reads the bounds, and records the verdicts that they have decided."""
        self.lower = least([judge.lower for judge in self._judges])
        self.upper = least([judge.upper for judge in self._judges])
        verdicts = [judge.verdict for judge in self._judges]
        # Verdicts stay until the reset, so a count says whether one is new.
        settled = 0
        for verdict in verdicts:
            settled += int(np.count_nonzero(verdict))
        if settled == self.settled:
            return
        self.settled = settled
        last = self.samples - 1
        for name, decided_at, verdict in zip(
            self.monitors, self._decided_at, verdicts, strict=True
        ):
            new = np.flatnonzero((verdict != 0) & (decided_at < 0))
            decided_at[new] = last[new]
            first = new[(verdict[new] < 0) & (self.violated_at[new] < 0)]
            self.violated_by[first], self.violated_at[first] = name, last[first]

    def finish(self, lanes: Lanes) -> None:
        """Ends the traces of the environments of the mask, which settles their bounds."""
        for judge in self._judges:
            judge.finish(lanes)
        self.note()

    def values(self) -> MonitorValues:
        """Reads the values of all monitors."""
        return MonitorValues(
            [source.robustness for source, _ in self.monitors.values()],
            [judge.robustness for judge in self._judges],
            [judge.lower for judge in self._judges],
            [judge.upper for judge in self._judges],
            self.samples,
        )

    def describe(self) -> dict[str, dict[str, Any]]:
        """The state of every specification: ``infos["stl"]``."""
        return {
            name: spec_state(source.robustness, judge.lower, judge.upper, VERDICTS[judge.verdict])
            for name, (source, judge) in self.monitors.items()
        }

    def outcomes(self, at: Numbers) -> dict[str, dict[str, Any]]:
        """The outcome of every specification so far, in the environments of these numbers."""
        return {
            name: outcome(judge.robustness[at], judge.verdict[at], decided_at[at])
            for (name, (_, judge)), decided_at in zip(
                self.monitors.items(), self._decided_at, strict=True
            )
        }
