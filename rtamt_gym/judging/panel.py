"""The monitors of several specifications in one environment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, partial
from typing import Any

import numpy as np

import rtamt
from rtamt import End, EpisodeMonitor, InputError, JointFeed, Verdict, holds
from rtamt.errors import Argument
from rtamt_gym.judging.clocks import SingleObligations
from rtamt_gym.judging.costs import Cost, CostMeter
from rtamt_gym.judging.feeding import Assessment, Feed, Take, joint_read, one_by_one
from rtamt_gym.judging.infos import VERDICTS, outcome, present, spec_state
from rtamt_gym.judging.interface import described
from rtamt_gym.judging.monitors import InstantMonitor, machine_state, make_monitors, require_known
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.picking import picked, together
from rtamt_gym.judging.stage_progress import StageProgress
from rtamt_gym.judging.values import MonitorValues, read_values
from rtamt_gym.options.evaluation import AtTermination, Reading
from rtamt_gym.shaping import least
from rtamt_gym.signals.signals import MovingRead, Read

__all__ = ["Monitors", "Panel", "PanelResult"]

Monitors = dict[str, tuple[EpisodeMonitor | InstantMonitor, EpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""

PanelResult = tuple[str, tuple[float, float, float], Verdict, int | None, int | None]
"""What a specification has become: its name, its robustness with the lower and the upper bound, its
verdict, the sample that decided the verdict, or None, and the last sample if only the end did."""


class Panel:
    """The monitors of several specifications, fed together, and the verdicts they have decided.

    Its vector twin is `rtamt_gym.judging.vector_panel.VectorPanel`.

    Attributes:
        monitors: The monitors of each specification: ``(robustness source, judge)``.
        variables: The names that each specification reads.
        of_instant: True if the robustness is that of an instant, as with ``view="step"``; else
            None.
        settled: How many verdicts are decided, by a sample or by the end.
        number: The class of the numbers of an `Assessment`.
        violated_by: The specification that was violated first; None while none is.

    Args:
        specs: Specifications by name.
        reading: How samples are judged.
        cost: What `take_costs` measures; None: nothing.
        history: Whether the judges keep their samples, for explanations.
        number: The class of the numbers of an `Assessment`: ``float`` or ``numpy.float64``.

    Raises:
        SpecificationError: As `rtamt_gym.judging.monitors.make_monitors` and `CostMeter` do.
        InputError: As `rtamt_gym.judging.monitors.make_monitors` and `CostMeter` do.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        reading: Reading,
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
        self._specs = specs
        self._sources = [source for source, _ in self.monitors.values()]
        self._judges = [judge for _, judge in self.monitors.values()]
        if cost is not None:
            require_known(reading, Argument("cost", cost))
        self._meter = cost and CostMeter(cost, specs, reading)
        self._owing: SingleObligations | None = None
        judges = {name: judge for name, (_, judge) in self.monitors.items()}
        self._stages = StageProgress(specs, judges, reading) or None
        self._reading = reading
        self._settled: dict[str, int] = {}  # the sample that decided; the last if only the end did
        self._ended: frozenset[str] = frozenset()  # what only the end decided
        self._failed: frozenset[str] = frozenset()  # what `finish("failure")` violated
        self.of_instant = True if reading.view == "step" else None
        self.settled = 0
        self.violated_by: str | None = None

    def track_obligations(self) -> list[list[Obligation]]:
        """Follows what temporal operators owe from now on; returns each specification's operators.

        A `feeder` that was made before does not.
        """
        if self._owing is None:
            require_known(self._reading, Argument("observe", "obligations"))
            judged = {name: judge.specification for name, (_, judge) in self.monitors.items()}
            self._owing = SingleObligations(judged, self._reading)
        return self._owing.found

    @property
    def tracks_obligations(self) -> bool:
        """Whether it follows what temporal operators owe."""
        return self._owing is not None

    @cached_property
    def _described(self) -> dict[str, str]:
        return {
            name: described(spec, judge)
            for (name, spec), judge in zip(self._specs.items(), self._judges, strict=True)
        }

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None where bounds count samples."""
        return self._judges[0].period

    @property
    def samples(self) -> int:
        """Samples fed since the reset."""
        return self._judges[0].samples

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation; None while there is none.

        It is the last sample if only the end decided it.
        """
        return None if self.violated_by is None else self._settled[self.violated_by]

    @property
    def progress(self) -> dict[str, float]:
        """The progress of each requirement in stages, by its name; see `StageProgress`."""
        if self._stages is None:
            return {}
        return self._stages.values

    @property
    def least_progress(self) -> np.float64 | None:
        """The least progress over the requirements in stages; None if none is."""
        return None if self._stages is None else np.float64(self._stages.least)

    @property
    def tells_more(self) -> bool:
        """Whether it has more to say of a sample than its `Assessment`."""
        return bool(self.of_instant or self._stages is not None or self._meter is not None)

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
        """The specifications that are certainly violated."""
        return [
            name
            for name in self._settled
            if self._verdict(name, self.monitors[name][1]) is Verdict.VIOLATED
        ]

    def satisfies(self, name: str) -> bool:
        """Whether the verdict on a specification is that it is satisfied."""
        return self.monitors[name][1].verdict > 0

    def knows(self, above: Mapping[str, float]) -> bool:
        """Whether every robustness can change no more, or is certain to stay above its number."""
        return all(
            judge.lower == judge.upper or judge.lower > above.get(name, math.inf)
            for name, (_, judge) in self.monitors.items()
        )

    @property
    def undecided(self) -> list[str]:
        """The specifications whose verdict is open."""
        return [name for name in self.monitors if name not in self._settled]

    @property
    def robustness(self) -> float:
        """The least robustness over the specifications; nan before the first sample."""
        return least([source.robustness for source in self._sources])

    @property
    def lower(self) -> float:
        """The least that the robustness can still become."""
        return least([judge.lower for judge in self._judges])

    @property
    def upper(self) -> float:
        """The greatest that the robustness can still become."""
        return least(self._uppers())

    def _uppers(self) -> list[float]:
        return [self._upper(name, judge) for name, (_, judge) in self.monitors.items()]

    def _upper(self, name: str, judge: EpisodeMonitor) -> float:
        return -0.0 if name in self._failed else judge.upper

    def read(self, *_: object) -> Assessment:
        """Reads robustness, lower and upper bound of the samples so far; whatever it is given."""
        if self._look is not None and not self._failed:
            return self._look()
        number = self.number
        return number(self.robustness), number(self.lower), number(self.upper)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_look": None}  # the next `feeder` makes it anew

    def feeder(
        self,
        names: Sequence[str],
        reads: Sequence[Read] | None = None,
        *,
        decide: Callable[[], None] | None = None,
        keep: Callable[[Sequence[float]], None] | None = None,
    ) -> Feed:
        """Makes the function that feeds one sample to all monitors.

        It takes the arguments of a `Read`, and returns the least robustness and the least lower and
        upper bound over the specifications.

        Args:
            names: Names of the signals, the variables of all specifications among them.
            reads: What reads each signal; None: the first argument is the sample itself, with a
                value for each signal.
            decide: Called after a sample that has decided a verdict, in place of `note`.
            keep: Called with the values of every sample that all monitors have taken in, new ones.
        """
        note, see = decide or self.note, together(self._measure(names), keep)
        made = None if reads is None else self._joint(names, reads, note, see)
        if reads is None or made is None:
            return self._one_by_one(names, reads, note, keep)
        moving = next((read for read in reads if isinstance(read, MovingRead)), None)
        if moving is None:
            return made.feed
        home, feed = moving.home(), made.feed

        def feed_here(*step: Any) -> Assessment:  # noqa: ANN401 - the arguments of a `Read`
            nonlocal feed, home
            now = moving.home()
            if now is not home:
                joint = self._joint(names, reads, note, see)
                assert joint is not None  # noqa: S101 - the monitors are those from above
                feed, home = joint.feed, now
            return feed(*step)

        return feed_here

    def taker(self, names: Sequence[str], reads: Sequence[Read]) -> Take:
        """Makes a `feeder` whose result nobody looks at: `read` tells it.

        Make it anew where a `MovingRead` has moved.
        """
        made = self._joint(names, reads, self.note, self._measure(names))
        return self._one_by_one(names, reads, self.note, None) if made is None else made.take

    def _measure(self, names: Sequence[str]) -> Callable[[Sequence[float]], None] | None:
        """What else takes in every sample; None: nothing does."""
        return together(
            None if self._owing is None else self._owing.feeder(names),
            together(
                None if self._meter is None else self._meter.feeder(names),
                None if self._stages is None else self._stages.feeder(names),
            ),
        )

    def _one_by_one(
        self,
        names: Sequence[str],
        reads: Sequence[Read] | None,
        note: Callable[[], None],
        keep: Callable[[Sequence[float]], None] | None,
    ) -> Feed:
        """The `feeder` that feeds one monitor after the other."""
        parts = [
            (source.update, *picked([names.index(v) for v in self.variables[name]]), judge)
            for name, (source, judge) in self.monitors.items()
        ]
        see = self._measure(names)
        if keep is not None:  # the values are in the same list at every sample
            see = together(see, lambda values: keep(tuple(values)))
        return one_by_one(parts, len(names), reads, self, note, see)

    def _joint(
        self,
        names: Sequence[str],
        reads: Sequence[Read],
        note: Callable[[], None],
        see: Callable[[Sequence[float]], None] | None,
    ) -> JointFeed | None:
        """What feeds in one call of C++; None where there is none for these monitors."""
        judges = self._judges
        if self.of_instant:
            return None

        def decided(count: int) -> None:
            if count > self.settled:
                note()

        found = [joint_read(read) for read in reads]
        joint = rtamt.joint_feed(
            judges, names, found, decided=decided, seen=see, number=self.number
        )
        if joint is None:
            return None
        self._look = joint.look
        return joint

    def reset(self) -> None:
        for source in self._sources:
            source.reset()
        if self._meter is not None:
            self._meter.reset()
        if self._owing is not None:
            self._owing.reset()
        if self._stages is not None:
            self._stages.reset()
        self._settled = {}
        self._ended = self._failed = frozenset()
        self.settled = 0
        self.violated_by = None

    def note(self) -> None:
        """Records the verdicts that the last sample, or the end of the trace, has decided."""
        for name, (_, judge) in self.monitors.items():
            if judge.verdict != 0 and name not in self._settled:
                self._settled[name] = judge.samples - 1
                if judge.verdict < 0 and self.violated_by is None:
                    self.violated_by = name
        self.settled = len(self._settled)

    def cut_windows(self) -> frozenset[str]:
        """Open verdicts that a complete trace satisfies, and a cut one leaves open.

        A bounded window of these specifications reaches past the last sample.
        """
        return frozenset(
            name
            for name in self.undecided
            if self._specs[name].timed
            and holds(self.monitors[name][1].robustness)
            and _open_if_cut(self.monitors[name][1])
        )

    def finish(self, end: AtTermination | End = "complete") -> Assessment:
        """Ends the trace, which settles robustness and bounds as the end is read; returns them.

        ``"failure"``: what is not decided yet is violated at the last sample, whatever its
        robustness is.
        """
        was_open = frozenset(self.undecided)
        if end == "failure":
            self._fail()
        else:
            for judge in self._judges:
                judge.finish(end)
            if self._stages is not None:
                self._stages.finish(end)
            self.note()
        self._ended |= was_open & self._settled.keys()
        return self.read()

    def _fail(self) -> None:
        self._failed = frozenset(self.undecided)
        for name in self.undecided:
            self._settled[name] = self.samples - 1
            if self.violated_by is None:
                self.violated_by = name
        self.settled = len(self._settled)

    def take_costs(self) -> dict[str, np.float64] | None:
        """The costs of the step that ends; None if they are not measured."""
        if self._meter is None:
            return None
        return self._meter.take(
            [self._verdict(name, judge) < 0 for name, (_, judge) in self.monitors.items()]
        )

    def begin(self) -> None:
        """Begins a step: the sample of a reset costs nothing."""
        if self._meter is not None:
            self._meter.begin()

    def _verdict(self, name: str, judge: EpisodeMonitor) -> Verdict:
        return Verdict.VIOLATED if name in self._failed else judge.verdict

    def values(self) -> MonitorValues[float]:
        """Reads the values of all monitors."""
        owed = None if self._owing is None else self._owing.owed()
        verdicts = [float(self._verdict(name, judge)) for name, (_, judge) in self.monitors.items()]
        return read_values(self.monitors.values(), self._uppers(), verdicts, self.samples, owed)

    def describe(self) -> dict[str, dict[str, Any]]:
        """The state of every specification: ``info["stl"]``."""
        progress = {name: np.float64(each) for name, each in self.progress.items()}
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
        """The outcome of every specification so far: ``info["stl_episode"]``."""
        made = {}
        for name, (_, judge) in self.monitors.items():
            robustness, verdict = np.float64(judge.robustness), self._verdict(name, judge)
            at, ended = self._settled.get(name), name in self._ended
            decided = at is not None and not ended
            by_end = verdict < 0 and not np.signbit(robustness)
            found = outcome(robustness, verdict, verdict > 0, at, decided, ended, bool(by_end))
            made[name] = present(found)
        for name, progress in self.progress.items():
            made[name]["progress"] = np.float64(progress)
        return made

    def results(self) -> list[PanelResult]:
        """What every specification has become so far."""
        found: list[PanelResult] = []
        for name, (_, judge) in self.monitors.items():
            bounds = judge.robustness, judge.lower, self._upper(name, judge)
            at = self._settled.get(name)
            moments = (None, at) if name in self._ended else (at, None)
            found.append((name, bounds, self._verdict(name, judge), *moments))
        return found

    def state(self) -> tuple[Any, ...]:
        """The state of the monitors, small and fit for pickle."""
        sources = [
            source.state() if isinstance(source, InstantMonitor) else machine_state(source)
            for source in self._sources
        ]
        stages = None if self._stages is None else self._stages.state()
        settled = dict(self._settled), self._ended
        return self._described, sources, settled, self.violated_by, stages

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state`; raises an `InputError` if it is one of other specifications."""
        described, sources, settled, violated_by, stages = state
        if described != self._described:
            raise InputError(
                f"expected a state of the specifications {self._described}, got one of {described}"
            )
        for source, held in zip(self._sources, sources, strict=True):
            if isinstance(source, InstantMonitor):
                source.restore(held)
            else:
                source.__setstate__(held)
        if self._stages is not None:
            self._stages.restore(stages)
        self._settled, self._ended = dict(settled[0]), settled[1]
        self._failed = frozenset()
        self.settled = len(self._settled)
        self.violated_by = violated_by


def _open_if_cut(judge: EpisodeMonitor) -> bool:
    """Whether the verdict stays open if the trace is read as cut; leaves the monitor as it is."""
    held = machine_state(judge)
    judge.finish("cut")
    found = judge.verdict is Verdict.UNDECIDED
    judge.__setstate__(held)
    return found


_NAMES = tuple(VERDICTS)  # an enum's own name takes twice the time
