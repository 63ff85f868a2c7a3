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
        violated_by: The specification that was violated first; None where none is.
        violated_at: The sample that showed it; -1 where there is none.
        robustness: The least robustness over the specifications.

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
        self._names = list(self.monitors)
        self._judges = [judge for _, judge in self.monitors.values()]
        self._picks = [
            _pick([columns.index(name) for name in spec.variables]) for spec in specs.values()
        ]
        # By specification and environment the sample that decided it, -1 while it is open; and in
        # how many environments it is decided.
        self._decided_at = np.full((len(specs), num), -1)
        self._decided = [0] * len(specs)
        self.violated_by = np.full(num, None)
        self.violated_at = np.full(num, -1)
        self.robustness = np.full(num, np.nan)
        self._lower: Floats | None = None  # found when they are read
        self._upper: Floats | None = None

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
        if lanes is None:
            self._decided_at[:] = self.violated_at[:] = -1
            self.violated_by[:] = None
            self._decided = [0] * len(self._decided)
            return
        at = lanes.nonzero()[0]
        for k, decided_at in enumerate(self._decided_at):
            self._decided[k] -= int(np.count_nonzero(decided_at[at] >= 0))
            decided_at[at] = -1
        self.violated_by[at] = None
        self.violated_at[at] = -1

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all.

        A table in Fortran's order is read fastest.
        """
        found = [
            source.update(table[:, pick], lanes)
            for (source, _), pick in zip(self.monitors.values(), self._picks, strict=True)
        ]
        self.robustness = least(found)
        self._note()

    def finish(self, lanes: Lanes) -> None:
        """Ends the traces of the environments of the mask, which settles their bounds."""
        at = lanes.nonzero()[0]
        if len(at) == 0:
            return
        self._lower = self._upper = None
        for k, judge in enumerate(self._judges):
            judge.finish(lanes)
            self._record(k, at, judge.verdict[at])

    @property
    def lower(self) -> Floats:
        """The least that the robustness can still become."""
        if self._lower is None:
            self._lower = least([judge.lower for judge in self._judges])
        return self._lower

    @property
    def upper(self) -> Floats:
        """The greatest that the robustness can still become."""
        if self._upper is None:
            self._upper = least([judge.upper for judge in self._judges])
        return self._upper

    def _note(self) -> None:
        """Records the verdicts that have been decided."""
        self._lower = self._upper = None
        for k, judge in enumerate(self._judges):
            # Verdicts stay until the reset, so a count says whether one is new.
            verdict = judge.verdict
            decided = int(np.count_nonzero(verdict))
            if decided == self._decided[k]:
                continue
            at = verdict.nonzero()[0]
            self._record(k, at, verdict[at])

    def _record(self, k: int, at: Numbers, verdict: NDArray[np.int8]) -> None:
        """Records the new ones among the verdicts of a specification in these environments."""
        decided_at = self._decided_at[k]
        new = (verdict != 0) & (decided_at[at] < 0)
        at, verdict = at[new], verdict[new]
        if len(at) == 0:
            return
        self._decided[k] += len(at)
        last = self._judges[k].samples[at] - 1
        decided_at[at] = last
        first = (verdict < 0) & (self.violated_at[at] < 0)
        self.violated_by[at[first]] = self._names[k]
        self.violated_at[at[first]] = last[first]

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


def _pick(columns: list[int]) -> slice | list[int]:
    """The columns that a specification reads; neighbours as a slice, which copies nothing."""
    if columns and columns == list(range(columns[0], columns[-1] + 1)):
        return slice(columns[0], columns[-1] + 1)
    return columns
