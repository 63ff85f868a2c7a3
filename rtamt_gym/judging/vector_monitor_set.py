"""The monitors of several specifications in a batch of environments."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import Specification, VectorEpisodeMonitor, Verdict, holds
from rtamt.errors import Argument
from rtamt.internal import VerdictLog
from rtamt.typing import End
from rtamt_gym.judging.costs import Cost, VectorCostMeter
from rtamt_gym.judging.infos import VERDICTS, SpecRows, optional_keys, outcome, spec_state
from rtamt_gym.judging.monitors import (
    MonitorValues,
    VectorInstantMonitor,
    make_monitors,
    require_known,
)
from rtamt_gym.judging.obligations import Obligation, Obligations
from rtamt_gym.judging.stages import VectorStageProgress, vector_stage_progress
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.shaping import least
from rtamt_gym.signals.columns import Entries, Floats

VectorMonitors = dict[str, tuple[VectorEpisodeMonitor | VectorInstantMonitor, VectorEpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""

Numbers = NDArray[np.int64]


class VectorMonitorSet:
    """`MonitorSet` for a batch: its arrays have an element for every environment.

    ``columns`` names the columns of the tables. ``robustness`` is the minimum over the
    specifications; with ``view="step"``, of instants.
    """

    def __init__(
        self,
        specs: Mapping[str, Specification],
        num: int,
        reading: EvaluationOptions,
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
        self._sources = [source for source, _ in self.monitors.values()]
        self._judges = [judge for _, judge in self.monitors.values()]
        self._log = VerdictLog(self._judges)
        self._columns = tuple(
            tuple(columns.index(name) for name in spec.variables) for spec in specs.values()
        )
        if cost is not None:
            require_known(reading, Argument("cost", cost))
        self._meter = cost and VectorCostMeter(cost, specs, num, reading, columns)
        self._owing: Obligations | None = None
        judges = {name: judge for name, (_, judge) in self.monitors.items()}
        self._stages = vector_stage_progress(specs, judges, reading, num, columns)
        # What takes every sample in addition to the monitors.
        self._measures: list[VectorCostMeter | Obligations | VectorStageProgress] = [
            *([self._meter] if self._meter else []),
            *self._stages.values(),
        ]
        self._reading, self._table_names = reading, columns
        self._whole = reading.view == "episode"  # the sources are the judges
        self.robustness = np.full(num, np.nan)
        self._lower: Floats | None = None  # computed when they are read
        self._upper: Floats | None = None
        self.optional_keys = optional_keys(self)

    def track_obligations(self) -> list[list[Obligation]]:
        """Track pending obligations from now on; return the operators."""
        if self._owing is None:
            require_known(self._reading, Argument("observe", "obligations"))
            judged = {name: judge.specification for name, (_, judge) in self.monitors.items()}
            self._owing = Obligations(judged, self._log.num, self._reading, self._table_names)
            self._measures.append(self._owing)
        return self._owing.found

    @property
    def tracks_obligations(self) -> bool:
        """Whether it tracks pending obligations."""
        return self._owing is not None

    @property
    def of_instant(self) -> NDArray[np.bool_] | None:
        """True everywhere if the robustness is the robustness of an instant; otherwise None."""
        return None if self._whole else np.ones(self._log.num, np.bool_)

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None if bounds count samples."""
        return self._judges[0].period

    def any_violated(self, at: Numbers | None = None) -> Entries:
        """Return whether each of the environments `at` violates a specification; None: of all."""
        rows = self._log.violated if at is None else self._log.violated.take(at, axis=1)
        violated: Entries = np.logical_or.reduce(rows)
        return violated

    def first_violations(self, at: Numbers) -> tuple[Entries, NDArray[np.object_], Numbers]:
        """Return where there is a violation, the first violated specification, and its sample.

        The sample showed the violation, or is the last if only the end did. Without a violation,
        the specification is None and the sample -1.
        """
        log = self._log
        return self.any_violated(at), self._names[log.first.take(at)], log.violated_at.take(at)

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples since the reset; a new array."""
        return self._judges[0].samples

    def undecided(self, at: Numbers) -> NDArray[np.bool_]:
        """Return the undecided verdicts: a row per specification, a column for each of `at`."""
        return self._log.settled_at.take(at, axis=1) < 0

    def knows(self, above: Mapping[str, float]) -> NDArray[np.bool_]:
        """Return where every robustness is final or stays above, as `MonitorSet.knows` does."""
        known = np.ones(self._log.num, np.bool_)
        for name, (_, judge) in self.monitors.items():
            lower = judge.lower
            known &= (lower == judge.upper) | (lower > above.get(name, math.inf))
        return known

    def violated(self, names: Collection[str]) -> Entries:
        """Return whether each environment certainly violates any of these specifications."""
        rows = [name in names for name in self.monitors]
        violated: Entries = np.logical_or.reduce(self._log.violated[rows])
        return violated

    def satisfied(self, at: Numbers) -> NDArray[np.bool_]:
        """Return which specifications are satisfied: a row for each, a column for each of `at`."""
        return np.array([judge.verdict[at] > 0 for judge in self._judges])

    @property
    def progress(self) -> dict[str, Floats]:
        """The progress of each requirement in stages, by its name; new arrays."""
        return {name: part.progress.copy() for name, part in self._stages.items()}

    @property
    def least_progress(self) -> Floats | None:
        """The minimum progress over the requirements in stages; None without stages."""
        if not self._stages:
            return None
        least: Floats = np.minimum.reduce([part.progress for part in self._stages.values()])
        return least

    def success(self, at: Numbers) -> Entries:
        """Return whether each of the environments `at` satisfies all specifications."""
        failed: Entries = np.logical_or.reduce(
            self.undecided(at) | self._log.violated.take(at, axis=1)
        )
        return ~failed

    def reset(self, entries: Entries | None = None) -> None:
        """Forget the episodes of the environments in the mask; None: of all."""
        if not self._whole:
            for source in self._sources:
                source.reset(entries)
        self._log.reset(entries)
        for measure in self._measures:
            measure.reset(entries)

    def feed(self, table: Floats, entries: Entries | None = None) -> None:
        """Take a row of the table for each environment in the mask; None: for all.

        Tables in Fortran order are fastest.
        """
        self._lower = self._upper = None
        if self._whole:
            self.robustness = self._log.feed(table, self._columns, entries)
        else:
            self.robustness = least(
                [
                    source.update(table[:, list(columns)], entries)
                    for source, columns in zip(self._sources, self._columns, strict=True)
                ]
            )
            self._log.note()
        for measure in self._measures:
            measure.feed(table, entries)

    def cut_windows(self, entries: Entries) -> frozenset[str]:
        """Return the names of `MonitorSet.cut_windows` in any environment in the mask."""
        index, names = entries.nonzero()[0], set()
        would = self.undecided(index) & [holds(judge.robustness[index]) for judge in self._judges]
        for name, judge, rows in zip(self.monitors, self._judges, would, strict=True):
            if judge.specification.timed and rows.any():
                another = copy.deepcopy(judge)
                another.finish(entries, end="cut")
                if (rows & (another.verdict[index] == 0)).any():
                    names.add(str(name))
        return frozenset(names)

    def finish(self, entries: Entries, end: AtTermination | End = "complete") -> None:
        """End the traces of the environments in the mask, as `MonitorSet.finish` does."""
        if np.count_nonzero(entries) == 0:
            return
        self._lower = self._upper = None
        if end == "failure":
            self._log.fail(entries)
            return
        self._log.finish(entries, end=end)
        for stages in self._stages.values():
            stages.finish(entries, end)
        if self._whole:
            self.robustness = self._log.least("robustness")
        else:
            self.robustness = least([source.robustness for source in self._sources])

    def take_costs(self, stepped: Entries | None) -> dict[str, Floats] | None:
        """Return the costs of the step of the environments in the mask, or None without costs."""
        return None if self._meter is None else self._meter.take(self._log.violated, stepped)

    @property
    def lower(self) -> Floats:
        """The lower bound of the robustness."""
        if self._lower is None:
            self._lower = self._log.least("lower")
        return self._lower

    @property
    def upper(self) -> Floats:
        """The upper bound of the robustness."""
        if self._upper is None:
            self._upper = self._log.least("upper")
        return self._upper

    def _uppers(self) -> list[Floats]:
        """Return the upper bounds of each specification."""
        uppers = [judge.upper for judge in self._judges]
        failed = self._log.failed
        if not failed.any():
            return uppers
        return [np.where(row, -0.0, upper) for row, upper in zip(failed, uppers, strict=True)]

    def values(self) -> MonitorValues[Floats]:
        """Return the values of all monitors."""
        verdicts = [
            np.where(failed, -1.0, judge.verdict)
            for failed, judge in zip(self._log.failed, self._judges, strict=True)
        ]
        return MonitorValues(
            [source.robustness for source in self._sources],
            [judge.robustness for judge in self._judges],
            [judge.lower for judge in self._judges],
            self._uppers(),
            verdicts,
            self.samples,
            None if self._owing is None else self._owing.owed(),
        )

    def values_at(self, index: int) -> tuple[list[float], list[Verdict]]:
        """Return robustness and bounds of each specification in one environment, and verdicts."""
        curves: list[float] = []
        verdicts: list[Verdict] = []
        failed = self._log.failed
        for row, (source, judge) in enumerate(self.monitors.values()):
            lost = bool(failed[row, index])
            upper = -0.0 if lost else judge.upper.item(index)
            curves += (source.robustness.item(index), judge.lower.item(index), upper)
            verdicts.append(Verdict.VIOLATED if lost else Verdict(judge.verdict.item(index)))
        return curves, verdicts

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the state of every specification: ``infos["stl"]``."""
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
                self.monitors.items(), self._uppers(), self._log.failed, strict=True
            )
        }

    def spread(self, columns: Sequence[Any], at: Numbers) -> None:
        """Write arrays of all environments from values of the environments `at`."""
        self._log.spread(columns, at)

    def outcomes(self, at: Numbers) -> SpecRows:
        """Return the outcome of every specification so far, in the environments `at`."""
        return self.ends(at)[0]

    def ends(self, at: Numbers) -> tuple[SpecRows, Entries, Entries]:
        """Return the outcomes in `at`, whether all are satisfied, and whether one is undecided."""
        ends = self._log.outcomes(at)
        ended = ends.settled & self._log.open_at_end.take(at, axis=1)
        outcomes = outcome(
            ends.robustness,
            ends.verdicts,
            ends.satisfied,
            ends.settled_at,
            ends.settled ^ ended,
            ended,
            ends.by_end,
        )
        more = {name: {"progress": progress[at]} for name, progress in self.progress.items()}
        return SpecRows(list(self.monitors), outcomes, more), ends.success, ends.undecided
