"""Stages of requirements, and the progress of episodes in them.

``stages=`` sets the stages of a requirement; otherwise, `rtamt.patterns.stages` finds them. A
requirement with stages has a progress from 0 to 1 next to its verdict. Let n be the number of its
stages and k the number of decided stages: the requirement cut after stage k is certainly satisfied,
or, for named stages, ``in_order(stage 1, ..., stage k)`` is. The progress is 1 if the requirement
is satisfied; otherwise, it is

    (k + f) / n,

where f is the progress in stage k + 1. The robustness r of that stage is its maximum since stage k
was decided: the robustness of ``eventually(stage)`` on the samples since then, if the episode ended
now. f starts at r0, the first finite r, and reaches 1 when r reaches 0: it is ``1 - r / r0``, at
least 0, and 1 if r already holds and only certainty is missing. f depends on the unit of a quantity
only in the ratio ``r / r0``. The progress stays below ``(k + 1) / n`` until the stage is decided,
and below 1 until the requirement is satisfied. It never falls.

To change the definition of progress, change this module, which serves one environment and a batch,
and ``tests/support/staged.py``, which defines progress again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar, cast

import numpy as np

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    RtamtError,
    Specification,
    VectorEpisodeMonitor,
)
from rtamt.errors import Argument
from rtamt.patterns import in_order, named_stages, prefixes, stages
from rtamt.typing import End
from rtamt_gym.checks.arguments import check_known
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.infos import Entrywise
from rtamt_gym.judging.monitors import (
    bare,
    columns_of,
    machine_state,
    monitors_of_parts,
    update_of,
)
from rtamt_gym.options.evaluation import EvaluationOptions

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Entries, Floats

_M = TypeVar("_M", bound=EpisodeMonitor | VectorEpisodeMonitor)


@dataclass(frozen=True, slots=True)
class Stages:
    """The stages of a requirement.

    Attributes:
        conditions: The stages, in order.
        deciders: The formulas whose satisfaction decides the stages, in order; the requirement
            itself decides a last stage without a formula. Empty if each stage is decided at the
            first sample where it holds, from the decision of the stage before it on.
    """

    conditions: tuple[Formula, ...]
    deciders: tuple[Formula, ...] = ()


def stages_of(specs: Mapping[str, Specification], reading: EvaluationOptions) -> dict[str, Stages]:
    """Return the stages of each requirement with stages, by its name.

    Raises:
        InputError: If ``stages=`` names no requirement, or with ``view="step"``.
        SpecificationError: As `rtamt.patterns.named_stages` does.
    """
    named = _named(specs, reading)
    if reading.view == "step":  # a verdict about every instant has no stages
        return {}
    result = {}
    for name, spec in specs.items():
        if name in named:
            conditions = _read(name, spec, named[name])
            deciders = () if are_instant(conditions) else _chains(conditions)
            result[name] = Stages(conditions, deciders)
        elif conditions := stages(spec):
            # a requirement without times of its own equals its named stages
            plain = are_instant(conditions) and spec.formula is in_order(*conditions)
            result[name] = Stages(conditions, () if plain else prefixes(spec)[:-1])
    return result


def are_instant(conditions: Iterable[Formula]) -> bool:
    """Return whether formulas are about one sample only."""
    nodes = (node for condition in conditions for node in condition.nodes())
    return not any(node.op is not None and (node.op.timed or node.op.sampled) for node in nodes)


def _chains(conditions: Sequence[Formula]) -> tuple[Formula, ...]:
    """Return the first stage, the first two in order, and so on."""
    longer = (in_order(*conditions[:count]) for count in range(2, len(conditions) + 1))
    return conditions[0].eventually(), *longer


def _named(
    specs: Mapping[str, Specification], reading: EvaluationOptions
) -> Mapping[str, tuple[str, ...]]:
    """Return the texts of ``stages=``, by requirement."""
    texts = cast("tuple[str, ...] | dict[str, tuple[str, ...]] | None", reading.stages)
    if texts is None:
        return {}
    if reading.view == "step":
        raise InputError(
            Argument("stages"),
            " belong to an episode, and ",
            Argument("view", "step"),
            " evaluates every instant by itself; omit one",
        )
    if isinstance(texts, Mapping):
        check_known("stages", texts, specs)
        return texts
    if len(specs) > 1:
        raise InputError(
            Argument("stages"),
            ": expected the name of a requirement for the stages, because there are several, "
            f"{listing(specs)}; write {{{next(iter(specs))!r}: [...]}}",
        )
    return dict.fromkeys(specs, texts)


def _read(name: str, spec: Specification, texts: Sequence[str]) -> tuple[Formula, ...]:
    try:
        return named_stages(spec, texts)
    except RtamtError as error:
        error.add_note(f"in the stages of {name!r}")
        raise


def progress_of(
    spec: Specification, columns: Mapping[str, Floats], reading: EvaluationOptions
) -> float | None:
    """Return the progress of a trace of samples; None if the requirement has no stages."""
    if not stages_of({"": spec}, reading):
        return None
    judge = EpisodeMonitor(spec, **reading.from_monitors({"": spec})[""])
    progress = stage_progress({"": spec}, {"": judge}, reading)[""]
    feed = progress.feeder(spec.variables)
    for row in zip(*(columns[name].tolist() for name in spec.variables), strict=True):
        judge.update(*row)
        feed(row)
    judge.finish(reading.end)
    progress.finish(reading.end)
    return progress.progress


def progress_of_events(
    spec: Specification,
    signals: Mapping[str, tuple[Floats, Floats]],
    reading: EvaluationOptions,
    *,
    satisfied: bool,
) -> float | None:
    """Return the progress of a trace in dense time, or None.

    Signals are constant between events, so that stages without temporal operators are reached at
    events. None if stages, or the operators between them, have times of their own. ``signals`` are
    the times and values of the events of its variables, all of them known.
    """
    staged = stages_of({"": spec}, reading).get("")
    if staged is None or staged.deciders:
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
    options = reading.having(period=None).from_monitors({"": spec})[""]
    count, first = len(staged.conditions), 0
    for reached, stage in enumerate(staged.conditions):
        heights = rtamt.evaluate(bare(spec, stage), columns, n=len(every), **options)[first:]
        holds = ~np.signbit(heights)
        if not holds.any():
            began = next(filter(math.isfinite, heights.tolist()), _NO_WAY)
            height = float(heights.max())
            return float(_place(reached, count, height, began or _NO_WAY, min, max))
        first += int(holds.argmax())
    return _ALMOST


class _Monitors(NamedTuple, Generic[_M]):
    """The monitors of the deciders of a requirement, of ``eventually(stage)``, and its judge."""

    deciders: list[_M]
    alone: list[_M]
    judge: _M

    @property
    def every(self) -> list[_M]:
        return self.deciders + self.alone


def _monitors_of(
    specs: Mapping[str, Specification],
    judges: Mapping[str, _M],
    reading: EvaluationOptions,
    make: Callable[..., _M],
) -> dict[str, _Monitors[_M]]:
    """Return the monitors of each requirement with stages."""
    monitors = {}
    for name, staged in stages_of(specs, reading).items():
        formulas = [*staged.deciders, *(stage.eventually() for stage in staged.conditions)]
        parts = monitors_of_parts(specs, [bare(specs[name], f) for f in formulas], reading, make)
        count = len(staged.deciders)
        monitors[name] = _Monitors(parts[:count], parts[count:], judges[name])
    return monitors


def _place(
    reached: int,
    count: int,
    height: Entrywise,
    began: Entrywise,
    minimum: Callable[..., Entrywise],
    maximum: Callable[..., Entrywise],
) -> Entrywise:
    """Return the progress at a sample, without the progress before it.

    ``height`` is the robustness of the stage after the ``reached`` ones, and ``began`` its first
    finite robustness, below 0.
    """
    share = maximum(1.0 - minimum(height, 0.0) / began, 0.0)
    return minimum((reached + share) / count, math.nextafter((reached + 1) / count, 0.0))


_NO_WAY = -1.0
"""The first robustness of a stage that has no finite one below 0."""

_ALMOST = math.nextafter(1.0, 0.0)
"""The progress if all stages are decided and the requirement is not."""


def stage_progress(
    specs: Mapping[str, Specification],
    judges: Mapping[str, EpisodeMonitor],
    reading: EvaluationOptions,
) -> dict[str, StageProgress]:
    """Return the progress in one environment of each requirement with stages, by its name.

    A judge takes a sample before the progress of its specification does.

    Raises:
        RtamtError: As `stages_of` does, or if stages cannot be compiled.
    """
    monitors = _monitors_of(specs, judges, reading, EpisodeMonitor)
    return {n: StageProgress(m, hold=reading.nan == "hold") for n, m in monitors.items()}


class StageProgress:
    """The progress of a requirement in one environment; ``hold``: a nan repeats the last value."""

    def __init__(self, monitors: _Monitors[EpisodeMonitor], *, hold: bool) -> None:
        self._monitors, self._hold = monitors, hold
        self._count = len(monitors.alone)
        self._start()

    def _start(self) -> None:
        self.progress = 0.0
        self._reached = 0  # stages decided
        self._height = math.nan  # r of the stage that is next
        self._began = math.nan  # r0 of the stage that is next
        self._held: list[float] = []  # the last values that are not nan

    def reset(self) -> None:
        for monitor in self._monitors.every:
            monitor.reset()
        self._start()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        """Return the update function for samples with values in the order of these names."""
        deciders = [update_of(monitor, names) for monitor in self._monitors.deciders]
        singles = [update_of(monitor, names) for monitor in self._monitors.alone]
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
            next_stage(singles, values)

        return feed

    def _next_stage(
        self, alone: Sequence[Callable[[Sequence[float]], float]], values: Sequence[float]
    ) -> None:
        """Take a sample of the next stage, and of the stages after it that it decides."""
        monitors = self._monitors
        while self._reached < self._count:
            height = alone[self._reached](values)
            if height < 0:
                if height != self._height:  # otherwise the maximum so far again
                    self._approach(height)
                return
            if monitors.deciders or monitors.alone[self._reached].verdict <= 0:
                self._approach(height)
                return
            self._reach(self._reached + 1)

    def _holding(self, values: Sequence[float]) -> Sequence[float]:
        """Return the values, with the last value in place of each nan."""
        held = self._held or values
        self._held = [last if math.isnan(v) else v for v, last in zip(values, held, strict=True)]
        return self._held

    def finish(self, end: End) -> None:
        """End the trace, after the judge has."""
        deciders = self._monitors.deciders
        for monitor in deciders[self._reached :]:
            monitor.finish(end)
        if deciders:
            self._decide()
        if self._monitors.judge.verdict > 0:
            self.progress = 1.0

    def _decide(self) -> None:
        """Count the stages that are decided."""
        deciders, reached = self._monitors.deciders, self._reached
        while reached < len(deciders) and deciders[reached].verdict > 0:
            reached += 1
        if reached > self._reached:
            self._reach(reached)

    def _reach(self, reached: int) -> None:
        """Set the number of decided stages."""
        self._reached, self._height, self._began = reached, math.nan, math.nan
        self.progress = max(self.progress, min(reached / self._count, _ALMOST))

    def _approach(self, height: float) -> None:
        """Take the robustness of the next stage."""
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
        for monitor, machine in zip(self._monitors.every, machines, strict=True):
            monitor.__setstate__(machine)


def vector_stage_progress(
    specs: Mapping[str, Specification],
    judges: Mapping[str, VectorEpisodeMonitor],
    reading: EvaluationOptions,
    num: int,
    columns: Sequence[str],
) -> dict[str, VectorStageProgress]:
    """Return `stage_progress` for a batch; ``columns`` are the names of the columns of tables."""
    monitors = _monitors_of(specs, judges, reading, partial(VectorEpisodeMonitor, num=num))
    hold = reading.nan == "hold"
    return {n: VectorStageProgress(m, num, columns, hold=hold) for n, m in monitors.items()}


class VectorStageProgress:
    """The progress of a requirement in a batch of environments."""

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
        self._picks = {monitor: columns_of(monitor, columns) for monitor in monitors.every}
        self.progress: Floats = np.zeros(num)
        self._began: Floats = np.full(num, np.nan)
        self._reached = np.zeros(num, np.int64)
        self._held: Floats | None = np.full((num, len(columns)), np.nan) if hold else None

    def reset(self, entries: Entries | None) -> None:
        for monitor in self._monitors.every:
            monitor.reset(entries)
        which = slice(None) if entries is None else entries
        self.progress[which] = 0.0
        self._began[which] = np.nan
        self._reached[which] = 0  # `_held` stays: the judge refuses a nan at the first sample

    def feed(self, table: Floats, entries: Entries | None) -> None:
        """Take a row of the table for each environment in the mask; None: for all."""
        if self._held is not None:
            fed = ~np.isnan(table) if entries is None else ~np.isnan(table) & entries[:, None]
            np.copyto(self._held, table, where=fed)
            table = self._held
        deciders, singles = self._monitors.deciders, self._monitors.alone
        for stage, monitor in enumerate(deciders):
            needed = self._reached <= stage  # elsewhere the verdict is certain
            if entries is not None:
                needed &= entries
            self._update(monitor, table, needed)
        self._settle(entries)
        if deciders:
            self._decide()
        for stage, monitor in enumerate(singles):
            following = (self._reached == stage) & (self.progress < 1.0)
            if entries is not None:
                following &= entries
            heights = self._update(monitor, table, following)
            if heights is None:
                continue
            if not deciders:
                over = following & (monitor.verdict > 0)
                self._reach(over, stage + 1)
                following &= ~over
            self._approach(following, heights[following], stage)

    def _update(
        self, monitor: VectorEpisodeMonitor, table: Floats, entries: Entries
    ) -> Floats | None:
        """Update the environments in the mask; return None if the mask is empty."""
        count = np.count_nonzero(entries)
        if count == 0:
            return None
        rows = table[:, self._picks[monitor]]
        return monitor.update(rows, None if count == len(entries) else entries)

    def finish(self, entries: Entries, end: End) -> None:
        """End the traces of the environments in the mask, after the judges have."""
        deciders = self._monitors.deciders
        for stage, monitor in enumerate(deciders):
            monitor.finish(entries & (self._reached <= stage), end=end)
        if deciders:
            self._decide()
        self._settle(entries)

    def _settle(self, entries: Entries | None) -> None:
        """Set the progress of satisfied requirements."""
        satisfied = self._monitors.judge.verdict > 0
        self.progress[satisfied if entries is None else satisfied & entries] = 1.0

    def _decide(self) -> None:
        """Count the decided stages; verdicts stay until the reset."""
        for stage, monitor in enumerate(self._monitors.deciders):
            self._reach((self._reached == stage) & (monitor.verdict > 0), stage + 1)

    def _reach(self, entries: Entries, reached: int) -> None:
        """Set the number of decided stages."""
        self._reached[entries] = reached
        self._began[entries] = np.nan
        least = min(reached / self._count, _ALMOST)
        self.progress[entries] = np.maximum(self.progress[entries], least)

    def _approach(self, entries: Entries, heights: Floats, reached: int) -> None:
        """Take the robustness of the next stage, in environments that are at the same stage."""
        began = self._began[entries]
        first = np.isnan(began) & np.isfinite(heights)
        began = np.where(first, np.where(heights < 0, heights, _NO_WAY), began)
        self._began[entries] = began
        began = np.where(np.isnan(began), _NO_WAY, began)
        now = _place(reached, self._count, heights, began, np.minimum, np.maximum)
        self.progress[entries] = np.maximum(self.progress[entries], now)
