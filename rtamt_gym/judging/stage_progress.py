"""How far episodes have come in requirements that ask for one thing after another.

A requirement with stages has a progress from 0 to 1 beside its verdict: with those that ``stages=``
names, or with those that `rtamt.patterns.stages` finds in its shape. Let n be the number of its
stages, and k the number of those that are decided: the requirement cut behind stage k, or where
stages are named ``in_order(stage 1, ..., stage k)``, is satisfied for certain. The progress is 1 if
the requirement is satisfied. Before that it is

    (k + f) / n,

where f is the share of the way that stage k + 1 has made. Its robustness r is the greatest that the
stage has had since stage k was decided: that of ``eventually(stage)`` on the samples from that one
on, if the episode ended now. It sets out from r0, its first finite value, and what is to be reached
is 0: f is ``1 - r / r0``, no less than 0, and 1 where r holds already and only certainty is
missing. So f depends on the unit of a quantity only in the ratio ``r / r0``. However near the stage
is, the progress stays below ``(k + 1) / n`` until it is decided, and below 1 until the requirement
is satisfied. The progress of an episode never falls: it is the greatest so far.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

import rtamt
from rtamt import End, EpisodeMonitor, VectorEpisodeMonitor
from rtamt_gym.judging.costs import options_of_parts
from rtamt_gym.judging.infos import Lanewise
from rtamt_gym.judging.monitors import machine_state
from rtamt_gym.judging.obligations import bare
from rtamt_gym.judging.picking import pick, picked
from rtamt_gym.judging.stages import stages_of
from rtamt_gym.options.evaluation import Reading

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["StageProgress", "VectorStageProgress", "progress_of", "progress_of_events"]

_M = TypeVar("_M", bound=EpisodeMonitor | VectorEpisodeMonitor)


def progress_of(
    spec: rtamt.Specification, columns: Mapping[str, Floats], reading: Reading
) -> float | None:
    """The progress of a whole trace of samples; None if the requirement has no stages.

    Args:
        spec: The requirement.
        columns: The values of its variables, and of others.
        reading: How samples and the end are judged, with their period, and the requirement's
            stages if they are named.

    Raises:
        RtamtError: As `rtamt_gym.judging.stages.stages_of` does.
    """
    if not stages_of({"": spec}, reading):
        return None
    judge = EpisodeMonitor(spec, **reading.of_monitors({"": spec})[""])
    found = StageProgress({"": spec}, {"": judge}, reading)
    feed = found.feeder(spec.variables)
    for row in zip(*(columns[name].tolist() for name in spec.variables), strict=True):
        judge.update(*row)
        feed(row)
    judge.finish(reading.end)
    found.finish(reading.end)
    return found.least


def progress_of_events(
    spec: rtamt.Specification,
    signals: Mapping[str, tuple[Floats, Floats]],
    reading: Reading,
    *,
    satisfied: bool,
) -> float | None:
    """The progress of a whole trace in dense time; None if there is none.

    Between two events nothing changes, so that stages that look at no other time are reached at
    events. Where stages or what is between them have times of their own there is none.

    Args:
        spec: The requirement.
        signals: Times and values of the events of its variables, all of them known.
        reading: How predicates count, and the requirement's stages if they are named.
        satisfied: Whether the requirement is satisfied.

    Raises:
        RtamtError: As `rtamt_gym.judging.stages.stages_of` does.
    """
    stages = stages_of({"": spec}, reading).get("")
    if stages is None or stages.deciders:
        return None
    if satisfied:
        return 1.0
    begin = max(times[0] for times, _ in signals.values())
    end = min(times[-1] for times, _ in signals.values())
    every = np.unique(np.concatenate([times for times, _ in signals.values()]))
    every = every[(every >= begin) & (every <= end)]
    columns = {
        name: values[np.searchsorted(times, every, "right") - 1]
        for name, (times, values) in signals.items()
    }
    options = reading.having(period=None).of_monitors({"": spec})[""]
    count, first = len(stages.conditions), 0
    for reached, stage in enumerate(stages.conditions):
        heights = rtamt.evaluate(bare(spec, stage), columns, n=len(every), **options)[first:]
        holds = ~np.signbit(heights)
        if not holds.any():
            began = next(filter(math.isfinite, heights.tolist()), _NO_WAY)
            height = float(heights.max())
            return float(_place(reached, count, height, began or _NO_WAY, min, max))
        first += int(holds.argmax())
    return _ALMOST


@dataclass(frozen=True, slots=True)
class _Monitors(Generic[_M]):
    """The monitors of a requirement with stages.

    Attributes:
        deciders: Those of the formulas that decide stages, as `Stages` has them.
        alone: One for each stage: of ``eventually(stage)``.
        judge: The monitor of the whole.
    """

    deciders: list[_M]
    alone: list[_M]
    judge: _M

    @property
    def every(self) -> list[_M]:
        return self.deciders + self.alone


def _monitors_of(
    specs: Mapping[str, rtamt.Specification],
    judges: Mapping[str, _M],
    reading: Reading,
    make: Callable[..., _M],
) -> dict[str, _Monitors[_M]]:
    """The monitors of each requirement with stages."""
    found = stages_of(specs, reading)
    parts = {
        name: [
            *(bare(specs[name], decider) for decider in each.deciders),
            *(bare(specs[name], stage.eventually()) for stage in each.conditions),
        ]
        for name, each in found.items()
    }
    flat = [part for each in parts.values() for part in each]
    options = iter(options_of_parts(specs, flat, reading) if flat else ())
    made = {name: [make(part, **next(options)) for part in each] for name, each in parts.items()}
    counts = {name: len(each.deciders) for name, each in found.items()}
    return {
        name: _Monitors(each[: counts[name]], each[counts[name] :], judges[name])
        for name, each in made.items()
    }


def _place(
    reached: int,
    count: int,
    height: Lanewise,
    began: Lanewise,
    least: Callable[..., Lanewise],
    greatest: Callable[..., Lanewise],
) -> Lanewise:
    """The progress where so many stages are decided, without that of times before.

    Args:
        reached: How many are decided.
        count: How many there are.
        height: The robustness of the next.
        began: That from which it set out, below 0.
        least: The function that gives the least of two.
        greatest: The function that gives the greatest of two.
    """
    share = greatest(1.0 - least(height, 0.0) / began, 0.0)
    return least((reached + share) / count, math.nextafter((reached + 1) / count, 0.0))


_NO_WAY = -1.0
"""Stands for a robustness to set out from where there is none, or no way to go."""

_ALMOST = math.nextafter(1.0, 0.0)
"""The progress where all stages are decided, and the requirement is not."""


class StageProgress:
    """The progress of the requirements that have stages, in one environment.

    Args:
        specs: The specifications by name.
        judges: The monitor of each, fed before this is.
        reading: How samples are judged, with the stages that are named.

    Raises:
        RtamtError: As `rtamt_gym.judging.stages.stages_of` does, or if stages cannot be compiled.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        judges: Mapping[str, EpisodeMonitor],
        reading: Reading,
    ) -> None:
        self._courses = {
            name: _Course(monitors, hold=reading.nan == "hold")
            for name, monitors in _monitors_of(specs, judges, reading, EpisodeMonitor).items()
        }

    def __bool__(self) -> bool:
        """Whether there is a requirement with stages."""
        return bool(self._courses)

    @property
    def values(self) -> dict[str, float]:
        """The progress of each requirement that has stages, by its name."""
        return {name: course.progress for name, course in self._courses.items()}

    @property
    def least(self) -> float:
        """The least progress over the requirements that have one."""
        return min(course.progress for course in self._courses.values())

    def reset(self) -> None:
        for course in self._courses.values():
            course.reset()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        """Makes the function that feeds a sample.

        Args:
            names: The names of the signals, in the order of the values that the function takes.
        """
        feeds = [course.feeder(names) for course in self._courses.values()]

        def feed(values: Sequence[float]) -> None:
            for each in feeds:
                each(values)

        return feed

    def finish(self, end: End) -> None:
        """Ends the trace, after the judges have."""
        for course in self._courses.values():
            course.finish(end)

    def state(self) -> tuple[Any, ...]:
        """The state, small and fit for pickle."""
        return tuple(course.state() for course in self._courses.values())

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state` of the same requirements."""
        for course, held in zip(self._courses.values(), state, strict=True):
            course.restore(held)


class _Course:
    """The progress of one requirement in one environment.

    Args:
        monitors: Its monitors.
        hold: Whether a value that is nan stands for the last one.
    """

    def __init__(self, monitors: _Monitors[EpisodeMonitor], *, hold: bool) -> None:
        self._monitors, self._hold = monitors, hold
        self._count = len(monitors.alone)
        self._start()

    def _start(self) -> None:
        self.progress = 0.0
        self._reached = 0  # stages decided
        self._height = math.nan  # r of the stage that is next
        self._began = math.nan  # r0 of the stage that is next
        self._held: list[float] = []  # the last values, where nan stands for them

    def reset(self) -> None:
        for monitor in self._monitors.every:
            monitor.reset()
        self._start()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        def update_of(monitor: EpisodeMonitor) -> Callable[[Sequence[float]], float]:
            place, several = picked([names.index(name) for name in monitor.variables])
            update = monitor.update
            if several is None:
                return lambda values: update(values[place])
            return lambda values: update(*several(values))

        deciders = [update_of(monitor) for monitor in self._monitors.deciders]
        alone = [update_of(monitor) for monitor in self._monitors.alone]
        judge, hold, next_stage = self._monitors.judge, self._hold, self._next_stage

        def feed(values: Sequence[float]) -> None:
            if hold:
                values = self._holding(values)
            if self.progress == 1.0:
                return
            for update in deciders[self._reached :]:  # the verdicts before them are certain
                update(values)
            if judge.verdict > 0:
                self.progress = 1.0
                return
            if deciders:
                self._decide()
            next_stage(alone, values)

        return feed

    def _next_stage(
        self, alone: Sequence[Callable[[Sequence[float]], float]], values: Sequence[float]
    ) -> None:
        """Takes in a sample of the next stage, and of those after it that it decides."""
        monitors = self._monitors
        while self._reached < self._count:
            height = alone[self._reached](values)
            if height < 0:
                if height != self._height:  # else the greatest so far, once more
                    self._approach(height)
                return
            if monitors.deciders or monitors.alone[self._reached].verdict <= 0:
                self._approach(height)
                return
            self._reach(self._reached + 1)

    def _holding(self, values: Sequence[float]) -> Sequence[float]:
        """The values, with the last ones in the places of those that are nan."""
        held = self._held or values
        self._held = [last if math.isnan(v) else v for v, last in zip(values, held, strict=True)]
        return self._held

    def finish(self, end: End) -> None:
        deciders = self._monitors.deciders
        for monitor in deciders[self._reached :]:
            monitor.finish(end)
        if deciders:
            self._decide()
        if self._monitors.judge.verdict > 0:
            self.progress = 1.0

    def _decide(self) -> None:
        """Counts the stages that are decided."""
        deciders, reached = self._monitors.deciders, self._reached
        while reached < len(deciders) and deciders[reached].verdict > 0:
            reached += 1
        if reached > self._reached:
            self._reach(reached)

    def _reach(self, reached: int) -> None:
        """Takes in that so many stages are decided."""
        self._reached, self._height, self._began = reached, math.nan, math.nan
        self.progress = max(self.progress, min(reached / self._count, _ALMOST))

    def _approach(self, height: float) -> None:
        """Takes in the robustness of the next stage."""
        self._height, began = height, self._began
        if math.isnan(began):
            began = _NO_WAY
            if math.isfinite(height):
                self._began = began = height if height < 0 else _NO_WAY
        now = _place(self._reached, self._count, height, began, min, max)
        self.progress = max(self.progress, now)

    def state(self) -> tuple[Any, ...]:
        machines = [machine_state(monitor) for monitor in self._monitors.every]
        return machines, self.progress, self._reached, self._height, self._began, self._held

    def restore(self, state: tuple[Any, ...]) -> None:
        machines, self.progress, self._reached, self._height, self._began, held = state
        self._held = [*held]
        for monitor, each in zip(self._monitors.every, machines, strict=True):
            monitor.__setstate__(each)


class VectorStageProgress:
    """The vector twin of `StageProgress`: its arrays have a number for every environment.

    It takes the arguments of `StageProgress`, the number of environments, and the names of the
    columns of the tables that are fed.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        judges: Mapping[str, VectorEpisodeMonitor],
        reading: Reading,
        num: int,
        columns: Sequence[str],
    ) -> None:
        def make(part: rtamt.Specification, **options: Any) -> VectorEpisodeMonitor:  # noqa: ANN401
            return VectorEpisodeMonitor(part, num, **options)

        self._courses = {
            name: _VectorCourse(monitors, num, columns, hold=reading.nan == "hold")
            for name, monitors in _monitors_of(specs, judges, reading, make).items()
        }

    def __bool__(self) -> bool:
        """Whether there is a requirement with stages."""
        return bool(self._courses)

    @property
    def values(self) -> dict[str, Floats]:
        """The progress of each requirement that has stages, by its name; fresh arrays."""
        return {name: course.progress.copy() for name, course in self._courses.items()}

    @property
    def least(self) -> Floats:
        """The least progress over the requirements that have one; a fresh array."""
        found: Floats = np.minimum.reduce([course.progress for course in self._courses.values()])
        return found

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        for course in self._courses.values():
            course.reset(lanes)

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all."""
        for course in self._courses.values():
            course.feed(table, lanes)

    def finish(self, lanes: Lanes, end: End) -> None:
        """Ends the traces of the environments of the mask, after the judges have."""
        for course in self._courses.values():
            course.finish(lanes, end)


class _VectorCourse:
    """The progress of one requirement in many environments; see `_Course`."""

    def __init__(
        self,
        monitors: _Monitors[VectorEpisodeMonitor],
        num: int,
        columns: Sequence[str],
        *,
        hold: bool,
    ) -> None:
        self._monitors = monitors
        self._count = len(monitors.alone)
        self._picks = {
            monitor: pick([columns.index(name) for name in monitor.variables])
            for monitor in monitors.every
        }
        self.progress: Floats = np.zeros(num)
        self._began: Floats = np.full(num, np.nan)
        self._reached = np.zeros(num, np.int64)
        self._held: Floats | None = np.full((num, len(columns)), np.nan) if hold else None

    def reset(self, lanes: Lanes | None) -> None:
        for monitor in self._monitors.every:
            monitor.reset(lanes)
        which = slice(None) if lanes is None else lanes
        self.progress[which] = 0.0
        self._began[which] = np.nan
        self._reached[which] = 0  # what is held waits: the judge takes no nan at the first sample

    def feed(self, table: Floats, lanes: Lanes | None) -> None:
        if self._held is not None:
            fed = ~np.isnan(table) if lanes is None else ~np.isnan(table) & lanes[:, None]
            np.copyto(self._held, table, where=fed)
            table = self._held
        deciders, alone = self._monitors.deciders, self._monitors.alone
        for stage, monitor in enumerate(deciders):
            needed = self._reached <= stage  # elsewhere the verdict is certain
            if lanes is not None:
                needed &= lanes
            self._update(monitor, table, needed)
        self._settle(lanes)
        if deciders:
            self._decide()
        for stage, monitor in enumerate(alone):
            following = (self._reached == stage) & (self.progress < 1.0)
            if lanes is not None:
                following &= lanes
            heights = self._update(monitor, table, following)
            if heights is None:
                continue
            if not deciders:
                over = following & (monitor.verdict > 0)
                self._reach(over, stage + 1)
                following &= ~over
            self._approach(following, heights[following], stage)

    def _update(self, monitor: VectorEpisodeMonitor, table: Floats, lanes: Lanes) -> Floats | None:
        """Feeds the environments of the mask; None if there are none."""
        count = np.count_nonzero(lanes)
        if count == 0:
            return None
        rows = table[:, self._picks[monitor]]
        return monitor.update(rows, None if count == len(lanes) else lanes)

    def finish(self, lanes: Lanes, end: End) -> None:
        deciders = self._monitors.deciders
        for stage, monitor in enumerate(deciders):
            monitor.finish(lanes & (self._reached <= stage), end=end)
        if deciders:
            self._decide()
        self._settle(lanes)

    def _settle(self, lanes: Lanes | None) -> None:
        """Takes in which requirements are satisfied."""
        satisfied = self._monitors.judge.verdict > 0
        self.progress[satisfied if lanes is None else satisfied & lanes] = 1.0

    def _decide(self) -> None:
        """Counts the stages that are decided; verdicts stay until the reset."""
        for stage, monitor in enumerate(self._monitors.deciders):
            self._reach((self._reached == stage) & (monitor.verdict > 0), stage + 1)

    def _reach(self, lanes: Lanes, reached: int) -> None:
        """Takes in that so many stages are decided."""
        self._reached[lanes] = reached
        self._began[lanes] = np.nan
        least = min(reached / self._count, _ALMOST)
        self.progress[lanes] = np.maximum(self.progress[lanes], least)

    def _approach(self, lanes: Lanes, heights: Floats, reached: int) -> None:
        """Takes in the robustness of the next stage, in environments that are at the same."""
        began = self._began[lanes]
        first = np.isnan(began) & np.isfinite(heights)
        began = np.where(first, np.where(heights < 0, heights, _NO_WAY), began)
        self._began[lanes] = began
        began = np.where(np.isnan(began), _NO_WAY, began)
        now = _place(reached, self._count, heights, began, np.minimum, np.maximum)
        self.progress[lanes] = np.maximum(self.progress[lanes], now)
