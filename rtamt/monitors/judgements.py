"""The judgements of many traces: as columns, and as the objects that `judge` returns."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import RtamtError
from rtamt.inputs.arrays import Floats
from rtamt.machines.protocols import End
from rtamt.monitors.evidence import Evidence, TriggerCount, Unrecorded
from rtamt.monitors.judgement import Judgement
from rtamt.monitors.verdict import Verdict


@dataclass(frozen=True, slots=True)
class TriggerColumns:
    """How often an implication was triggered on each of many traces.

    Attributes:
        text: The implication as text.
        samples: The number of samples at which it was triggered, of each trace.
        count: The number of runs of neighbouring samples.
        first: The first of these samples; -1 if there is none.
        vacuous: Whether the verdict is SATISFIED, and would be with ``false`` as the right side of
            this implication.
    """

    text: str
    samples: NDArray[np.int64]
    count: NDArray[np.int64]
    first: NDArray[np.int64]
    vacuous: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Judgements:
    """The verdicts on many traces and their evidence; returned by `judge_many`.

    Each attribute with a value per trace is an array in the order of the traces. `table` returns
    them as an Arrow table; pandas, polars and DuckDB also read the object itself through
    ``pyarrow.table(judgements)``.

    Attributes:
        keys: The name of each column in ``by`` to its value in each group; empty without ``by``.
        samples: The number of samples.
        verdict: The verdicts as int8, values of `Verdict`; 0 where ``errors`` has a text.
        robustness: The robustness, as in `Judgement`; nan where ``errors`` has a text.
        lower: The lower bounds.
        upper: The upper bounds.
        decided_at: The sample that decides the verdict of an open end; -1 if no sample does.
        complete: The verdicts on the complete traces, as int8.
        triggers: The triggers of each implication, in the order of the text.
        vacuous: Whether the verdict is SATISFIED, and would be with all right sides ``false``.
        errors: The error of each trace that could not be judged, by its number.
        end: The end mode.
        formula: The formula as text.
    """

    keys: Mapping[str, NDArray[Any]]
    samples: NDArray[np.int64]
    verdict: NDArray[np.int8]
    robustness: Floats
    lower: Floats
    upper: Floats
    decided_at: NDArray[np.int64]
    complete: NDArray[np.int8]
    triggers: tuple[TriggerColumns, ...]
    vacuous: NDArray[np.bool_]
    errors: Mapping[int, RtamtError]
    end: End
    formula: str

    @property
    def never_triggered(self) -> NDArray[np.bool_]:
        """Whether the verdict is SATISFIED, and no implication of the formula was triggered."""
        counts: Sequence[NDArray[np.int64]] = [part.count for part in self.triggers]
        if not counts:
            return np.zeros(len(self), bool)
        never: NDArray[np.bool_] = (self.verdict == 1) & (np.add.reduce(counts) == 0)
        return never

    def __len__(self) -> int:
        return len(self.verdict)

    def __repr__(self) -> str:
        violated, satisfied = ((self.verdict == value).sum() for value in (-1, 1))
        undecided = len(self) - violated - satisfied - len(self.errors)
        return (
            f"<Judgements of {len(self)} traces: {violated} violated, {satisfied} satisfied, "
            f"{undecided} undecided, {len(self.errors)} errors, end={self.end!r}>"
        )

    def table(self) -> Any:  # noqa: ANN401 - a pyarrow.Table
        """Return a row per trace as a ``pyarrow.Table``, which the extra ``files`` installs.

        The columns are the keys, ``samples``, ``verdict`` (a name, null after an error),
        ``robustness``, ``lower``, ``upper``, ``decided_at``, ``complete``, ``vacuous``,
        ``never_triggered``, ``error``, and for each implication ``triggers[i]``, ``first[i]`` and
        ``vacuous[i]``.
        """
        pa = _pyarrow()
        failed = np.zeros(len(self), bool)
        failed[[*self.errors]] = True
        names = pa.array(["VIOLATED", "UNDECIDED", "SATISFIED"])

        def verdicts(values: NDArray[np.int8]) -> object:
            places = pa.array(values.astype(np.int8) + np.int8(1), mask=failed)
            return pa.DictionaryArray.from_arrays(places, names)

        def optional(values: NDArray[np.int64]) -> object:
            return pa.array(values, mask=values < 0)

        columns: dict[str, object] = {name: pa.array(values) for name, values in self.keys.items()}
        columns |= {
            "samples": self.samples,
            "verdict": verdicts(self.verdict),
            **{name: pa.array(getattr(self, name), mask=failed) for name in _NUMBERS},
            "decided_at": optional(self.decided_at),
            "complete": verdicts(self.complete),
            "vacuous": pa.array(self.vacuous, mask=failed),
            "never_triggered": pa.array(self.never_triggered, mask=failed),
            "error": pa.array(
                [None if i not in self.errors else str(self.errors[i]) for i in range(len(self))]
                if self.errors
                else pa.nulls(len(self)),
                pa.string(),
            ),
        }
        for i, part in enumerate(self.triggers):
            columns[f"triggers[{i}]"] = pa.array(part.count, mask=failed)
            columns[f"first[{i}]"] = optional(part.first)
            columns[f"vacuous[{i}]"] = pa.array(part.vacuous, mask=failed)
        return pa.table(columns)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self.table().__arrow_c_stream__(requested_schema)


def _pyarrow() -> Any:  # noqa: ANN401 - it has no types
    try:
        import pyarrow as pa
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "an Arrow table needs pyarrow; install it from the checkout: pip install '.[files]'",
            name=error.name,
        ) from None
    return pa


_NUMBERS = ("robustness", "lower", "upper")


class JudgedRows(NamedTuple):
    """The numbers of `Judgements` for many traces; traces that are left out are judged alone."""

    robustness: Floats
    lower: Floats
    upper: Floats
    complete: NDArray[np.int8]
    decided_at: NDArray[np.int64]
    vacuous: NDArray[np.bool_]
    triggers: tuple[TriggerColumns, ...]
    left_out: NDArray[np.bool_]

    @classmethod
    def empty(cls, count: int, texts: Sequence[str]) -> JudgedRows:
        """Return rows without judgements."""
        robustness, lower, upper = (np.full(count, np.nan) for _ in range(3))
        triggers = [
            TriggerColumns(
                *(text, np.zeros(count, np.int64), np.zeros(count, np.int64)),
                *(np.full(count, -1, np.int64), np.zeros(count, bool)),
            )
            for text in texts
        ]
        return cls(
            *(robustness, lower, upper, np.zeros(count, np.int8), np.full(count, -1, np.int64)),
            *(np.zeros(count, bool), tuple(triggers), np.ones(count, bool)),
        )

    def place(self, places: NDArray[np.intp], rows: JudgedRows) -> None:
        """Write other rows to some places."""
        for array, values in zip(self._arrays(), rows._arrays(), strict=True):
            array[places] = values

    def put(self, place: int, judged: Judgement) -> None:
        """Write the judgement of a trace that was judged alone."""
        decided = judged.decided_at
        numbers: list[float] = [
            *(judged.robustness, judged.lower, judged.upper, judged.complete),
            *(-1 if decided is None else decided, judged.vacuous),
        ]
        for part in judged.triggers:
            first = -1 if part.first is None else part.first
            numbers += [part.samples, part.count, first, part.vacuous]
        for array, number in zip(self._arrays(), (*numbers, False), strict=True):
            array[place] = number

    def _arrays(self) -> list[NDArray[Any]]:
        parts = [a for t in self.triggers for a in (t.samples, t.count, t.first, t.vacuous)]
        return [*self[:6], *parts, self.left_out]


class _RowDetails:
    """The evidence of a verdict in a batch; unrecorded intervals come from a judgement alone."""

    __slots__ = "_alone", "_open", "decided_at", "evidence"

    early_end = ""

    def __init__(
        self,
        verdict: Verdict,
        end: End,
        decided_at: int | None,
        evidence: Evidence[Any],
        alone: Callable[[], Judgement],
    ) -> None:
        self._open = verdict is Verdict.UNDECIDED and end != "complete"
        self.decided_at, self.evidence, self._alone = decided_at, evidence, alone

    @property
    def unrecorded(self) -> tuple[Unrecorded, ...]:
        return self._alone().unrecorded if self._open else ()


def judgements_of(
    columns: Judgements, alone: Callable[[int], Judgement]
) -> Iterator[Judgement | None]:
    """Yield the judgement of each trace as `judge` returns it; None for a trace with an error.

    ``alone`` judges a trace by its number, for the unrecorded intervals of an open verdict.
    """
    verdicts = {verdict.value: verdict for verdict in Verdict}
    parts = [
        (part.text, *(column.tolist() for column in columns_of))
        for part in columns.triggers
        for columns_of in [(part.samples, part.count, part.first, part.vacuous)]
    ]
    none: Evidence[Any] = Evidence((), vacuous=False, never_triggered=False)
    numbers = zip(
        columns.robustness.tolist(),
        columns.lower.tolist(),
        columns.upper.tolist(),
        columns.verdict.tolist(),
        columns.complete.tolist(),
        columns.decided_at.tolist(),
        columns.vacuous.tolist(),
        strict=True,
    )
    end, formula = columns.end, columns.formula
    for i, (robustness, lower, upper, code, complete, decided, vacuous) in enumerate(numbers):
        if i in columns.errors:
            yield None
            continue
        verdict, evidence = verdicts[code], none
        if parts:
            triggers = tuple(
                TriggerCount(
                    text, samples[i], count[i], None if first[i] < 0 else first[i], empty[i]
                )
                for text, samples, count, first, empty in parts
            )
            never = verdict is Verdict.SATISFIED and not any(row.count for row in triggers)
            evidence = Evidence(triggers, vacuous, never)
        details: Any = _RowDetails(
            verdict, end, None if decided < 0 else decided, evidence, functools.partial(alone, i)
        )
        yield Judgement(
            *(robustness, lower, upper, verdict, end, formula, verdicts[complete], ()),
            details,
        )
