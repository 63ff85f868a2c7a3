"""The record of one run, every sample and the history of each specification, and its recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from itertools import pairwise
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputTypeError, Specification, Verdict, parse
from rtamt.monitors import Evidence, TriggerCount
from rtamt.renamed import OldName
from rtamt.typing import Align, End, NanPolicy, SemanticsName
from rtamt_gym import markup
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.monitors import EXACT, robustness_text
from rtamt_gym.options.evaluation import AtTermination, View
from rtamt_gym.results.outcome import Outcome, verdict_text
from rtamt_gym.results.trial import STOPPED, RunEnd, Trial
from rtamt_gym.tables import sample_text

if TYPE_CHECKING:  # commands and reports show runs without Gymnasium, which these import
    from rtamt_gym.judging.monitor_set import Assessment, Feed, MonitorSet
    from rtamt_gym.live.track import Track
    from rtamt_gym.signals.signals import Read


Floats = NDArray[np.float64]

CURVES = ("robustness", "lower", "upper")
"""The arrays of a history."""

Stop = Literal["violation", "decided", "known", "verdicts", "end"]
"""When to stop a run: at the first certain violation; also once every verdict is certain; also once
every robustness is known; only once every verdict is certain; or at its end."""

AT_VIOLATION: Final = frozenset[Stop]({"violation", "decided", "known"})
"""The stops at the first certain violation."""

AT_VERDICTS: Final = frozenset[Stop]({"decided", "verdicts"})
"""The stops once every verdict is certain."""

KNOWN_EVERY: Final = 10
"""The number of samples between checks whether every robustness is known, which are slow."""


class _ComparesArrays:
    """A base of dataclasses with a comparison that handles arrays."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(getattr(self, item.name), getattr(other, item.name))
            for item in fields(self)  # type: ignore[arg-type]  # the subclasses are dataclasses
            if item.compare
        )

    __hash__ = None  # type: ignore[assignment]  # arrays have no hash


def _same(left: object, right: object) -> bool:
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return np.array_equal(left, right, equal_nan=True)
    if isinstance(left, Mapping) and isinstance(right, Mapping):
        return list(left) == list(right) and all(_same(left[key], right[key]) for key in left)
    return left == right


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class History(_ComparesArrays):
    """The history of one specification over a run: robustness and bounds at every sample.

    Attributes:
        formula: Its text.
        robustness: The robustness at every sample, if the run ended there.
        lower: The lower bound of the final robustness, at every sample.
        upper: The upper bound of the final robustness, at every sample.
        final: The robustness at the end.
        verdict: The verdict at the end.
        decided_at: The sample that decided the verdict, counted from the start of the episode;
            None if it is open, or if only the end decided it.
        unit: The unit of bounds in the formula without a unit.
        semantics: As for `rtamt.Monitor`.
        inputs: Variables that the system reads.
        outputs: Variables that the system sets.
        triggers: Its triggers, as in `Outcome.triggers`.
        vacuous: Whether it was vacuously satisfied.
        progress: Its progress through stages at the end, as in `Outcome.progress`.
        ended_at: The last sample, counted in the same way, if only the end decided the verdict;
            otherwise None.
    """

    formula: str
    robustness: Floats
    lower: Floats
    upper: Floats
    final: float
    verdict: Verdict
    decided_at: int | None
    unit: str = "s"
    semantics: SemanticsName = "standard"
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    triggers: tuple[TriggerCount | rtamt.dense.TriggerCount, ...] | None = None
    vacuous: bool = False
    progress: float | None = None
    ended_at: int | None = None

    asked = OldName("triggers")

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """The verdict at every sample: -1 violated, 1 satisfied, 0 undecided."""
        return np.subtract(~np.signbit(self.lower), np.signbit(self.upper), dtype=np.int8)

    def final_text(self, form: str) -> str:
        """Format the robustness at the end; a 0 without a verdict states whether it holds."""
        text = robustness_text(self.final, self.semantics, self.verdict, form)
        return text if self.verdict == Verdict.UNDECIDED else text.partition(", ")[0]

    @property
    def specification(self) -> Specification:
        """The formula, parsed again."""
        return parse(self.formula, unit=self.unit)

    @property
    def interface(self) -> dict[str, Any]:
        """The semantics, the inputs and the outputs, as arguments of `rtamt.evaluate`."""
        return {"semantics": self.semantics, "inputs": self.inputs, "outputs": self.outputs}

    def outcome(self, period: Fraction | None) -> Outcome:
        """Return the outcome of the specification, without its history."""
        bounds = self.final, float(self.lower[-1]), float(self.upper[-1])
        result = Outcome.at(bounds, self.verdict, self.decided_at, period, ended=self.ended_at)
        return replace(result, triggers=self.triggers, vacuous=self.vacuous, progress=self.progress)

    def decided_text(self, period: Fraction | None) -> str:
        """Return when the verdict was decided: a time, a sample or "the end"; empty while open."""
        if self.decided_at is not None:
            return sample_text(self.decided_at, period)
        return "" if self.verdict is Verdict.UNDECIDED else "the end"

    def __repr__(self) -> str:
        decided = self.decided_text(None)
        when = f" at {decided}" if decided else ""
        verdict = verdict_text(self.verdict, self.final)
        return f"<History of {self.formula}: {verdict}{when}, robustness {self.final_text('.3g')}>"


