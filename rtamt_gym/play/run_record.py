"""The record of one run: every sample, and the history of each specification."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import Specification, Verdict, parse
from rtamt.monitors import TriggerCount
from rtamt.renamed import OldName
from rtamt.typing import Align, SemanticsName
from rtamt_gym import markup
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.monitors import robustness_text
from rtamt_gym.options.evaluation import View
from rtamt_gym.results.outcome import Outcome, verdict_text
from rtamt_gym.results.trial import STOPPED, RunEnd, Trial
from rtamt_gym.tables import sample_text

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
