"""The monitors of several specifications in many environments."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import End, VectorEpisodeMonitor, VerdictBook, holds
from rtamt.errors import Argument
from rtamt_gym.judging.clocks import Obligations
from rtamt_gym.judging.costs import Cost, VectorCostMeter
from rtamt_gym.judging.infos import VERDICTS, SpecRows, outcome, spec_state
from rtamt_gym.judging.monitors import VectorInstantMonitor, make_monitors, require_known
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.stage_progress import VectorStageProgress
from rtamt_gym.judging.values import MonitorValues, read_values
from rtamt_gym.options.evaluation import AtTermination, Reading
from rtamt_gym.shaping import least
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["VectorMonitors", "VectorPanel"]

VectorMonitors = dict[str, tuple[VectorEpisodeMonitor | VectorInstantMonitor, VectorEpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""

Numbers = NDArray[np.int64]


class VectorPanel:
    """The vector twin of `Panel`: its arrays have an element for every environment.

    Attributes:
        monitors: The monitors of each specification: ``(robustness source, judge)``.
        robustness: The least robustness over the specifications.

    It takes the arguments of `Panel`, the number of environments, and the names of the columns of
    the tables that are fed.

    Raises:
        SpecificationError: As `Panel` does.
        InputError: As `Panel` does.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        num: int,
        reading: Reading,
        columns: Sequence[str],
        cost: Cost | None = None,
    ) -> None:
        self.monitors: VectorMonitors = make_monitors(
            specs,
            reading,
            of_episode=partial(VectorEpisodeMonitor, num=num),
            of_instants=partial(VectorInstantMonitor, num=num),
        )
        self._names = np.array([*self.monitors, None], dtype=object)
        self._judges = [judge for _, judge in self.monitors.values()]
        self._book = VerdictBook(self._judges)
        self._columns = tuple(
            tuple(columns.index(name) for name in spec.variables) for spec in specs.values()
        )
        if cost is not None:
            require_known(reading, Argument("cost", cost))
        self._meter = cost and VectorCostMeter(cost, specs, num, reading, columns)
        self._owing: Obligations | None = None
        judges = {name: judge for name, (_, judge) in self.monitors.items()}
        self._stages = VectorStageProgress(specs, judges, reading, num, columns) or None
        self._reading = num, reading, columns
        self._whole = reading.view == "episode"  # the sources are the judges
        self.robustness = np.full(num, np.nan)
        self._lower: Floats | None = None  # found when they are read
        self._upper: Floats | None = None

    def track_obligations(self) -> list[list[Obligation]]:
        """Follows what the temporal operators owe from now on, as `Panel.track_obligations`."""
        if self._owing is None:
            require_known(self._reading[1], Argument("observe", "obligations"))
            judged = {name: judge.specification for name, (_, judge) in self.monitors.items()}
            self._owing = Obligations(judged, *self._reading)
        return self._owing.found

    @property
    def tracks_obligations(self) -> bool:
        """Whether it follows what temporal operators owe."""
        return self._owing is not None

    @property
    def of_instant(self) -> NDArray[np.bool_] | None:
        """True everywhere if the robustness is that of an instant, as of `Panel`; a fresh array."""
        num, reading, _ = self._reading
        return np.ones(num, np.bool_) if reading.view == "step" else None

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None where bounds count samples."""
        return self._judges[0].period

    @property
    def violated_at(self) -> NDArray[np.int64]:
        """The sample that showed the first violation; -1 where there is none.

        It is the last sample of the episode where only the end decided it.
        """
        return self._book.violated_at

    def any_violated(self, at: Numbers | None = None) -> Lanes:
        """Whether each of the environments `at` violates a specification; None: of all."""
        rows = self._book.violated if at is None else self._book.violated.take(at, axis=1)
        violated: Lanes = np.logical_or.reduce(rows)
        return violated

    def violated_by(self, at: Numbers) -> NDArray[np.object_]:
        """The specification that was violated first in each of `at`; None where none is."""
        found: NDArray[np.object_] = self._names[self._book.first.take(at)]
        return found

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples fed since the reset; a fresh array."""
        return self._judges[0].samples

    def undecided(self, at: Numbers) -> NDArray[np.bool_]:
        """Whether verdicts are open: a row for each specification, a column for each of `at`."""
        return self._book.settled_at.take(at, axis=1) < 0

    def knows(self, above: Mapping[str, float]) -> NDArray[np.bool_]:
        """Whether every robustness is known, as `Panel.knows` says, for each environment."""
        known = np.ones(self._book.num, np.bool_)
        for name, (_, judge) in self.monitors.items():
            lower = judge.lower
            known &= (lower == judge.upper) | (lower > above.get(name, math.inf))
        return known

    def violated(self, names: Collection[str]) -> Lanes:
        """Whether each environment certainly violates one of these specifications."""
        rows = [name in names for name in self.monitors]
        violated: Lanes = np.logical_or.reduce(self._book.violated[rows])
        return violated

    def satisfied(self, at: Numbers) -> NDArray[np.bool_]:
        """Whether they are satisfied: a row for each specification, a column for each of `at`."""
        return np.array([judge.verdict[at] > 0 for judge in self._judges])

    @property
    def progress(self) -> dict[str, Floats]:
        """The progress of each requirement in stages, by its name; see `StageProgress`."""
        return {} if self._stages is None else self._stages.values

    @property
    def least_progress(self) -> Floats | None:
        """The least progress over the requirements in stages; None if none is."""
        return None if self._stages is None else self._stages.least

    def success(self, at: Numbers) -> Lanes:
        """Whether each of the environments `at` satisfies all specifications."""
        failed: Lanes = np.logical_or.reduce(
            self.undecided(at) | self._book.violated.take(at, axis=1)
        )
        return ~failed

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        if not self._whole:
            for source, _ in self.monitors.values():
                source.reset(lanes)
        self._book.reset(lanes)
        if self._meter is not None:
            self._meter.reset(lanes)
        if self._owing is not None:
            self._owing.reset(lanes)
        if self._stages is not None:
            self._stages.reset(lanes)

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all.

        A table in Fortran's order is read fastest.
        """
        self._lower = self._upper = None
        if self._whole:
            self.robustness = self._book.feed(table, self._columns, lanes)
        else:
            found = [
                source.update(table[:, list(columns)], lanes)
                for (source, _), columns in zip(self.monitors.values(), self._columns, strict=True)
            ]
            self.robustness = least(found)
            self._book.note()
        if self._meter is not None:
            self._meter.feed(table, lanes)
        if self._owing is not None:
            self._owing.feed(table, lanes)
        if self._stages is not None:
            self._stages.feed(table, lanes)

    def cut_windows(self, lanes: Lanes) -> frozenset[str]:
        """Specifications as of `Panel.cut_windows`, in some environment of the mask."""
        at, found = lanes.nonzero()[0], set()
        would = self.undecided(at) & [holds(judge.robustness[at]) for judge in self._judges]
        for name, judge, rows in zip(self.monitors, self._judges, would, strict=True):
            if judge.specification.timed and rows.any():
                another = copy.deepcopy(judge)
                another.finish(lanes, end="cut")
                if (rows & (another.verdict[at] == 0)).any():
                    found.add(str(name))
        return frozenset(found)

    def finish(self, lanes: Lanes, end: AtTermination | End = "complete") -> None:
        """Ends the traces of the environments of the mask, as `Panel.finish` does."""
        if np.count_nonzero(lanes) == 0:
            return
        self._lower = self._upper = None
        if end == "failure":
            self._book.fail(lanes)
            return
        self._book.finish(lanes, end=end)
        if self._stages is not None:
            self._stages.finish(lanes, end)
        if self._whole:
            self.robustness = self._book.least("robustness")
        else:
            self.robustness = least([source.robustness for source, _ in self.monitors.values()])

    def take_costs(self, stepped: Lanes | None) -> dict[str, Floats] | None:
        """The costs of the step that the environments of the mask made; None: that all made.

        None if they are not measured.
        """
        return None if self._meter is None else self._meter.take(self._book.violated, stepped)

    @property
    def lower(self) -> Floats:
        """The least that the robustness can still become."""
        if self._lower is None:
            self._lower = self._book.least("lower")
        return self._lower

    @property
    def upper(self) -> Floats:
        """The greatest that the robustness can still become."""
        if self._upper is None:
            self._upper = self._book.least("upper")
        return self._upper

    def _uppers(self) -> list[Floats]:
        """The upper bounds of each specification, an array with a number for each environment."""
        found = [judge.upper for judge in self._judges]
        failed = self._book.failed
        if not failed.any():
            return found
        return [np.where(row, -0.0, upper) for row, upper in zip(failed, found, strict=True)]

    def values(self) -> MonitorValues[Floats]:
        """Reads the values of all monitors."""
        owed = None if self._owing is None else self._owing.owed()
        verdicts = [
            np.where(failed, -1.0, judge.verdict)
            for failed, judge in zip(self._book.failed, self._judges, strict=True)
        ]
        return read_values(self.monitors.values(), self._uppers(), verdicts, self.samples, owed)

    def describe(self) -> dict[str, dict[str, Any]]:
        """The state of every specification: ``infos["stl"]``."""
        progress = self.progress
        return {
            name: spec_state(
                source.robustness,
                judge.lower,
                upper,
                VERDICTS[np.where(failed, -1, judge.verdict)],
                self.of_instant,
                progress.get(name),
            )
            for (name, (source, judge)), upper, failed in zip(
                self.monitors.items(), self._uppers(), self._book.failed, strict=True
            )
        }

    def spread(self, columns: Sequence[Any], at: Numbers) -> None:
        """Writes arrays of all environments from values of the environments `at`."""
        self._book.spread(columns, at)

    def outcomes(self, at: Numbers) -> SpecRows:
        """The outcome of every specification so far, in the environments `at`."""
        return self.ends(at)[0]

    def ends(self, at: Numbers) -> tuple[SpecRows, Lanes, Lanes]:
        """The outcomes in the environments `at`, whether all hold, and whether one is open."""
        ends = self._book.outcomes(at)
        ended = ends.settled & self._book.open_at_end.take(at, axis=1)
        found = outcome(
            ends.robustness,
            ends.verdicts,
            ends.satisfied,
            ends.settled_at,
            ends.settled ^ ended,
            ended,
            ends.by_end,
        )
        more = {name: {"progress": progress[at]} for name, progress in self.progress.items()}
        return SpecRows(list(self.monitors), found, more), ends.success, ends.undecided
