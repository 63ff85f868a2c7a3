"""Runs of simulations under specifications: every sample, and what became of each specification."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym.checks.names import listing
from rtamt_gym.judges.specs import SpecsLike, View, load_specs
from rtamt_gym.tables import moment

__all__ = ["Course", "Ended", "Floats", "Run", "Stop"]

Floats = NDArray[np.float64]

Stop = Literal["violation", "decided", "end"]
"""When to stop a run: at the first certain violation, also as soon as every verdict is certain, or
not before its end."""

Ended = Literal["violation", "decided", "terminated", "truncated", "duration"]
"""Why a run is over: stopped at a violation, or because every verdict was certain; ended by the
system itself, for good or by a time limit of its own; or as long as was asked for."""


class _Record:
    """Equal if all fields are that compare, arrays element by element."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(getattr(self, each.name), getattr(other, each.name))
            for each in fields(self)  # type: ignore[arg-type]  # the subclasses are dataclasses
            if each.compare
        )

    __hash__ = None  # type: ignore[assignment]  # as of all that holds arrays


def _same(left: object, right: object) -> bool:
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return np.array_equal(left, right, equal_nan=True)
    if isinstance(left, Mapping) and isinstance(right, Mapping):
        return list(left) == list(right) and all(_same(left[key], right[key]) for key in left)
    return left == right


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Course(_Record):
    """What became of one specification, sample by sample and in the end.

    Attributes:
        formula: What it demands.
        robustness: Robustness if the run ended now, at every sample.
        lower: The least that it can still become.
        upper: The greatest.
        final: The robustness in the end.
        verdict: What is certain in the end.
        decided_at: The sample that decided it, or None.
        unit: Of the bounds in the formula that have none.
    """

    formula: str
    robustness: Floats
    lower: Floats
    upper: Floats
    final: float
    verdict: Verdict
    decided_at: int | None
    unit: str = "s"

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """The verdict at every sample: -1 violated, 1 satisfied, 0 undecided."""
        return np.subtract(self.lower > 0.0, self.upper < 0.0, dtype=np.int8)

    def __repr__(self) -> str:
        at = "" if self.decided_at is None else f" at sample {self.decided_at}"
        return f"<Course of {self.formula}: {self.verdict.name}{at}, robustness {self.final:.3g}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Run(_Record):
    """One run of a simulation under specifications; `simulate` makes it.

    Two runs are equal if all is equal that they record, the wall time aside.

    Attributes:
        system: Name of what ran.
        signals: Values of every variable, and of all that was recorded beside, sample by sample,
            from sample 0 on.
        courses: What became of every specification, by its name.
        ended: Why it is over: ``"violation"``, ``"decided"``, ``"terminated"``, ``"truncated"`` or
            ``"duration"``.
        violated_by: The specification that was violated first, or None.
        period: Seconds between samples, or None.
        view: Whether formulas speak of the run from sample 0 on, or of every instant.
        stop: What was to stop it.
        limit: Steps that it would have made at most, or None.
        seed: The seed that it was given, or None.
        label: Who acted, or an empty string.
        wall_time: Seconds that it took, monitors included.

    Example:
        >>> from rtamt_gym import simulate
        >>> levels = [{"level": x} for x in (1.0, 2.0, 4.0, 8.0)]
        >>> run = simulate(levels, {"dry": "always(level < 3)"}, period=0.5)
        >>> run
        <Run of samples: violation of dry at 1 s, 3 samples>
        >>> run.times, run.signals["level"]
        (array([0. , 0.5, 1. ]), array([1., 2., 4.]))
        >>> run.courses["dry"].robustness, run.courses["dry"].verdicts
        (array([ 2.,  1., -1.]), array([ 0,  0, -1], dtype=int8))
        >>> run.violated_by, run.violated_at
        ('dry', 2)
        >>> run.courses
        {'dry': <Course of always(level < 3): VIOLATED at sample 2, robustness -1>}
        >>> run.replay()
        {'dry': array([-1., -1., -1.])}
    """

    system: str
    signals: Mapping[str, Floats]
    courses: Mapping[str, Course]
    ended: Ended
    violated_by: str | None
    period: Fraction | None
    view: View
    stop: Stop
    limit: int | None
    seed: int | None
    label: str
    wall_time: float = field(compare=False)

    @property
    def steps(self) -> int:
        """How many steps were made: the samples but the first."""
        return len(next(iter(self.courses.values())).robustness) - 1

    @property
    def duration(self) -> float:
        """Simulated time, in seconds; in steps where there is no period."""
        return float(self.steps * (self.period or 1))

    @property
    def times(self) -> Floats:
        """When every sample was taken, in seconds; numbers of samples where there is no period."""
        period = self.period or Fraction(1)
        times: Floats = np.arange(self.steps + 1, dtype=np.float64)
        return times * period.numerator / period.denominator

    @property
    def verdict(self) -> Verdict:
        """What is certain of all specifications together."""
        return min(course.verdict for course in self.courses.values())

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation; None if there is none."""
        return None if self.violated_by is None else self.courses[self.violated_by].decided_at

    @property
    def saved(self) -> int | None:
        """Steps from the stop to the limit; None if it was not stopped or has no limit."""
        if self.ended not in {"violation", "decided"} or self.limit is None:
            return None
        return self.limit - self.steps

    def replay(self, specs: SpecsLike | None = None) -> dict[str, Floats]:
        """Evaluates specifications offline on the recorded signals: `rtamt.evaluate`.

        Of the run's own specifications, the first value equals the last that was monitored; with
        ``view="step"`` the values are those that the monitor gave, without its latency; but a whole
        formula ``always p`` or ``eventually p`` looks back online and forward here, see
        `rtamt.Monitor`.

        Args:
            specs: Others than the run's own; they read the signals of the run.

        Returns:
            By name of the specification, the robustness at every sample.

        Raises:
            SpecificationError: As `rtamt.evaluate` does.
            InputError: If a specification reads what is no signal of the run.
        """
        if specs is None:
            specs = {
                name: rtamt.parse(course.formula, unit=course.unit)
                for name, course in self.courses.items()
            }
        loaded = load_specs(specs)
        for name, spec in loaded.items():
            for variable in spec.variables:
                if variable not in self.signals:
                    raise InputError(
                        f"specification {name!r} reads {variable!r}, which was not recorded; the "
                        f"signals of the run are {listing(self.signals)}"
                    )
        return {
            name: rtamt.evaluate(spec, self.signals, self.period, n=self.steps + 1)
            for name, spec in loaded.items()
        }

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draws signals, robustness, bounds and verdicts into a file: .png, .svg, .pdf.

        Raises:
            InputError: If the name says no format of pictures.
        """
        from rtamt_gym.drawing import check_format
        from rtamt_gym.simulation.plot import save

        check_format(Path(path))
        save([self], Path(path))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a Parquet file: a row for each sample, ``time`` and the signals first.

        All readers of Parquet understand it, ``rtamt monitor`` among them. Needs the extra
        ``parquet``.
        """
        from rtamt_gym.simulation.storage import save

        save(self, Path(path))

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Run:
        """Reads what `save` has written; the run is equal to the one that was saved.

        Raises:
            InputError: If the file holds no run.
        """
        from rtamt_gym.simulation.storage import load

        return load(Path(path))

    def __repr__(self) -> str:
        what = f" of {self.violated_by}" if self.ended == "violation" else ""
        at = moment(self.steps, self.period)
        return f"<Run of {self.system}: {self.ended}{what} at {at}, {self.steps + 1} samples>"
