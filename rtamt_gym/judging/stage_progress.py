"""How far episodes have come in requirements that ask for one thing after another.

A requirement with `rtamt.patterns.stages` has a progress from 0 to 1 beside its verdict. Let n be
the number of its stages, and k the number of those that are decided: the requirement cut behind
stage k is satisfied for certain. The progress is 1 if k = n, which is to say that the requirement
is satisfied. Before that it is

    (k + f) / n,

where f is the share of the way that stage k + 1 has made. Its robustness r is the greatest that the
stage has had since stage k was decided: that of ``eventually(stage)`` on the samples from that one
on, if the episode ended now. It sets out from r0, its first finite value, and what is to be reached
is 0: f is ``1 - r / r0``, no less than 0, and 1 where r holds already and only certainty is
missing. So f depends on the unit of a quantity only in the ratio ``r / r0``. However near the stage
is, the progress stays below ``(k + 1) / n`` until it is decided. The progress of an episode never
falls: it is the greatest so far.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import rtamt
from rtamt import End, EpisodeMonitor, VectorEpisodeMonitor
from rtamt.patterns import prefixes, stages
from rtamt_gym.judging.costs import options_of_parts
from rtamt_gym.judging.monitors import machine_state
from rtamt_gym.judging.obligations import bare
from rtamt_gym.judging.picking import pick, picked
from rtamt_gym.judging.reading import Reading

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["StageProgress", "VectorStageProgress", "progress_of"]


def progress_of(
    spec: rtamt.Specification, columns: Mapping[str, Floats], reading: Reading
) -> float | None:
    """The progress of a whole trace of samples; None if the requirement is not in stages.

    Args:
        spec: The requirement.
        columns: The values of its variables, and of others.
        reading: How samples and the end are judged, with their period.
    """
    if not stages(spec):
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


def _in_stages(
    specs: Mapping[str, rtamt.Specification], reading: Reading, make: Callable[..., Any]
) -> dict[str, tuple[list[Any], list[Any]]]:
    """The monitors of each requirement in stages: cut behind each stage but the last, and of each.

    With ``view="step"`` a verdict is about every instant, and has no stages.
    """
    if reading.view == "step":
        return {}
    parts = {
        name: [
            *(bare(spec, prefix) for prefix in prefixes(spec)[:-1]),
            *(bare(spec, stage.eventually()) for stage in stages(spec)),
        ]
        for name, spec in specs.items()
        if stages(spec)
    }
    flat = [part for each in parts.values() for part in each]
    options = iter(options_of_parts(specs, flat, reading) if flat else ())
    made = {name: [make(part, **next(options)) for part in each] for name, each in parts.items()}
    return {name: (each[: len(each) // 2], each[len(each) // 2 :]) for name, each in made.items()}


class StageProgress:
    """The progress of the requirements that are in stages, in one environment.

    Args:
        specs: The specifications by name.
        judges: The monitor of each, fed before this is.
        reading: How samples are judged.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        judges: Mapping[str, EpisodeMonitor],
        reading: Reading,
    ) -> None:
        self._courses = {
            name: _Course(*monitors, judges[name])
            for name, monitors in _in_stages(specs, reading, EpisodeMonitor).items()
        }

    def __bool__(self) -> bool:
        """Whether there is a requirement in stages."""
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
        parts: The monitors of the requirement cut behind each stage but the last.
        alone: The monitor of each stage.
        judge: The monitor of the whole.
    """

    def __init__(
        self, parts: list[EpisodeMonitor], alone: list[EpisodeMonitor], judge: EpisodeMonitor
    ) -> None:
        self._parts, self._alone, self._judge = parts, alone, judge
        self._count = len(alone)
        self._start()

    def _start(self) -> None:
        self.progress = 0.0
        self._began = math.nan  # r0 of the stage that is next
        self._reached = 0  # stages decided

    def reset(self) -> None:
        for monitor in (*self._parts, *self._alone):
            monitor.reset()
        self._start()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        def update_of(monitor: EpisodeMonitor) -> Callable[[Sequence[float]], float]:
            place, several = picked([names.index(name) for name in monitor.variables])
            update = monitor.update
            if several is None:
                return lambda values: update(values[place])
            return lambda values: update(*several(values))

        parts = [update_of(monitor) for monitor in self._parts]
        alone = [update_of(monitor) for monitor in self._alone]
        count = self._count

        def feed(values: Sequence[float]) -> None:
            if self._reached == count:
                return
            for update in parts[self._reached :]:  # the verdicts before them are certain
                update(values)
            self._decide()
            if self._reached < count:
                self._approach(alone[self._reached](values))

        return feed

    def finish(self, end: End) -> None:
        for monitor in self._parts[self._reached :]:
            monitor.finish(end)
        self._decide()

    def _decide(self) -> None:
        """Counts the stages that are decided."""
        monitors = (*self._parts, self._judge)
        reached = self._count
        while reached > self._reached and monitors[reached - 1].verdict <= 0:
            reached -= 1
        if reached > self._reached:
            self._reached, self._began = reached, math.nan
            self.progress = max(self.progress, reached / self._count)

    def _approach(self, height: float) -> None:
        """Takes in the robustness of the next stage."""
        if math.isnan(self._began) and math.isfinite(height):
            self._began = height
        began, reached, count = self._began, self._reached, self._count
        share = 0.0
        if height >= 0:
            share = 1.0
        elif began < 0:
            share = max(1.0 - height / began, 0.0)
        now = min((reached + share) / count, math.nextafter((reached + 1) / count, 0.0))
        self.progress = max(self.progress, now)

    def state(self) -> tuple[Any, ...]:
        held = [machine_state(monitor) for monitor in (*self._parts, *self._alone)]
        return held, self.progress, self._began, self._reached

    def restore(self, state: tuple[Any, ...]) -> None:
        held, self.progress, self._began, self._reached = state
        for monitor, each in zip((*self._parts, *self._alone), held, strict=True):
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
            name: _VectorCourse(*monitors, judges[name], columns)
            for name, monitors in _in_stages(specs, reading, make).items()
        }

    def __bool__(self) -> bool:
        """Whether there is a requirement in stages."""
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
        parts: list[VectorEpisodeMonitor],
        alone: list[VectorEpisodeMonitor],
        judge: VectorEpisodeMonitor,
        columns: Sequence[str],
    ) -> None:
        self._parts, self._alone, self._judge = parts, alone, judge
        self._count, num = len(alone), judge.num
        self._picks = {
            monitor: pick([columns.index(name) for name in monitor.variables])
            for monitor in (*parts, *alone)
        }
        self.progress: Floats = np.zeros(num)
        self._began: Floats = np.full(num, np.nan)
        self._reached = np.zeros(num, np.int64)

    def reset(self, lanes: Lanes | None) -> None:
        for monitor in (*self._parts, *self._alone):
            monitor.reset(lanes)
        which = slice(None) if lanes is None else lanes
        self.progress[which] = 0.0
        self._began[which] = np.nan
        self._reached[which] = 0

    def feed(self, table: Floats, lanes: Lanes | None) -> None:
        for stage, monitor in enumerate(self._parts):
            needed = self._reached <= stage  # elsewhere the verdict is certain
            if lanes is not None:
                needed &= lanes
            self._update(monitor, table, needed)
        self._decide()
        for stage, monitor in enumerate(self._alone):
            following = self._reached == stage
            if lanes is not None:
                following &= lanes
            heights = self._update(monitor, table, following)
            if heights is not None:
                self._approach(following, heights[following], stage)

    def _update(self, monitor: VectorEpisodeMonitor, table: Floats, lanes: Lanes) -> Floats | None:
        """Feeds the environments of the mask; None if there are none."""
        count = np.count_nonzero(lanes)
        if count == 0:
            return None
        rows = table[:, self._picks[monitor]]
        return monitor.update(rows, None if count == len(lanes) else lanes)

    def finish(self, lanes: Lanes, end: End) -> None:
        for stage, monitor in enumerate(self._parts):
            monitor.finish(lanes & (self._reached <= stage), end=end)
        self._decide()

    def _decide(self) -> None:
        """Counts the stages that are decided; verdicts stay until the reset."""
        reached = np.zeros_like(self._reached)
        for number, monitor in enumerate((*self._parts, self._judge), 1):
            reached[monitor.verdict > 0] = number
        self._began[reached > self._reached] = np.nan
        self._reached = reached
        np.maximum(self.progress, reached / self._count, out=self.progress)

    def _approach(self, lanes: Lanes, heights: Floats, reached: int) -> None:
        """Takes in the robustness of the next stage, in environments that are at the same."""
        began = self._began[lanes]
        began = np.where(np.isnan(began) & np.isfinite(heights), heights, began)
        self._began[lanes] = began
        way = (heights < 0) & (began < 0)
        ratio = np.divide(heights, began, out=np.ones_like(heights), where=way)
        share = np.where(heights >= 0, 1.0, np.maximum(1.0 - ratio, 0.0))
        most = np.nextafter((reached + 1) / self._count, 0.0)
        now = np.minimum((reached + share) / self._count, most)
        self.progress[lanes] = np.maximum(self.progress[lanes], now)
