"""`History`: the robustness, bounds and verdicts of one specification over a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import Specification, Verdict, parse
from rtamt.monitors import TriggerCount
from rtamt.renamed import OldName
from rtamt.typing import SemanticsName
from rtamt_gym.judging.monitors import robustness_text
from rtamt_gym.results.outcome import Outcome, verdict_text
from rtamt_gym.tables import sample_text

Floats = NDArray[np.float64]

CURVES = ("robustness", "lower", "upper")
"""The arrays of a history."""

Stop = Literal["violation", "decided", "known", "verdicts", "end"]
"""When to stop a run: at the first certain violation; also once every verdict is certain; also once
every robustness is known; only once every verdict is certain; or at its end."""


class ComparesArrays:
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
class History(ComparesArrays):
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
    """The samples of one simulation: the values of every variable, and seconds between them."""

    signals: Mapping[str, Floats]
    period: Fraction | None

    @property
    def samples(self) -> int | None:
        """The number of samples; None without variables."""
        return next((len(values) for values in self.signals.values()), None)
