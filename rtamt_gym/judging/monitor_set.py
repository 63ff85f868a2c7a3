"""The monitors of several specifications in one environment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, partial
from typing import Any

import numpy as np

import rtamt
from rtamt import EpisodeMonitor, InputError, Specification, Verdict, holds
from rtamt.errors import Argument
from rtamt.internal import JointFeed, JointRead
from rtamt.typing import End
from rtamt_gym.judging.costs import Cost, CostMeter
from rtamt_gym.judging.infos import VERDICTS, optional_keys, outcome, present, spec_state
from rtamt_gym.judging.monitors import (
    InstantMonitor,
    MonitorValues,
    described,
    machine_state,
    make_monitors,
    picked,
    require_known,
)
from rtamt_gym.judging.obligations import Obligation, SingleObligations
from rtamt_gym.judging.stages import StageProgress, stage_progress
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.shaping import least
from rtamt_gym.signals.signals import ElementRead, MovingRead, Read, SlotRead

Assessment = tuple[float, float, float]
"""Robustness of the samples so far, and its lower and upper bound."""

Feed = Callable[..., Assessment]
"""Gives one sample to the monitors of a monitor set; takes the arguments of a `Read`."""

Take = Callable[..., object]
"""A `Feed` without a result."""

Monitors = dict[str, tuple[EpisodeMonitor | InstantMonitor, EpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""

MonitorSetResult = tuple[str, tuple[float, float, float], Verdict, int | None, int | None]
"""The result of a specification: name; robustness, lower and upper bound; verdict; the sample that
decided the verdict, or None; the last sample if only the end decided it, or None."""

SeeValues = Callable[[Sequence[float]], None]
"""Takes the values of a sample."""

_Pick = Callable[[Sequence[float]], tuple[float, ...]]


class MonitorSet:
    """The monitors of several specifications, updated together, and their decided verdicts.

    Attributes:
        monitors: The monitors of each specification: ``(robustness source, judge)``.
        variables: The variables of each specification.
        of_instant: True if the robustness is the robustness of an instant; otherwise None.
        settled: The number of decided verdicts.
        number: The class of the numbers of an `Assessment`: ``float`` or ``numpy.float64``.
        violated_by: The specification that was violated first, or None.
        period_number: Seconds between samples; None if bounds count samples. A plain attribute:
            a cached property would slow every other attribute of the object down.

    Raises:
        RtamtError: As `make_monitors`, `CostMeter` and `stage_progress` do.
    """

    def __init__(
        self,
        specs: Mapping[str, Specification],
        reading: EvaluationOptions,
        cost: Cost | None = None,
        *,
        history: bool = False,
        number: type[float] = float,
    ) -> None:
        self.number = number
        self._look: Callable[[], Assessment] | None = None
        self.monitors: Monitors = make_monitors(
            specs,
            reading,
            of_episode=partial(EpisodeMonitor, history=history),
            of_instants=partial(InstantMonitor, history=history),
        )
        self.variables = {name: spec.variables for name, spec in specs.items()}
        self._specs, self._reading = specs, reading
        self._sources = [source for source, _ in self.monitors.values()]
        self._judges = [judge for _, judge in self.monitors.values()]
        self.period_number = None if self.period is None else np.float64(self.period)
        if cost is not None:
            require_known(reading, Argument("cost", cost))
        self._meter = cost and CostMeter(cost, specs, reading)
        self._owing: SingleObligations | None = None
        judges = {name: judge for name, (_, judge) in self.monitors.items()}
        self._stages = stage_progress(specs, judges, reading)
        # What takes every sample in addition to the monitors.
        self._measures: list[CostMeter | SingleObligations | StageProgress] = [
            *([self._meter] if self._meter else []),
            *self._stages.values(),
        ]
        self._settled: dict[str, int] = {}  # the sample that decided; the last if only the end did
        self._ended: frozenset[str] = frozenset()  # the specifications that only the end decided
        self._failed: frozenset[str] = frozenset()  # what `finish("failure")` violated
        self.of_instant = True if reading.view == "step" else None
        self.settled = 0
        self.violated_by: str | None = None
        self.optional_keys = optional_keys(self)

    def track_obligations(self) -> list[list[Obligation]]:
        """Track pending obligations in each `feeder` from now on; return the operators."""
        if self._owing is None:
            require_known(self._reading, Argument("observe", "obligations"))
            judged = {name: judge.specification for name, (_, judge) in self.monitors.items()}
            self._owing = SingleObligations(judged, self._reading)
            self._measures.append(self._owing)
        return self._owing.found

    @property
    def tracks_obligations(self) -> bool:
        """Whether it tracks pending obligations."""
        return self._owing is not None

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None if bounds count samples."""
        return self._judges[0].period

    @cached_property
    def _described(self) -> dict[str, str]:
        return {
            name: described(spec, judge)
            for (name, spec), judge in zip(self._specs.items(), self._judges, strict=True)
        }

    @property
    def samples(self) -> int:
        """Samples since the reset."""
        return self._judges[0].samples

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation, the last if only the end did; or None."""
        return None if self.violated_by is None else self._settled[self.violated_by]

    @property
    def progress(self) -> dict[str, float]:
        """The progress of each requirement in stages, by its name."""
        return {name: part.progress for name, part in self._stages.items()}

    @property
    def least_progress(self) -> np.float64 | None:
        """The minimum progress over the requirements in stages; None without stages."""
        return np.float64(min(self.progress.values())) if self._stages else None

    @property
    def tells_more(self) -> bool:
        """Whether it adds keys to an info in addition to an `Assessment`."""
        return self._meter is not None or bool(self.optional_keys)

    @property
    def all_decided(self) -> bool:
        """Whether every verdict is decided."""
        return self.settled == len(self.monitors)

    @property
    def success(self) -> bool:
        """Whether every specification is satisfied."""
        return self.all_decided and self.violated_by is None

    @property
    def violated(self) -> list[str]:
        """The specifications that are certainly violated, in the order of their decisions."""
        return [
            name
            for name in self._settled
            if self._verdict(name, self.monitors[name][1]) is Verdict.VIOLATED
        ]

    def satisfies(self, name: str) -> bool:
        """Return whether a specification is certainly satisfied."""
        return self.monitors[name][1].verdict > 0

    def knows(self, above: Mapping[str, float]) -> bool:
        """Return whether each robustness is final, or stays above a value in ``above``."""
        return all(
            judge.lower == judge.upper or judge.lower > above.get(name, math.inf)
            for name, (_, judge) in self.monitors.items()
        )

    @property
    def undecided(self) -> list[str]:
        """The specifications without a decided verdict."""
        return [name for name in self.monitors if name not in self._settled]

    @property
    def robustness(self) -> float:
        """The minimum robustness over the specifications; nan before the first sample."""
        return least([source.robustness for source in self._sources])

    @property
    def lower(self) -> float:
        """The lower bound of the robustness."""
        return least([judge.lower for judge in self._judges])

    @property
    def upper(self) -> float:
        """The upper bound of the robustness."""
        return least(self._uppers())

    def _uppers(self) -> list[float]:
        return [self._upper(name, judge) for name, (_, judge) in self.monitors.items()]

    def _upper(self, name: str, judge: EpisodeMonitor) -> float:
        return -0.0 if name in self._failed else judge.upper

    def read(self, *_: object) -> Assessment:
        """Return the assessment of the samples so far; the arguments of a `Feed` have no effect."""
        if self._look is not None and not self._failed:
            return self._look()
        number = self.number
        return number(self.robustness), number(self.lower), number(self.upper)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_look": None}  # the next `feeder` sets it

    def feeder(
        self,
        names: Sequence[str],
        reads: Sequence[Read] | None = None,
        *,
        decide: Callable[[], None] | None = None,
        keep: SeeValues | None = None,
    ) -> Feed:
        """Return the function that gives one sample to all monitors.

        Without ``reads`` its argument is the sample, a value for each name. ``decide`` replaces
        `note` after a sample that decides a verdict. ``keep`` gets the values of every sample after
        all monitors took it.
        """
        note, see = decide or self.note, together(*self._measuring(names), keep)
        joint = None if reads is None else self._joint(names, reads, note, see)
        if reads is None or joint is None:
            return self._one_by_one(names, reads, note, keep)
        moving = next((read for read in reads if isinstance(read, MovingRead)), None)
        if moving is None:
            return joint.feed
        home, feed = moving.home(), joint.feed

        def feed_here(*step: Any) -> Assessment:  # noqa: ANN401 - the arguments of a `Read`
            nonlocal feed, home
            now = moving.home()
            if now is not home:
                there = self._joint(names, reads, note, see)
                assert there is not None  # noqa: S101 - the monitors are the same
                feed, home = there.feed, now
            return feed(*step)

        return feed_here

    def taker(
        self, names: Sequence[str], reads: Sequence[Read], keep: SeeValues | None = None
    ) -> Take:
        """Return a `feeder` without a result; make another after a `MovingRead` has moved."""
        joint = self._joint(names, reads, self.note, together(*self._measuring(names), keep))
        return self._one_by_one(names, reads, self.note, keep) if joint is None else joint.take

    def _measuring(self, names: Sequence[str]) -> list[SeeValues | None]:
        """Return the functions that take every sample in addition to the monitors."""
        return [measure.feeder(names) for measure in self._measures]

    def _one_by_one(
        self,
        names: Sequence[str],
        reads: Sequence[Read] | None,
        note: Callable[[], None],
        keep: SeeValues | None,
    ) -> Feed:
        """Return the `feeder` that updates one monitor after the other."""
        parts = [
            (source.update, *picked([names.index(v) for v in self.variables[name]]), judge)
            for name, (source, judge) in self.monitors.items()
        ]
        # The values are in the same list at every sample.
        copied = keep and (lambda values: keep(tuple(values)))
        see = together(*self._measuring(names), copied)
        return one_by_one(parts, len(names), reads, self, note, see)

    def _joint(
        self,
        names: Sequence[str],
        reads: Sequence[Read],
        note: Callable[[], None],
        see: SeeValues | None,
    ) -> JointFeed | None:
        """Return an object that updates all monitors in one call of C++, or None."""
        judges = self._judges
        if self.of_instant:
            return None

        def decided(count: int) -> None:
            if count > self.settled:
                note()

        joint = rtamt.internal.joint_feed(
            judges,
            names,
            [joint_read(read) for read in reads],
            decided=decided,
            seen=see,
            number=self.number,
        )
        if joint is None:
            return None
        self._look = joint.look
        return joint

    def reset(self) -> None:
        for source in self._sources:
            source.reset()
        for measure in self._measures:
            measure.reset()
        self._settled = {}
        self._ended = self._failed = frozenset()
        self.settled = 0
        self.violated_by = None

    def note(self) -> None:
        """Record the verdicts that the last sample, or the end of the trace, decided."""
        for name, (_, judge) in self.monitors.items():
            if judge.verdict != 0 and name not in self._settled:
                self._settled[name] = judge.samples - 1
                if judge.verdict < 0 and self.violated_by is None:
                    self.violated_by = name
        self.settled = len(self._settled)

    def cut_windows(self) -> frozenset[str]:
        """Return undecided specifications with a bounded window that reaches past the last sample.

        The end satisfies them as complete, but not as cut.
        """
        return frozenset(
            name
            for name in self.undecided
            if self._specs[name].timed
            and holds(self.monitors[name][1].robustness)
            and _open_if_cut(self.monitors[name][1])
        )

    def finish(self, end: AtTermination | End = "complete") -> Assessment:
        """End the trace with an end mode; ``"failure"`` violates every undecided specification."""
        was_open = self.undecided
        if end == "failure":
            self._fail()
        else:
            for judge in self._judges:
                judge.finish(end)
            for stages in self._stages.values():
                stages.finish(end)
            self.note()
        if was_open:
            self._ended |= self._settled.keys() & was_open
        return self.read()

    def _fail(self) -> None:
        self._failed = frozenset(self.undecided)
        for name in self.undecided:
            self._settled[name] = self.samples - 1
            if self.violated_by is None:
                self.violated_by = name
        self.settled = len(self._settled)

    def take_costs(self) -> dict[str, np.float64] | None:
        """Return the costs of the step, or None if nothing measures them."""
        if self._meter is None:
            return None
        return self._meter.take(
            [self._verdict(name, judge) < 0 for name, (_, judge) in self.monitors.items()]
        )

    def begin(self) -> None:
        """Start a step: the sample of a reset costs nothing."""
        if self._meter is not None:
            self._meter.begin()

    def _verdict(self, name: str, judge: EpisodeMonitor) -> Verdict:
        return Verdict.VIOLATED if name in self._failed else judge.verdict

    def values(self) -> MonitorValues[float]:
        """Return the values of all monitors."""
        return MonitorValues(
            [source.robustness for source in self._sources],
            [judge.robustness for judge in self._judges],
            [judge.lower for judge in self._judges],
            self._uppers(),
            [float(self._verdict(name, judge)) for name, (_, judge) in self.monitors.items()],
            self.samples,
            None if self._owing is None else self._owing.owed(),
        )

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the state of every specification: ``info["stl"]``."""
        progress = {name: np.float64(part.progress) for name, part in self._stages.items()}
        return {
            name: spec_state(
                np.float64(source.robustness),
                np.float64(judge.lower),
                np.float64(self._upper(name, judge)),
                _NAMES[self._verdict(name, judge)],
                self.of_instant,
                progress.get(name),
            )
            for name, (source, judge) in self.monitors.items()
        }

    def outcomes(self) -> dict[str, dict[str, Any]]:
        """Return the outcome of every specification so far: ``info["stl_episode"]``."""
        outcomes = {}
        for name, (_, judge) in self.monitors.items():
            robustness, verdict = np.float64(judge.robustness), self._verdict(name, judge)
            sample, ended = self._settled.get(name), name in self._ended
            decided = sample is not None and not ended
            by_end = verdict < 0 and math.copysign(1.0, robustness) > 0
            outcomes[name] = present(
                outcome(robustness, verdict, verdict > 0, sample, decided, ended, bool(by_end))
            )
        for name, progress in self.progress.items():
            outcomes[name]["progress"] = np.float64(progress)
        return outcomes

    def results(self) -> list[MonitorSetResult]:
        """Return the result of every specification so far."""
        results: list[MonitorSetResult] = []
        for name, (_, judge) in self.monitors.items():
            bounds = judge.robustness, judge.lower, self._upper(name, judge)
            sample = self._settled.get(name)
            moments = (None, sample) if name in self._ended else (sample, None)
            results.append((name, bounds, self._verdict(name, judge), *moments))
        return results

    def state(self) -> tuple[Any, ...]:
        """Return the state of the monitors, small and fit for pickle."""
        sources = [
            source.state() if isinstance(source, InstantMonitor) else machine_state(source)
            for source in self._sources
        ]
        stages = [part.state() for part in self._stages.values()]
        settled = dict(self._settled), self._ended
        return self._described, sources, settled, self.violated_by, stages

    def restore(self, state: tuple[Any, ...]) -> None:
        """Restore a `state`; raise InputError for a state of other specifications."""
        described, sources, settled, violated_by, stages = state
        if described != self._described:
            raise InputError(
                f"expected a state of the specifications {self._described}, got a state of "
                f"{described}"
            )
        for source, held in zip(self._sources, sources, strict=True):
            if isinstance(source, InstantMonitor):
                source.restore(held)
            else:
                source.__setstate__(held)
        for part, held in zip(self._stages.values(), stages, strict=True):
            part.restore(held)
        self._settled, self._ended = dict(settled[0]), settled[1]
        self._failed = frozenset()
        self.settled = len(self._settled)
        self.violated_by = violated_by


