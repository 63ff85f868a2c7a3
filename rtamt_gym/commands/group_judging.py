"""Judges all plain groups of a block of a table in one call of `judge_many`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import RtamtError
from rtamt.errors import shown
from rtamt.internal import judgements_of
from rtamt.monitors import Judgements
from rtamt_gym.commands.judged import Judged, failure_of
from rtamt_gym.commands.traces import TracesAsked
from rtamt_gym.judging.stages import progress_of, stages_of
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.group_traces import GroupBlock, GroupTraces
from rtamt_gym.recorded.groups import GroupTable, groups_by_table
from rtamt_gym.recorded.judge import TraceJudgement, judge, viewed
from rtamt_gym.recorded.readers import format_of
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import checked_columns
from rtamt_gym.results.outcome import Failure

_BLOCK: Final = 1 << 20
"""The rows after which a block of groups ends."""


def judged_groups(request: TracesAsked, paths: Sequence[str]) -> Iterator[tuple[int, Judged]]:
    """Yield the places of groups in a list of traces, and their judgements.

    Groups that are not plain are left out, and so is every trace that is not a group of a table.
    """
    for table, places in groups_by_table(paths, request.columns):
        numbers, size = list[int](), 0
        judges = _Judges(request, table, paths[next(iter(places))]) if places else None
        if judges is None or not judges.usable:
            continue
        for number, rows in places.items():
            numbers.append(number)
            size += len(rows)
            if size >= _BLOCK or len(numbers) == len(places):
                yield from judges.block(numbers, paths, places)
                numbers, size = [], 0
        if numbers:
            yield from judges.block(numbers, paths, places)


class _Judges:
    """The judges of the groups of a table."""

    def __init__(
        self, request: TracesAsked, table: GroupTable, path: str, more: GroupTraces | None = None
    ) -> None:
        self._request = request
        self._ways: dict[tuple[str, Fraction | None], _Way] = {}
        try:
            columns = checked_columns(path, format_of(path), request.columns)
        except RtamtError:
            self.usable = False
            return
        self._traces = GroupTraces(table, request.specs, request.reading, columns, more)
        # A table without times does not have a length.
        measured = request.min_duration is None or self._traces.measured
        self.usable = self._traces.usable and measured
        self._parts: list[tuple[tuple[str, ...], GroupTraces]] = []
        self._rest: _Judges | None = None
        if self.usable and self._traces.timed:
            self._split(table, path)

    def _split(self, table: GroupTable, path: str) -> None:
        """Prepare the requirements that a single row can decide, where others need a period."""
        parts: dict[tuple[str, ...], list[str]] = {}
        for name, spec in self._request.specs.items():
            parts.setdefault(tuple(sorted(spec.variables)), []).append(name)
        untimed = []
        for names in parts.values():
            request = self._request.having({name: self._request.specs[name] for name in names})
            columns = checked_columns(path, format_of(path), request.columns)
            part = GroupTraces(table, request.specs, request.reading, columns, self._traces)
            self._parts.append((tuple(names), part))
            if not self._parts[-1][1].timed:
                untimed += names
        readable = {name: spec for name, spec in self._request.specs.items() if name in untimed}
        if readable:
            self._rest = _Judges(self._request.having(readable), table, path, self._traces)

    def block(
        self, numbers: Sequence[int], paths: Sequence[str], places: Mapping[int, NDArray[np.intp]]
    ) -> Iterator[tuple[int, Judged]]:
        """Judge the plain groups of a block."""
        names = [paths[number] for number in numbers]
        block = self._traces.block(names, [places[number] for number in numbers])
        if block is None:
            return
        for i, judged in self._judged(block, names):
            yield numbers[i], judged
        if short := [numbers[i] for i in np.flatnonzero(block.too_short).tolist()]:
            yield from self._short(short, paths, places)

    def _short(
        self, numbers: Sequence[int], paths: Sequence[str], places: Mapping[int, NDArray[np.intp]]
    ) -> Iterator[tuple[int, Judged]]:
        """Judge groups of one row; requirements with time bounds have an error."""
        names, rows = [paths[number] for number in numbers], [places[n] for n in numbers]
        sure, failing = np.ones(len(numbers), bool), list[str]()
        for part, traces in self._parts:
            block = traces.block(names, rows)
            if block is None:
                return
            sure &= block.too_short if traces.timed else block.plain
            failing += part if traces.timed else ()
        rest = dict[int, Judged]()
        if self._rest is not None:
            if not self._rest.usable:
                return
            rest = dict(self._rest.block(numbers, paths, places))
        for number, path, alone in zip(numbers, names, sure.tolist(), strict=True):
            if not alone or (self._rest is not None and number not in rest):
                continue
            failure = Failure(
                f"{shown(path)}: expected at least two samples to read the period from, got one; "
                "give --period in seconds"
            )
            judged = rest.get(number, Judged(path))
            judged.failures |= dict.fromkeys(failing, failure)
            yield number, judged

    def _judged(self, block: GroupBlock, names: Sequence[str]) -> Iterator[tuple[int, Judged]]:
        """Judge the plain groups of a block, the groups of each period together."""
        same: dict[Fraction | None, list[int]] = {}
        for i in np.flatnonzero(block.plain).tolist():
            same.setdefault(block.periods[i], []).append(i)
        for period, chosen in same.items():
            ways = {name: self._way(name, period) for name in self._request.specs}
            rows = {name: way.judge(block, chosen) for name, way in ways.items()}
            for position, i in enumerate(chosen):
                judged = Judged(names[i], block.trace(i), period)
                for name, way in ways.items():
                    way.put(judged, name, rows[name], position)
                yield i, judged

    def _way(self, name: str, period: Fraction | None) -> _Way:
        key = name, period
        if key not in self._ways:
            if len(self._ways) >= _MOST_WAYS:
                self._ways.clear()
            reading = self._request.reading.about(name)
            self._ways[key] = _Way(self._request.specs[name], reading, period)
        return self._ways[key]


_MOST_WAYS: Final = 1000
"""The maximum number of prepared pairs of requirement and period."""


class _Way:
    """How a requirement is judged on traces of one period."""

    def __init__(
        self, spec: rtamt.Specification, reading: EvaluationOptions, period: Fraction | None
    ) -> None:
        self._spec, self._reading, self._period = spec, reading, period
        self._step = None if period is None else float(period)
        self._options: dict[str, Any] | None = None
        self._requirement = spec
        try:
            self._requirement = viewed(spec, reading.view)
            self._at_period = reading.having(period=period)
            self._staged = bool(stages_of({"": self._requirement}, self._at_period))
            if self._requirement.variables:
                self._options = self._at_period.from_monitors({"": self._requirement})[""]
        except RtamtError:  # judging each trace raises it again
            self._options = None

    def judge(
        self, block: GroupBlock, chosen: Sequence[int]
    ) -> list[tuple[rtamt.Judgement | None, rtamt.Verdict | None]] | None:
        """Return the judgements of some groups, and under ``complete`` their verdicts if cut.

        The result is None if no group can be judged in the call, and a judgement is None if its
        group cannot.
        """
        options, requirement = self._options, self._requirement
        if options is None:
            return None
        columns, lengths = block.joined(requirement.variables, chosen)

        def alone(position: int) -> rtamt.Judgement:
            signals, n = block.columns(requirement.variables, chosen[position])
            return rtamt.judge(requirement, signals, end=self._reading.end, n=n, **options)

        many: Callable[..., Judgements] = rtamt.judge_many
        try:
            judged, cut = (
                many(requirement, columns, end=end, lengths=lengths, errors="keep", **options)
                if end
                else None
                for end in (self._reading.end, "cut" if self._reading.end == "complete" else "")
            )
        except RtamtError:
            return None
        assert judged is not None, "it has an end mode"  # noqa: S101 - for mypy
        rows = judgements_of(judged, alone)
        if cut is None:
            return [(row, None) for row in rows]
        verdicts = map(rtamt.Verdict, cut.verdict.tolist())
        return [
            (None if i in cut.errors else row, verdict)
            for i, (row, verdict) in enumerate(zip(rows, verdicts, strict=True))
        ]

    def put(
        self,
        judged: Judged,
        name: str,
        rows: Sequence[tuple[rtamt.Judgement | None, rtamt.Verdict | None]] | None,
        position: int,
    ) -> None:
        """Add the judgement of a trace, or its failure."""
        trace = judged.trace
        assert isinstance(trace, Trace), "a group of samples"  # noqa: S101 - for mypy
        judgement, cut = (None, None) if rows is None else rows[position]
        try:
            judged.judgements[name] = (
                judge(self._spec, trace, self._period, self._reading, formulas=False)
                if judgement is None
                else self._judgement(judgement, cut, trace)
            )
        except Exception as error:  # noqa: BLE001 - the others are to be judged
            judged.failures[name] = failure_of(error)

    def _judgement(
        self, judgement: rtamt.Judgement, cut: rtamt.Verdict | None, trace: Trace
    ) -> TraceJudgement:
        """Return a judgement as `judge` of `rtamt_gym.recorded.judge` does."""
        progress = None
        if self._staged:
            progress = progress_of(self._requirement, trace.columns, self._at_period)
        return TraceJudgement(
            *(judgement, {}, self._reading.semantics, trace.start, self._period, self._step),
            progress=progress,
            cut=cut,
            from_start=judgement,
        )
