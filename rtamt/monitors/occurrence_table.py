"""Results of `rtamt.occurrences`: the violations of each body of a requirement, as columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.monitors.verdict import Verdict

_R = TypeVar("_R", bound=tuple[Any, ...])
_SHOWN = 5


class Occurrence(NamedTuple):
    """A run of neighbouring instants at which a body is violated.

    Attributes:
        start: The time of the first instant.
        end: The time of the next instant after the run, or the last recorded time if the run lasts
            until then. In dense time, the time at which the run ends; a single instant has its
            start as its end.
        duration: ``end - start``, in the unit of `Occurrences`.
        to_end: Whether the run lasts until the end of the trace.
        robustness: The minimum robustness in the run, -0.0 below +0.0.
        worst_at: The time of the first instant with this robustness; in dense time possibly right
            after it.
        unseen: Whether the violation is at an instant after the trace, which its past decides. Then
            it is the only row, for the first such instant.
        open_start: Whether the run starts right after ``start``, which is not part of it. Only in
            dense time.
        closed_end: Whether the instant ``end`` is part of the run. For samples, only at the end of
            the trace.
    """

    start: float
    end: float
    duration: float
    to_end: bool
    robustness: float
    worst_at: float
    unseen: bool
    open_start: bool = False
    closed_end: bool = False


class UnknownRun(NamedTuple):
    """A run of neighbouring instants at which the trace does not decide a formula.

    Attributes:
        start: As in `Occurrence`.
        end: As in `Occurrence`.
        duration: As in `Occurrence`.
        to_end: As in `Occurrence`.
        open_start: As in `Occurrence`.
        closed_end: As in `Occurrence`.
    """

    start: float
    end: float
    duration: float
    to_end: bool
    open_start: bool = False
    closed_end: bool = False


class Response(NamedTuple):
    """A run of neighbouring instants at which the left side of an implication holds for certain.

    Attributes:
        start: As in `Occurrence`.
        end: As in `Occurrence`.
        duration: As in `Occurrence`.
        to_end: As in `Occurrence`.
        verdict: VIOLATED if the implication is violated at an instant of the run, SATISFIED if it
            is satisfied at all of them; otherwise, UNDECIDED.
        answer_time: The time from ``start`` to the first instant at which the right side of
            ``eventually`` or ``until`` answers the first instant of the run. nan without an answer,
            if the answer is not recorded, and for other right sides.
        margin: The minimum robustness of the implication in the run.
        open_start: As in `Occurrence`.
        closed_end: As in `Occurrence`.
    """

    start: float
    end: float
    duration: float
    to_end: bool
    verdict: Verdict
    answer_time: float
    margin: float
    open_start: bool = False
    closed_end: bool = False


class RunTable(Sequence[_R], Generic[_R]):
    """Rows of one kind, stored as columns; a row is built when it is read.

    Attributes:
        columns: A column for each field of the rows. ``pandas.DataFrame(table.columns)`` is a data
            frame; a verdict is -1, 0 or 1 there.
    """

    __slots__ = ("_row", "columns")

    def __init__(self, row: Callable[..., _R], columns: Mapping[str, NDArray[Any]]) -> None:
        self._row, self.columns = row, columns

    def __len__(self) -> int:
        return len(self.columns["start"])

    @overload
    def __getitem__(self, place: int) -> _R: ...
    @overload
    def __getitem__(self, place: slice) -> RunTable[_R]: ...
    def __getitem__(self, place: int | slice) -> _R | RunTable[_R]:
        if isinstance(place, slice):
            return RunTable(
                self._row, {name: column[place] for name, column in self.columns.items()}
            )
        return self._row(
            **{name: _cell(name, column[place]) for name, column in self.columns.items()}
        )

    def __iter__(self) -> Iterator[_R]:
        return (self[index] for index in range(len(self)))

    def shifted(self, seconds: float) -> RunTable[_R]:
        """Return the same rows with later times."""
        moments = ("start", "end", "worst_at")
        return RunTable(
            self._row,
            {
                name: column + seconds if name in moments else column
                for name, column in self.columns.items()
            },
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RunTable):
            return NotImplemented
        return self.columns.keys() == other.columns.keys() and all(
            _same(column, other.columns[name]) for name, column in self.columns.items()
        )

    __hash__ = None  # type: ignore[assignment]  # columns are arrays

    def __repr__(self) -> str:
        return f"<{len(self)} rows of {', '.join(self.columns)}>"


def _cell(name: str, value: Any) -> Any:  # noqa: ANN401 - an element of an array
    if isinstance(value, np.datetime64):
        return value
    return Verdict(int(value)) if name == "verdict" else value.item()


def _same(column: NDArray[Any], other: NDArray[Any]) -> bool:
    return column.dtype == other.dtype and np.array_equal(
        column, other, equal_nan=column.dtype.kind == "f"
    )


@dataclass(frozen=True, slots=True)
class BodyOccurrences:
    """The occurrences of one body of a requirement.

    Attributes:
        text: The body as text.
        violations: An `Occurrence` for each run of violated instants.
        unknown: An `UnknownRun` for each run of instants that the trace does not decide.
        responses: A `Response` for each trigger of a body ``A implies B``; empty for other bodies.
        unknown_triggers: An `UnknownRun` for each run of instants at which it is not known whether
            ``A`` holds.
        length: The recorded time at which the requirement reads the body, in the unit of
            `Occurrences`: a period for each sample, or samples.
        violated: The violated part of ``length``.
        unit: The unit of durations: ``"s"`` or ``"samples"``.
    """

    text: str
    violations: RunTable[Occurrence]
    unknown: RunTable[UnknownRun]
    responses: RunTable[Response]
    unknown_triggers: RunTable[UnknownRun]
    length: float
    violated: float
    unit: str

    @property
    def share(self) -> float:
        """The share of the time in which the body is violated; nan without a length."""
        return self.violated / self.length if self.length else float("nan")

    @property
    def per_hour(self) -> float:
        """The violations in an hour; nan for samples without a period, and without a length."""
        timed = self.unit == "s" and self.length > 0
        return 3600 * len(self.violations) / self.length if timed else float("nan")

    @property
    def answer_times(self) -> Floats:
        """The answer times of `responses` that are known, sorted."""
        times: Floats = self.responses.columns["answer_time"]
        return np.sort(times[~np.isnan(times)])

    @property
    def outcomes(self) -> Mapping[Verdict, int]:
        """The number of responses with each verdict."""
        verdicts = self.responses.columns["verdict"]
        return {verdict: int(np.count_nonzero(verdicts == verdict)) for verdict in Verdict}

    def lines(self, moment: Callable[[Any], str], *, rates: bool = True) -> Iterator[str]:
        """Yield the lines of a text: the counts, and the first rows.

        Args:
            moment: Returns the text of a time.
            rates: Whether the share of the time and the rate are part of the text.
        """
        yield f"{self.text}: {self._count(rates=rates)}"
        for row in self.violations[:_SHOWN]:
            until = " (after the trace)" if row.unseen else ""
            if row.end != row.start:
                until = f" to {moment(row.end)}"
            end = ", up to the end" if row.to_end else ""
            worst = f"robustness {row.robustness + 0.0:.6g} at {moment(row.worst_at)}"
            yield f"  {moment(row.start)}{until}{end}: {worst}"
        if len(self.violations) > _SHOWN:
            yield f"  and {len(self.violations) - _SHOWN} more"
        if len(self.unknown):
            first = moment(self.unknown[0].start)
            yield f"  unknown {_times(len(self.unknown))}, first at {first}"
        if len(self.responses):
            yield f"  {self._answers()}"
        if len(self.unknown_triggers):
            first = moment(self.unknown_triggers[0].start)
            yield f"  possibly triggered {_times(len(self.unknown_triggers))}, first at {first}"

    def _count(self, *, rates: bool) -> str:
        if not len(self.violations):
            return "never violated"
        words = f"violated {_times(len(self.violations))}"
        if rates and not math.isnan(self.share):
            words += f", {100 * self.share:.3g} % of the time"
        if rates and not math.isnan(self.per_hour):
            words += f", {self.per_hour:.4g} an hour"
        return words

    def _answers(self) -> str:
        counts = self.outcomes
        parts = [
            f"{counts[verdict]} {word}"
            for verdict, word in (
                (Verdict.SATISFIED, "satisfied"),
                (Verdict.VIOLATED, "violated"),
                (Verdict.UNDECIDED, "unknown"),
            )
            if counts[verdict]
        ]
        times, unit = self.answer_times, "s" if self.unit == "s" else "samples"
        text = f"triggered {_times(len(self.responses))}: {', '.join(parts)}"
        if len(times):
            low, middle, high = np.quantile(times, (0, 0.5, 1)).tolist()
            span = f"{low:.6g} {unit}"
            if low < high:
                span = f"{low:.6g} to {high:.6g} {unit}, median {middle:.6g}"
            text += f"; answer time {span}"
        return text


def _times(count: int) -> str:
    return f"{count} time" if count == 1 else f"{count} times"


@dataclass(frozen=True, slots=True)
class Occurrences:
    """The violations of a requirement on a trace; returned by `rtamt.occurrences`.

    ``len`` is the number of violations, and iteration yields them, body after body.

    Attributes:
        formula: The formula as text.
        bodies: The occurrences of each body, in the order of the text.
        end: The end mode.
        unit: The unit of times: ``"s"``, or ``"samples"`` for sample numbers.
        at_start: Whether the formula is about the first instant only, because its root is neither
            ``always`` nor ``and``. Then the formula is its own body, read at one instant.
    """

    formula: str
    bodies: tuple[BodyOccurrences, ...]
    end: str
    unit: str
    at_start: bool

    def shifted(self, seconds: float) -> Occurrences:
        """Return the same rows with later times, such as for a trace that starts after 0 s."""
        if not seconds:
            return self
        tables = "violations", "unknown", "responses", "unknown_triggers"
        bodies = tuple(
            replace(body, **{name: getattr(body, name).shifted(seconds) for name in tables})
            for body in self.bodies
        )
        return replace(self, bodies=bodies)

    def __len__(self) -> int:
        return sum(len(body.violations) for body in self.bodies)

    def __bool__(self) -> bool:
        """Return True: an object without violations is also a result."""
        return True

    def __iter__(self) -> Iterator[Occurrence]:
        return (row for body in self.bodies for row in body.violations)

    def __str__(self) -> str:
        rates = not self.at_start
        lines = [line for body in self.bodies for line in body.lines(self.moment, rates=rates)]
        if self.at_start:
            lines.append("evaluated at the first instant only; always(...) covers the trace")
        return "\n".join(lines)

    def moment(self, time: Any) -> str:  # noqa: ANN401 - a number or a date
        """Return the text of a time of a row."""
        if isinstance(time, np.datetime64):
            return str(time)
        return f"{time:.12g} s" if self.unit == "s" else f"sample {time}"