def _open_if_cut(judge: EpisodeMonitor) -> bool:
    """Return whether the verdict stays undecided if the trace is cut; keep the monitor's state."""
    state = machine_state(judge)
    judge.finish("cut")
    undecided = judge.verdict is Verdict.UNDECIDED
    judge.__setstate__(state)
    return undecided


_NAMES = tuple(VERDICTS)  # twice as fast as the name of an enum member


def joint_read(read: Read) -> JointRead:
    """Return the reader of a signal in C++, without a call if the position is known."""
    if isinstance(read, ElementRead):
        key: int | str | tuple[int, ...] = read.index
        return key
    if isinstance(read, MovingRead):
        read = read.now()
    if isinstance(read, SlotRead):
        return read.array, read.index
    return read


def one_by_one(  # noqa: C901 - each part in a function of its own would double its time
    parts: Sequence[tuple[Callable[..., float], int, _Pick | None, EpisodeMonitor]],
    size: int,
    reads: Sequence[Read] | None,
    fed: MonitorSet,
    note: Callable[[], None],
    see: SeeValues | None,
) -> Feed:
    """Return the function that reads a sample and updates one monitor after the other.

    It returns the result of `rtamt.internal.joint_feed`. A part is the update of a monitor, the
    index of its only variable, or -1 and a function that selects several, and its judge.
    """
    numbered = list(enumerate(reads or ()))
    elements = [(i, read.index) for i, read in numbered if isinstance(read, ElementRead)]
    others = [(i, read) for i, read in numbered if not isinstance(read, ElementRead)]
    read_values = [math.nan] * size
    number, undecided = fed.number, Verdict.UNDECIDED

    def feed(  # noqa: C901 - see above
        obs: Any = None,  # noqa: ANN401
        action: Any = None,  # noqa: ANN401
        reward: Any = None,  # noqa: ANN401
        info: Any = None,  # noqa: ANN401
    ) -> Assessment:
        if reads is None:
            values = obs
        else:
            values = read_values
            for position, index in elements:
                values[position] = float(obs[index])
            for position, read in others:
                values[position] = read(obs, action, reward, info)
        robustness = lower = upper = math.inf
        decided = 0
        for update, only, pick, judge in parts:
            value = update(values[only]) if pick is None else update(*pick(values))
            low = judge.lower
            high = judge.upper
            # Calls of min() would double the time.
            if value < robustness:  # noqa: PLR1730
                robustness = value
            if low < lower:  # noqa: PLR1730
                lower = low
            if high < upper:  # noqa: PLR1730
                upper = high
            if judge.verdict is not undecided:
                decided += 1
        if decided > fed.settled:
            note()
        if see is not None:
            see(values)
        if not (robustness and lower and upper):  # comparisons ignore the sign of a zero
            return fed.read()
        return number(robustness), number(lower), number(upper)

    return feed


def together(*functions: SeeValues | None) -> SeeValues | None:
    """Return a function that calls these functions, some of which may be None; or None."""
    some = [function for function in functions if function is not None]
    if len(some) < 2:
        return some[0] if some else None

    def see(values: Sequence[float]) -> None:
        for function in some:
            function(values)

    return see