class HistoriesOnDemand(Mapping[str, History]):
    """Histories that are computed when the first of them is read."""

    def __init__(self, names: tuple[str, ...], compute: Callable[[], dict[str, History]]) -> None:
        self._names = names
        self._compute: Callable[[], dict[str, History]] | None = compute
        self._histories: dict[str, History] = {}

    def __getitem__(self, name: str) -> History:
        return self._read()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return repr(self._read())

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (self._read(),)

    def _read(self) -> dict[str, History]:
        if self._compute is not None:
            self._histories, self._compute = self._compute(), None
        return self._histories


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTrace:
    """The samples of one simulation.

    Attributes:
        signals: The values of every variable, by name.
        period: Seconds between samples, or None.
    """

    signals: Mapping[str, Floats]
    period: Fraction | None

    @property
    def samples(self) -> int | None:
        """The number of samples; None without variables."""
        return next((len(values) for values in self.signals.values()), None)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RunRecord(_ComparesArrays):
    """The fields of a `Run`, which documents them, and properties that follow from them."""

    system: str
    signals: Mapping[str, Floats]
    histories: Mapping[str, History]
    ended: RunEnd
    violated_by: str | None
    period: Fraction | None
    view: View
    stop: Stop
    limit: int | None
    seed: int | None
    label: str
    wall_time: float = field(compare=False)
    align: Align | None = None
    first_sample: int = 0
    case: Case | None = None
    reward: float | None = None

    courses = OldName("histories")

    def columns(self) -> dict[str, Floats]:
        """Return a table: ``time``, the signals, and three columns for every specification.

        These are ``robustness(NAME)``, ``lower(NAME)`` and ``upper(NAME)``. A signal named ``time``
        takes the place of the times, which follow from the period.
        """
        columns = {"time": self.times, **self.signals}
        for name, history in self.histories.items():
            columns |= {f"{curve}({name})": getattr(history, curve) for curve in CURVES}
        return columns

    @property
    def steps(self) -> int:
        """The number of steps: one less than the number of samples."""
        samples = next(iter(self.signals.values()), None)
        if samples is None:  # the specifications read nothing
            samples = next(iter(self.histories.values())).robustness
        return len(samples) - 1

    @property
    def last_sample(self) -> int:
        """The number of the last sample in its episode."""
        return self.first_sample + self.steps

    @property
    def duration(self) -> float:
        """Simulated time in seconds; without a period, the number of steps."""
        return float(self.steps * (self.period or 1))

    @property
    def times(self) -> Floats:
        """The time of every sample in seconds; without a period, its number."""
        period = self.period or Fraction(1)
        times: Floats = np.arange(self.first_sample, self.last_sample + 1, dtype=np.float64)
        return times * period.numerator / period.denominator

    @property
    def verdict(self) -> Verdict:
        """The verdict on all specifications together, their worst verdict."""
        return min(history.verdict for history in self.histories.values())

    @property
    def outcomes(self) -> dict[str, Outcome]:
        """The outcome of each specification, by name."""
        return {name: history.outcome(self.period) for name, history in self.histories.items()}

    def trial(self, case: Case | None = None, error: str = "") -> Trial:
        """Return the case and the outcomes, without the samples.

        Args:
            case: The inputs of the simulation. Default: the case of the run.
            error: The error that ended it, as text.
        """
        case = (self.case or Case({})) if case is None else case
        ended, wall = self.ended, self.wall_time
        return Trial(case, self.seed, self.outcomes, ended, self.duration, wall, error, self.reward)

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation, or None.

        It is the last sample if only the end decided it.
        """
        if self.violated_by is None:
            return None
        history = self.histories[self.violated_by]
        return history.ended_at if history.decided_at is None else history.decided_at

    @property
    def saved(self) -> int | None:
        """Steps from the stop to the limit; None if it was not stopped or has no limit."""
        if self.ended not in STOPPED or self.limit is None:
            return None
        return self.limit - self.steps

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: verdict, robustness and curve of each specification."""
        rows = [
            [
                markup.plain(name),
                markup.verdict(history.verdict, verdict_text(history.verdict, history.final)),
                markup.plain(history.final_text(".6g")),
                markup.plain(history.decided_text(self.period)),
                markup.curve(history.robustness, f"robustness of {name}"),
                markup.code(history.formula),
            ]
            for name, history in self.histories.items()
        ]
        head = ["", "verdict", "robustness", "certain at", "over time", "formula"]
        return f"{markup.plain(repr(self)[1:-1])}{markup.table(head, rows)}"

    def __repr__(self) -> str:
        phrase = f" of {self.violated_by}" if self.ended == "violation" else ""
        when = sample_text(self.last_sample, self.period)
        samples = f"{self.steps + 1} samples" if self.steps else "1 sample"
        return f"<Run of {self.system}: {self.ended}{phrase} at {when}, {samples}>"


