"""The judge of a stream: from blocks of bytes to lines and an exit code."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final, Literal

import rtamt
from rtamt import InputError
from rtamt.errors import shown
from rtamt.typing import End
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.csv_reader import unit_below
from rtamt_gym.recorded.names import starts_of
from rtamt_gym.recorded.recording import RawTimes
from rtamt_gym.results.extent import short_text
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.warnings import VerdictWarning, exit_code
from rtamt_gym.tables import counted
from rtamt_gym.watching.clock import ClockRules, StreamClock
from rtamt_gym.watching.events import EventGroup
from rtamt_gym.watching.groups import IdleGroups, LostStarts
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.rows import (
    BadLine,
    JsonRows,
    Lines,
    RowBlock,
    RowFault,
    RowReader,
    TextRows,
)
from rtamt_gym.watching.sampled import SampledGroup
from rtamt_gym.watching.states import StreamRules, StreamStop
from rtamt_gym.watching.values import Numbered, StreamColumns, without_place

RowFormat = Literal["csv", "ndjson"]
"""How lines hold rows."""


@dataclass(frozen=True)
class WatchOptions:
    """How a stream is read and judged.

    Attributes:
        specs: The requirements by name.
        reading: The options of evaluation.
        columns: How columns are read.
        format: How lines hold rows; None to recognise it by the first byte.
        by: The columns that name groups; without one, all rows are one trace.
        max_groups: The maximum number of groups at one time.
        group_idle: Seconds of trace time after which a group has ended; None: never.
        every: Whether every sample has lines.
        stop: When the stream stops.
        skip_bad: Whether bad lines are left out.
        min_duration: Minimum length of each trace in seconds; None for any length.
        live: Whether the input may end in the middle of a line, as a socket or a growing file.
    """

    specs: Mapping[str, rtamt.Specification]
    reading: EvaluationOptions
    columns: Columns
    format: RowFormat | None = None
    by: Sequence[str] = ()
    max_groups: int = 100_000
    group_idle: Fraction | None = None
    every: bool = False
    stop: StreamStop = "end"
    skip_bad: bool = False
    min_duration: Fraction | None = None
    live: bool = False

    def __post_init__(self) -> None:
        stated = self.reading.period is not None
        if stated and self.reading.dense:
            raise InputError("expected --period or --dense, which reads events at any time")
        if self.min_duration is not None and self.stop != "end":
            raise InputError(
                f"expected --min-duration without --stop {self.stop}, which ends a trace early"
            )
        if not self.by and self.group_idle is not None:
            raise InputError("--group-idle ends groups, which --by COLUMN makes")
        if self.by and self.skip_bad and stated:
            raise InputError(
                "expected --skip-bad without --by and --period: the group of a bad line is not "
                "known. Leave out --period, so that the times show the gap."
            )
        unknown = self.skip_bad or self.columns.missing == "unknown"
        bounded = [name for name, spec in self.specs.items() if spec.horizon < math.inf]
        if unknown and self.reading.view == "step" and bounded:
            option = "--skip-bad" if self.skip_bad else "--missing unknown"
            raise InputError(
                f"{option}: --view step needs the robustness at each instant, which a sample that "
                "is not known does not have"
            )


_WORDS: Final[Mapping[str, Word]] = {
    "VIOLATED": "violated",
    "UNDECIDED": "undecided",
    "SATISFIED": "satisfied",
}

Group = SampledGroup | EventGroup


class StreamWatch:
    r"""A judge of a stream that arrives in blocks of bytes of any size.

    Attributes:
        stopped: Whether ``--stop`` has ended the stream.
        notes: Notes on cells and columns that were not read literally.
        bad: The number of bad lines that were left out.

    Example:
        >>> import rtamt
        >>> from rtamt_gym import EvaluationOptions
        >>> from rtamt_gym.recorded.columns import Columns
        >>> specs = {"near": rtamt.parse("always(x < 2)")}
        >>> watch = StreamWatch(WatchOptions(specs, EvaluationOptions(), Columns()), "stdin", print)
        >>> for block in (b"time,x\n0,1", b"\n1,3\n"):
        ...     watch.add(block)
        Line(requirement='near', group=None, time=0.0, sample=0, ...
        Line(requirement='near', group=None, time=1.0, sample=1, ...
    """

    def __init__(self, options: WatchOptions, source: str, emit: Callable[[Line], None]) -> None:
        self._options, self._source = options, source
        columns = replace(options.columns, starts=starts_of(options.specs, options.columns))
        reading = options.reading
        if options.skip_bad or columns.missing == "unknown":
            reading = reading.having(nan="unknown")
        self._columns = columns
        self._cells = StreamColumns(
            source,
            dict(options.specs),
            columns,
            by=options.by,
            dense=reading.dense,
            period=reading.period is not None,
        )
        if reading.period is not None:
            reading = reading.having(period=reading.seconds)
        self.rules = StreamRules(
            *(options.specs, self._cells.variables, reading, emit, options.every, options.stop),
            source=source,
        )
        self._lines, self._line = Lines(source), 1
        self._reader: RowReader | None = None
        self._chosen = False
        self._clock: ClockRules | None = None
        self.traces: dict[str | None, Group] = {}
        self._touched: Group | None = None
        self._guarded = self._beyond = self._stop_line = 0
        self._ended = Counter[bool]()
        """The traces that have ended, by whether all their verdicts are decided."""
        self._idle = IdleGroups(float(options.group_idle or 0), source)
        self._lost = LostStarts(options.max_groups)
        self._stream_clock: StreamClock | None = None
        self._words: set[Word] = set()
        self._warnings: list[VerdictWarning] = []
        self.failures: list[str] = []
        self.rows = self.bad = 0
        self._first_bad = ""
        self.stopped = False

    @property
    def notes(self) -> list[str]:
        """Notes on cells and columns that were not read literally."""
        return self._cells.notes

    def add(self, block: bytes) -> None:
        """Judge the lines that a block completes."""
        self._take(self._lines.add(block))

    def _take(self, lines: list[bytes], *, last: bool = False) -> None:
        """Judge lines; no line follows the last one, so it can be left out."""
        first = self._line
        self._line += len(lines)
        if self._reader is None:
            self._reader = self._reader_for(lines)
            if self._reader is None:
                self._line = first + len(lines)
                return
        for item in self._reader.rows(lines, first):
            if isinstance(item, BadLine):
                self._left_out(item.line, item.reason, skippable=item.skippable or last)
            else:
                self._block(item)
            if self.stopped:
                return

    def _reader_for(self, lines: Sequence[bytes]) -> RowReader | None:
        """Return the reader for the first line; None without a line."""
        if not lines:
            return None
        wanted = self._options.format
        begin = lines[0].removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
        if wanted == "ndjson" or (wanted is None and begin == b"{"):
            return JsonRows(self._source)
        return TextRows(self._columns, self._source)

    def _left_out(
        self, line: int, reason: str, group: str | None = None, *, skippable: bool = True
    ) -> None:
        """Leave out a bad line of a group, if it is known, or raise its error."""
        message = f"{self._source}, line {line}: {reason}"
        if not (self._options.skip_bad and skippable):
            raise InputError(message)
        if not self.rows:
            raise InputError(f"{message} (--skip-bad needs a good first row)")
        if self._options.by and self._cells.time is None:
            raise InputError(
                f"{message} (--skip-bad with --by needs a column of times, which shows the groups "
                "that miss a row)"
            )
        self.bad += 1
        self._first_bad = self._first_bad or message
        if self._options.by:
            trace = None if group is None else self.traces.get(group)
            if group is not None and group in self._idle:
                self._idle.add_late(group)
            elif trace is None or not trace.begun:
                self._lost.add(group, message)
        for trace in self.traces.values():
            trace.lose()

    def _block(self, block: RowBlock) -> None:
        if not self._chosen:
            self._choose(block)
        at, count = 0, len(block.lines)
        while at < count and not self.stopped:
            part = block.part(at, count) if at else block
            fault: RowFault | None = None
            numbered = None
            try:
                numbered = self._cells.numbers(part)
            except RowFault as error:
                fault = error
                if error.row:
                    numbered = self._cells.numbers(part.part(0, error.row))
            if numbered is not None:
                fault = self._judge(numbered, part) or fault
            if fault is None or self.stopped:
                return
            group = self._cells.group_at(part, fault.row)
            self._left_out(part.lines[fault.row], fault.reason, group, skippable=fault.skippable)
            at += fault.row + 1

    def _choose(self, block: RowBlock) -> None:
        reader = self._reader
        assert reader is not None, "it made the block"  # noqa: S101 - for mypy
        chosen = self._cells.choose(reader.names, block, totals=reader.totals)
        reader.choose(chosen, self._cells.needed, self._cells.take_field)
        time = self._cells.time
        if time is not None:
            where = f"{self._source}, line {reader.units_line}"
            unit = self._cells.unit_of_parts()
            unit = unit or unit_below(where, time.name, reader.units, self._columns)
            self._clock = ClockRules(self._source, time.name, self._columns, unit)
        elif self._options.group_idle is not None:
            raise InputError(f"{self._source}: --group-idle needs a column of times, got none")
        self.notes[:0] = reader.notes
        self._chosen = True

    def _judge(self, numbered: Numbered, block: RowBlock) -> RowFault | None:
        """Judge rows; return the first fault, or None."""
        try:
            if numbered.groups is None:
                self._one_group(None, numbered, block, 0, len(numbered.values))
            else:
                self._by_group(numbered, numbered.groups, block)
        except RowFault as fault:
            return fault
        return None

    def _note_stop(self, trace: Group, lines: Sequence[int]) -> None:
        """Note whether a trace has stopped the stream, and the number of rows after the stop."""
        self.stopped = trace.stopped
        if trace.stopped:
            self._stop_line = trace.stop_line
            self._beyond = sum(line > trace.stop_line for line in lines)

    def _one_trace(
        self, group: str | None, block: RowBlock, times: RawTimes | None, begin: int, end: int
    ) -> tuple[int, RowFault | None]:
        """Check that rows belong to one trace; return the end of its rows, and the fault."""
        if not self._cells.guarded:
            return end, None
        lines = block.lines
        first = next((i for i in range(begin, end) if lines[i] > self._guarded), end)
        try:
            if first < end:
                self._cells.check_one_trace(group, block, times, first, end)
        except RowFault as fault:
            place = "" if group is None else f"group {shown(group)!r}: "
            return fault.row, RowFault(fault.row, f"{place}{fault.reason}", skippable=False)
        self._guarded = max(self._guarded, lines[end - 1])
        return end, None

    def _by_group(self, numbered: Numbered, groups: Sequence[str], block: RowBlock) -> None:
        """Judge the rows of groups, in order."""
        at, count = 0, len(groups)
        seconds = self._seconds(numbered, block.lines)
        while at < count and not self.stopped:
            group, end = groups[at], at + 1
            if seconds is None:
                while end < count and groups[end] == group:
                    end += 1
            else:
                self._idle.check(group, at)
                self._idle.add(group, seconds[at])
            self._one_group(group, numbered, block, at, end)
            if seconds is not None and not self.stopped:
                for idle in self._idle.ended_at(seconds[at]):
                    self._finish(self.traces.pop(idle), self.rules.reading.end)
                decided = self.traces and not self.rules.undecided
                self.stopped = self._options.stop == "decided" and bool(decided)
                self._stop_line = block.lines[at]
            at = end

    def _one_group(
        self, group: str | None, numbered: Numbered, block: RowBlock, begin: int, end: int
    ) -> None:
        """Judge successive rows of one trace."""
        lines = block.lines[begin:end]
        end, fault = self._one_trace(group, block, numbered.times, begin, end)
        if end > begin:
            times = None if numbered.times is None else numbered.times[begin:end]
            trace = self._trace(None) if group is None else self._group(group, begin)
            before = trace.samples
            try:
                trace.feed(numbered.values[begin:end], times, block.lines[begin:end])
            except RowFault as error:
                fault = error
                fault.row += begin
            self.rows += (fault.row if fault else end) - begin
            self.rows = max(self.rows, 1) if trace.samples > before else self.rows
            self._note_stop(trace, lines)
        if fault is not None and not self.stopped:
            raise fault

    def _seconds(self, numbered: Numbered, lines: Sequence[int]) -> list[float] | None:
        """Return the times of rows on one clock, for ``--group-idle``; None without it."""
        if self._options.group_idle is None or numbered.times is None or self._clock is None:
            return None
        try:
            if self._stream_clock is None:
                self._stream_clock = StreamClock(self._clock, numbered.times[:1], lines)
            seconds: list[float] = self._stream_clock.since(numbered.times).tolist()
        except InputError as error:
            raise RowFault(0, without_place(error)) from None
        return seconds

    def _group(self, group: str, row: int) -> Group:
        trace = self.traces.get(group)
        if trace is None or not trace.begun:
            self._lost.check_start(group, row)
        if trace is None:
            self._lost.count_start(group)
            if len(self.traces) >= self._options.max_groups:
                raise RowFault(
                    row,
                    f"expected at most {self._options.max_groups} groups at one time, got another, "
                    f"{shown(group)!r}. Give --group-idle TIME to end groups, or a larger "
                    "--max-groups.",
                    skippable=False,
                )
        return self._trace(group)

    def _trace(self, group: str | None) -> Group:
        trace = self._touched = self.traces.get(group)
        if trace is None:
            if self.rules.reading.dense:
                assert self._clock is not None, "it was checked"  # noqa: S101 - for mypy
                absent = [n for n in self._cells.variables if n not in self._cells.there]
                trace = EventGroup(self.rules, self._columns, self._clock, group, absent)
            else:
                trace = SampledGroup(
                    self.rules, self._columns, self._clock, group, lost=self._options.skip_bad
                )
            self.traces[group] = self._touched = trace
        return trace

    def _finish(self, trace: Group, end: End, *, early: bool = False) -> None:
        """End a trace and emit its final lines."""
        # After an error or Ctrl-C, the exit code already shows that verdicts are not reliable.
        fault = ""
        if self.stopped or not early:
            beyond = self._beyond if trace.stopped else 0
            fault = self._cells.end_trace(trace.group, early=early, beyond=beyond)
        try:
            lines = trace.finish(end, early=early)
        except (InputError, RowFault) as error:
            fault = str(error)
        if fault:
            position = "" if trace.group is None else f"group {shown(trace.group)!r}: "
            source = "" if fault.startswith(self._source) else f"{self._source}: "
            self.failures.append(f"{position}{source}{fault}")
            self._words.add("failed")
            return
        for line in lines:
            self._words.add(_WORDS[line.verdict.name])
            self.rules.emit(line)
        self._ended[all(line.verdict for line in lines)] += 1
        self._check_length(trace)

    def _check_length(self, trace: Group) -> None:
        least = self._options.min_duration
        if least is None:
            return
        extent = trace.extent()
        name = self._source if trace.group is None else f"group {shown(trace.group)}"
        if extent.length is None:
            self.failures.append(
                f"{name}: expected a column of times, by which --min-duration measures, got none; "
                "give --time COLUMN or --period"
            )
            self._words.add("failed")
        elif text := short_text({name: extent}, least):
            self._warnings.append(VerdictWarning(text, "too short", fails=True))

    def end_of_input(self) -> None:
        """Judge a last line without an end, and check that there were rows."""
        remaining = self._lines.finish()
        self._take(remaining, last=True)
        if self._options.live and b"".join(remaining).strip():
            text = (
                f"the last line, line {self._line - 1}, has no end, as if the writer had stopped "
                "in it: its values may be cut. Write an end of line after the last row."
            )
            self._warnings.append(VerdictWarning(text, "last line", fails=True))
        if self._reader is None:
            raise InputError(
                f"{self._source}: expected a first line with the names of the columns, or one "
                "JSON object in each line, got none"
            )
        self._reader.finish()
        if not self.rows and not self.traces:
            raise InputError(f"{self._source}: expected at least one row, got none")
        fault = "" if self.stopped else self._fault_of_end()
        if fault:
            raise InputError(f"{self._source}: {fault}")
        if not self.stopped:
            self.failures += self._lost.failures(self._source)
            self._words |= {"failed"} if self.failures else set()

    def _fault_of_end(self) -> str:
        """Return the fault that the end of the input shows; empty without one."""
        if self._reader is not None and self._reader.totals and not self.bad and self._chosen:
            fault = self._cells.totals_in(self._reader.last_cells())
            last = self._touched
            if last is not None and last.group and last.samples < 2 and len(self.traces) > 1:
                fault = fault or self._cells.group_of_totals(last.group)
            if fault:
                return fault
        return self._cells.end_trace(None)

    def finish(self, *, early: bool) -> None:
        """End all traces and emit their final lines."""
        end: End = "open" if early else self.rules.reading.end
        for trace in self.traces.values():
            self._finish(trace, end, early=early)
        self.traces.clear()
        fault = self.rules.periods.fault() if self.stopped or not early else ""
        if fault:
            self.failures.append(f"{self._source}: {fault}")
            self._words.add("failed")

    def seconds(self) -> float | None:
        """Return the time of the last row in seconds; None before the first, or without times."""
        return None if self._touched is None else self._touched.seconds

    def newest(self) -> Iterator[Line]:
        """Yield the newest line of each requirement in each group."""
        for trace in self.traces.values():
            yield from trace.newest()

    def exit_code(self) -> int:
        """Return the exit code, as `rtamt monitor` does for these verdicts."""
        return exit_code(self._words, self._own_warnings())

    def _own_warnings(self) -> list[VerdictWarning]:
        """Return the warnings on traces that are too short or may lack rows."""
        lost = filter(None, [self._idle.late_text(), *self._lost.notes()])
        return [*self._warnings, *(VerdictWarning(text, fails=True) for text in lost)]

    def messages(self) -> list[str]:
        """Return the notes and warnings, in sentences to print."""
        warnings = [*self.rules.evidence.warnings(), *self._own_warnings()]
        texts = [warning.text for warning in warnings]
        if self.bad:
            texts.append(f"{counted(self.bad, 'bad line')} left out, the first: {self._first_bad}")
        if self.stopped:
            texts.append(self._stop_text())
        read = self.rules.notes.texts(dense=self.rules.reading.dense)
        return [*self.notes, *self._cells.mark_notes(), *read, *texts]

    def _stop_text(self) -> str:
        """Return a sentence on the rows that ``--stop`` left unread."""
        place = f"--stop {self._options.stop} ended the stream at line {self._stop_line}"
        if not self._options.by:
            return f"{place}: rows after it were not read"
        decided, groups = self._ended[True], counted(sum(self._ended.values()), "group")
        return (
            f"{place}, with {decided} of {groups} decided: rows and groups after it were not read"
        )
