"""The monitors of several specifications in many environments."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import End, VectorEpisodeMonitor, holds
from rtamt.errors import Argument
from rtamt_gym.judging.clocks import Obligations
from rtamt_gym.judging.costs import Cost, VectorCostMeter
from rtamt_gym.judging.ends import AtTermination
from rtamt_gym.judging.infos import VERDICTS, Where, outcome, spec_state
from rtamt_gym.judging.monitors import VectorInstantMonitor, make_monitors, require_known
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.picking import pick
from rtamt_gym.judging.reading import Reading
from rtamt_gym.judging.stage_progress import VectorStageProgress
from rtamt_gym.judging.values import MonitorValues, read_values
from rtamt_gym.shaping import least
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["VectorMonitors", "VectorPanel"]

VectorMonitors = dict[str, tuple[VectorEpisodeMonitor | VectorInstantMonitor, VectorEpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""

Numbers = NDArray[np.integer[Any]]


class VectorPanel:
    """The vector twin of `Panel`: its arrays have an element for every environment.

    Attributes:
        monitors: The monitors of each specification: ``(robustness source, judge)``.
        violated_by: The specification that was violated first; None where none is.
        violated_at: The sample that showed it; -1 where there is none.
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
        self._names = np.array(list(self.monitors), dtype=object)
        self._judges = [judge for _, judge in self.monitors.values()]
        self._picks = [
            pick([columns.index(name) for name in spec.variables]) for spec in specs.values()
        ]
        # The sample that decided each specification in each environment, -1 while it is open; and
        # how many are decided.
        self._decided_at = np.full((len(specs), num), -1)
        self._decided = 0
        self._violated = np.zeros((len(specs), num), np.bool_)
        self._failed = np.zeros((len(specs), num), np.bool_)  # by the end alone
        self._fails = False  # whether that has happened yet
        if cost is not None:
            require_known(reading, Argument("cost", cost))
        self._meter = cost and VectorCostMeter(cost, specs, num, reading, columns)
        self._owing: Obligations | None = None
        judges = {name: judge for name, (_, judge) in self.monitors.items()}
        self._stages = VectorStageProgress(specs, judges, reading, num, columns) or None
        self._reading = num, reading, columns
        self.violated_by = np.full(num, None)
        self.violated_at = np.full(num, -1)
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
    def of_instant(self) -> NDArray[np.bool_] | None:
        """True everywhere if the robustness is that of an instant, as of `Panel`; a fresh array."""
        num, reading, _ = self._reading
        return np.ones(num, np.bool_) if reading.view == "step" else None

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None where bounds count samples."""
        return self._judges[0].period

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples fed since the reset; a fresh array."""
        return self._judges[0].samples

    def undecided(self, at: Numbers) -> NDArray[np.bool_]:
        """Whether verdicts are open: a row for each specification, a column for each of `at`."""
        return self._decided_at.take(at, axis=1) < 0

    def knows(self, above: Mapping[str, float]) -> NDArray[np.bool_]:
        """Whether every robustness is known, as `Panel.knows` says, for each environment."""
        known = np.ones(len(self.violated_at), np.bool_)
        for name, (_, judge) in self.monitors.items():
            lower = judge.lower
            known &= (lower == judge.upper) | (lower > above.get(name, math.inf))
        return known

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
        failed: Lanes = np.logical_or.reduce(self.undecided(at) | self._violated.take(at, axis=1))
        return ~failed

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        for source, _ in self.monitors.values():
            source.reset(lanes)
        if self._meter is not None:
            self._meter.reset(lanes)
        if self._owing is not None:
            self._owing.reset(lanes)
        if self._stages is not None:
            self._stages.reset(lanes)
        if lanes is None:
            self._decided_at[:] = self.violated_at[:] = -1
            self._violated[:] = self._failed[:] = False
            self.violated_by[:] = None
            self._decided = 0
            return
        at = lanes.nonzero()[0]
        self._decided -= int(np.count_nonzero(self._decided_at.take(at, axis=1) >= 0))
        self._decided_at[:, at] = -1
        self._violated[:, at] = self._failed[:, at] = False
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
        for name, judge, rows in zip(self._names, self._judges, would, strict=True):
            if judge.specification.timed and rows.any():
                another = copy.deepcopy(judge)
                another.finish(lanes, end="cut")
                if (rows & (another.verdict[at] == 0)).any():
                    found.add(str(name))
        return frozenset(found)

    def finish(self, lanes: Lanes, end: AtTermination | End = "complete") -> None:
        """Ends the traces of the environments of the mask, as `Panel.finish` does."""
        at = lanes.nonzero()[0]
        if len(at) == 0:
            return
        self._lower = self._upper = None
        if end == "failure":
            self._failed[:, at] = self._decided_at.take(at, axis=1) < 0
            self._fails = True
        else:
            for judge in self._judges:
                judge.finish(lanes, end=end)
            if self._stages is not None:
                self._stages.finish(lanes, end)
            self.robustness = least([source.robustness for source, _ in self.monitors.values()])
        self._record(at, self._verdicts(at))

    def take_costs(self, stepped: Lanes | None) -> dict[str, Floats] | None:
        """The costs of the step that the environments of the mask made; None: that all made.

        None if they are not measured.
        """
        return None if self._meter is None else self._meter.take(self._violated, stepped)

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
            self._upper = least(self._uppers())
        return self._upper

    def _uppers(self) -> list[Floats]:
        """The upper bounds of each specification, an array with a number for each environment."""
        found = [judge.upper for judge in self._judges]
        if not self._fails:
            return found
        return [np.where(row, -0.0, upper) for row, upper in zip(self._failed, found, strict=True)]

    def _note(self) -> None:
        """Records the verdicts that have been decided."""
        self._lower = self._upper = None
        verdicts = [judge.verdict for judge in self._judges]
        # Verdicts stay until the reset, so their number says whether one is new.
        if sum(map(np.count_nonzero, verdicts)) == self._decided:
            return
        found = np.array(verdicts)
        at = np.logical_or.reduce((found != 0) & (self._decided_at < 0)).nonzero()[0]
        self._record(at, found.take(at, axis=1))

    def _verdicts(self, at: Numbers) -> NDArray[np.int8]:
        """The verdicts: a row for each specification, a column for each environment of `at`."""
        found = np.array([judge.verdict[at] for judge in self._judges])
        return np.where(self._failed.take(at, axis=1), np.int8(-1), found)

    def _record(self, at: Numbers, verdicts: NDArray[np.int8]) -> None:
        """Records the verdicts on the environments `at` that were open before."""
        before = self._decided_at.take(at, axis=1)
        new = (verdicts != 0) & (before < 0)
        count = int(np.count_nonzero(new))
        if count == 0:
            return
        self._decided += count
        last = self.samples[at] - 1
        self._decided_at[:, at] = np.where(new, last, before)
        violated = new & (verdicts < 0)
        self._violated[:, at] |= violated
        first = np.logical_or.reduce(violated) & (self.violated_at[at] < 0)
        if np.count_nonzero(first):
            lanes = at[first]
            self.violated_by[lanes] = self._names[violated.argmax(axis=0)[first]]
            self.violated_at[lanes] = last[first]

    def values(self) -> MonitorValues[Floats]:
        """Reads the values of all monitors."""
        owed = None if self._owing is None else self._owing.owed()
        verdicts = [
            np.where(failed, -1.0, judge.verdict)
            for failed, judge in zip(self._failed, self._judges, strict=True)
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
                self.monitors.items(), self._uppers(), self._failed, strict=True
            )
        }

    def outcomes(self, at: Numbers) -> dict[str, dict[str, Any]]:
        """The outcome of every specification so far, in the environments `at`."""
        found = outcome(
            np.array([judge.robustness[at] for judge in self._judges]),
            self._verdicts(at),
            self._decided_at.take(at, axis=1),
        )
        made = {name: _row(found, k) for k, name in enumerate(self.monitors)}
        for name, progress in self.progress.items():
            made[name]["progress"] = progress[at]
        return made


def _row(found: dict[str, Any], k: int) -> dict[str, Any]:
    """Row k of the arrays of an outcome."""
    return {
        key: Where(value.there[k], value.value[k]) if isinstance(value, Where) else value[k]
        for key, value in found.items()
    }