class Recorder:
    """Update the monitors with samples, and record the values that a run needs.

    Attributes:
        monitor_set: The monitors.
        names: The names of the values of a sample: the variables, then further signals.
        first_sample: The number of the first sample in its episode.
    """

    def __init__(
        self,
        monitor_set: MonitorSet,
        variables: Sequence[str],
        signals: Iterable[str] = (),
        nan: NanPolicy = "raise",
        *,
        keeps: bool = True,
        curves: bool = False,
        fed: bool = False,
        live: Track | None = None,
    ) -> None:
        self.monitor_set, self.first_sample = monitor_set, 0
        self.names = list(dict.fromkeys([*variables, *signals]))
        self._variables, self._holds, self._fed = variables, nan == "hold", fed
        self._further = range(len(variables), len(self.names))
        # One monitor takes a sample completely or not at all, so nothing has to be undone.
        single = len(monitor_set.monitors) == 1 and not keeps
        self._samples: list[Sequence[float]] | None = None if single else []
        self._curves: dict[str, list[Assessment]] = (
            {name: [] for name in monitor_set.monitors} if curves or fed else {}
        )
        self._state = monitor_set.state() if fed else None
        self._feed = monitor_set.feeder(variables)
        self._live = live
        if live is not None:
            live.follow(monitor_set.monitors)
            live.begin()
        self._reads: Sequence[Read] | None = None
        self._feed_step: Feed

    def __len__(self) -> int:
        """The number of samples."""
        return self.monitor_set.samples if self._samples is None else len(self._samples)

    @property
    def plain(self) -> bool:
        """Whether monitors may read the steps of an environment without `take`."""
        return not self._further and not self._curves and self._live is None

    def reset(self) -> None:
        """Forget the samples, for another run."""
        self.monitor_set.reset()
        if self._samples is not None:
            self._samples.clear()

    def take(self, values: Sequence[float]) -> None:
        """Feed and keep a sample: the variables, then the further signals."""
        if self._fed:
            if not self._samples:
                self.first_sample = self.monitor_set.samples - 1
                self._state = self.monitor_set.state()
        else:
            self._feed(values)
        for index in self._further:  # values that no monitor reads, and so checks
            value: object = values[index]
            if type(value) is not float and not isinstance(value, Real):  # the second is slower
                raise InputTypeError(
                    f"expected a number for {self.names[index]!r} at sample {len(self)}, "
                    f"got {type(value).__name__} {value!r}"
                )
        self._keep(values)
        if self._live is not None:
            self._live.sample(values)

    def feeder(self, reads: Sequence[Read]) -> Feed:
        """Return the function that feeds a step of an environment; made again for other reads."""
        if reads is not self._reads:
            keep = None if self._samples is None else self._samples.append
            self._feed_step = self.monitor_set.feeder(self._variables, reads, keep=keep)
            self._reads = reads
        return self._feed_step

    def rewind(self) -> None:
        """Set the monitors to the last kept sample: an error may have come within the next one.

        Some monitors may have taken a sample that others have refused.
        """
        if self._samples is None:
            return
        samples = [*self._samples]
        self._samples.clear()
        for curve in self._curves.values():
            curve.clear()
        if self._state is None:
            self.monitor_set.reset()
        else:
            self.monitor_set.restore(self._state)
        for values in samples:
            if not self._fed or self._samples:
                self._feed(values)
            self._keep(values)

    def finish(self, end: AtTermination | End) -> None:
        """End the trace for the monitors; the last values of curves are those after the end."""
        self.monitor_set.finish(end)
        if self._curves:
            for name, state in self.monitor_set.describe().items():
                self._curves[name][-1] = state["robustness"], state["lower"], state["upper"]

    def show_end(self) -> None:
        """End the episode in the live view, if there is one."""
        if self._live is not None:
            self._live.end(self.monitor_set.describe())

    def columns(self) -> dict[str, Floats]:
        """Return the values of every variable and further signal; samples must be kept."""
        assert self._samples is not None  # noqa: S101 - as documented
        table = np.array(self._samples, np.float64).reshape(len(self._samples), len(self.names))
        if self._holds:
            for previous, values in pairwise(table):
                np.copyto(values, previous, where=np.isnan(values))
        return dict(zip(self.names, np.ascontiguousarray(table.T), strict=True))

    def replayed(self, monitor_set: MonitorSet, end: AtTermination | End | None) -> Recorder:
        """Feed the samples to further monitors, and keep the values of these at every sample."""
        other = Recorder(monitor_set, self._variables, self.names, curves=True)
        for values in self._samples or ():
            other.take(values)
        if end is not None:
            other.finish(end)
        return other

    def histories(
        self,
        specs: Mapping[str, rtamt.Specification],
        evidence: Mapping[str, Evidence[TriggerCount]],
    ) -> dict[str, History]:
        """Return the history of every specification."""
        outcomes = self.monitor_set.outcomes()
        histories = {}
        for name, (_, judge) in self.monitor_set.monitors.items():
            robustness, lower, upper = np.ascontiguousarray(np.array(self._curves[name]).T)
            outcome = outcomes[name]
            histories[name] = History(
                str(specs[name].formula),
                robustness,
                lower,
                upper,
                judge.robustness,
                rtamt.Verdict[outcome["verdict"]],
                outcome.get("decided_at"),
                specs[name].unit,
                judge.interface.semantics,
                _with_role("input", judge),
                _with_role("output", judge),
                None if name not in evidence else evidence[name].triggers,
                name in evidence and evidence[name].vacuous,
                outcome.get("progress"),
                outcome.get("ended_at"),
            )
        return histories

    def _keep(self, values: Sequence[float]) -> None:
        for name, curve in self._curves.items():
            source, judge = self.monitor_set.monitors[name]
            curve.append((source.robustness, judge.lower, judge.upper))
        if self._samples is not None:
            self._samples.append(tuple(values))


def _with_role(role: Literal["input", "output"], judge: rtamt.EpisodeMonitor) -> tuple[str, ...]:
    """Return the variables of a formula with a role; exact semantics do not use roles."""
    if judge.interface.semantics in EXACT:
        return ()
    variables = judge.specification.formula.variables
    return tuple(name for name in variables if judge.interface.role(name) == role)
