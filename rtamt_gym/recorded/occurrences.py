"""Occurrences on recorded traces: all violations, as text, as a table, and as clips."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError
from rtamt.errors import shown
from rtamt.monitors import Occurrences, RunTable
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import TraceJudgement, arguments, viewed
from rtamt_gym.recorded.parts import file_of
from rtamt_gym.recorded.readers import is_bag
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_row_times
from rtamt_gym.results.matrix import indented
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted

_LISTED = 20
"""Traces whose violations are listed."""

KINDS: Mapping[str, str] = {
    "violations": "violated",
    "unknown": "unknown",
    "responses": "triggered",
    "unknown_triggers": "possibly triggered",
}
"""The tables of a body, and the word for their rows."""


def occurrences_of(
    spec: rtamt.Specification,
    trace: Trace | EventTrace,
    period: Fraction | None,
    reading: EvaluationOptions,
    judgement: TraceJudgement,
) -> Occurrences:
    """Return all violations of a requirement on a trace, at the times of the recording."""
    requirement = viewed(spec, reading.view)
    late = judgement.late_start
    beginning = late is not None and late.counted
    signals, options = arguments(requirement, trace, period, reading, late, beginning=beginning)
    if isinstance(trace, EventTrace):
        return rtamt.dense.occurrences(requirement, signals, reading.end, **options)
    rows = rtamt.occurrences(requirement, signals, end=reading.end, **options)
    return rows if period is None else rows.shifted(judgement.start)


def occurrence_lines(rows: Sequence[Trial]) -> list[str]:
    """Return the text of the occurrences of traces: the counts, and the first rows."""
    several = len(rows) > 1 or any(len(row.outcomes) > 1 for row in rows)
    lines, listed = list[str](), 0
    for row in rows:
        for name, outcome in row.outcomes.items():
            if (occurrences := outcome.occurrences) is None:
                continue
            if len(rows) > 1 and not len(occurrences):
                continue
            listed += 1
            if listed > _LISTED:
                continue
            if several:
                lines += [name if len(rows) == 1 else f"{name} in {row.name}"]
            lines += _text(occurrences, "  " if several else "")
    if listed > _LISTED:
        lines.append(f"and {counted(listed - _LISTED, 'list')} more")
    if listed == 0:
        lines.append("no violation in any trace")
    return lines


def _text(occurrences: Occurrences, indent: str) -> Iterator[str]:
    for body in occurrences.bodies:
        for line in body.lines(occurrences.moment, rates=not occurrences.at_start):
            rest = line.lstrip()
            yield from indented(rest, indent + " " * (len(line) - len(rest)))
    if occurrences.at_start:
        yield f"{indent}evaluated at the first instant only; --view step covers the trace"


def states_of(occurrences: Occurrences, begin: float) -> tuple[Floats, NDArray[Any]]:
    """Return the states of a requirement over a trace: a time and a word for each change.

    The state is ``violated`` if a body is violated, otherwise ``unknown`` if the trace does not
    decide a body, otherwise ``satisfied``.
    """
    # A place is an instant (time, 0), or the time after it (time, 1).
    changes: dict[tuple[float, int], list[tuple[str, int]]] = {(begin, 0): []}
    names = "start", "end", "to_end", "open_start", "closed_end"
    for body in occurrences.bodies:
        for word, table in (("violated", body.violations), ("unknown", body.unknown)):
            columns = (table.columns[name].tolist() for name in names)
            for start, end, to_end, open_start, closed_end in zip(*columns, strict=True):
                first = start, int(open_start and start < end)
                changes.setdefault(first, []).append((word, 1))
                if not to_end:
                    after = end, int(closed_end or start == end)
                    changes.setdefault(after, []).append((word, -1))
    open_runs = dict.fromkeys(("violated", "unknown"), 0)
    states: list[tuple[float, str]] = []
    for (time, _), changed in sorted(changes.items()):
        for word, step in changed:
            open_runs[word] += step
        state = next((word for word, count in open_runs.items() if count), "satisfied")
        if not states or states[-1][1] != state:
            states.append((time, state))
    times, words_ = zip(*states, strict=True)
    return np.array(times, dtype=np.float64), np.array(words_, dtype=np.str_)


def save_occurrences(rows: Sequence[Trial], path: Path) -> None:
    """Write the occurrences of traces as a table, in the format of the file's extension."""
    from rtamt_gym.recorded.output import writer_of

    parts = [
        (row.name, name, body.text, word, getattr(body, kind))
        for row in rows
        for name, outcome in row.outcomes.items()
        if outcome.occurrences is not None
        for body in outcome.occurrences.bodies
        for kind, word in KINDS.items()
    ]
    counts = [len(table) for *_, table in parts]
    table: dict[str, NDArray[Any]] = {}
    for place, name in enumerate(("trace", "requirement", "body", "kind")):
        words = np.array([part[place] for part in parts], dtype=np.str_)
        table[name] = np.repeat(words, counts)
    for name, missing in _COLUMNS.items():
        columns = [_column(part[-1], name, missing) for part in parts]
        table[name] = np.concatenate([np.empty(0, np.asarray(missing).dtype), *columns])
    writer_of(path)(table, path)


_VERDICTS = {-1: "VIOLATED", 0: "UNDECIDED", 1: "SATISFIED"}

_COLUMNS: Mapping[str, Any] = {
    "start": np.nan,
    "end": np.nan,
    "duration": np.nan,
    "to_end": 0,
    "open_start": 0,
    "closed_end": 0,
    "robustness": np.nan,
    "worst_at": np.nan,
    "unseen": 0,
    "verdict": "",
    "answer_time": np.nan,
}
"""The columns of numbers and verdicts, and what a row without one has there."""


def _column(table: RunTable[Any], name: str, missing: Any) -> NDArray[Any]:  # noqa: ANN401 - a cell
    """Return a column of a table; the margin of a response is its robustness."""
    known = table.columns
    if name == "robustness" and "margin" in known:
        name = "margin"
    if name not in known:
        return np.full(len(table), missing)
    if name == "verdict":
        return np.array([_VERDICTS[value] for value in known[name].tolist()], dtype=np.str_)
    return known[name].astype(np.asarray(missing).dtype)


_TEXTS = (".csv", ".csv.gz", ".tsv", ".txt")


class Clip(NamedTuple):
    """A part of a recording.

    Attributes:
        name: The name of the file, without its extension.
        begin: The first time in seconds.
        end: The last time.
    """

    name: str
    begin: float
    end: float


def check_clips(folder: Path, paths: Iterable[str]) -> None:
    """Check that clips of traces can be written to a folder."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"--clip: expected an empty folder or a new one, got {shown(str(folder))}")
    for path in paths:
        if not is_bag(path) and _extension(path) not in (*_TEXTS, ".parquet"):
            raise InputError(f"--clip: expected a CSV or Parquet file or a bag, got {shown(path)}")


def clips_of(rows: Sequence[Trial], around: float, most: int) -> tuple[list[list[Clip]], int]:
    """Return the clips of each trace, and the number of violations beyond the most clips of all."""
    clips: list[list[Clip]] = [[] for _ in rows]
    count = total = 0
    for row, own in zip(rows, clips, strict=True):
        for requirement, outcome in row.outcomes.items():
            occurrences = outcome.occurrences
            if occurrences is None or not len(occurrences):
                continue
            if occurrences.unit != "s":
                raise InputError(
                    f"--clip: {row.name} has no times, which clips need. If a column holds "
                    "times, name it with --time COLUMN."
                )
            total += len(occurrences)
            for run in islice(occurrences, most - count):
                count += 1
                stem = re.sub(r"\W+", "_", f"{requirement}_{float(run.start):.6g}s")
                name = f"{count:04d}_{stem}"
                own.append(Clip(name, float(run.start) - around, float(run.end) + around))
    return clips, total - count


def write_table_clips(
    path: str, variables: Sequence[str], columns: Columns, clips: Sequence[Clip], folder: Path
) -> None:
    """Write the rows of a table around violations, with all of its columns.

    The rows from the first to the last row of the trace in the time of a clip are copied unchanged,
    with the rows of other objects between them.
    """
    times, where = read_row_times(path, variables, columns)
    spans: dict[Path, tuple[int, int]] = {}
    for clip in clips:
        near = np.flatnonzero((times >= clip.begin - _ROUNDING) & (times <= clip.end + _ROUNDING))
        if len(near):
            out = folder / f"{clip.name}{_extension(path)}"
            numbers = [_number(where(row)) for row in near.tolist()]
            spans[out] = min(numbers), max(numbers)
    file = file_of(path)
    if _extension(path) == ".parquet":
        _write_parquet(file, spans)
    else:
        _write_text(file, columns, spans)


_ROUNDING = 1e-9


def _extension(path: str) -> str:
    file = Path(file_of(path))
    suffix = file.suffix.lower()
    return ".csv.gz" if suffix == ".gz" and file.stem.lower().endswith(".csv") else suffix


def _number(place: str) -> int:
    """Return the line or row number at the end of the place of a row."""
    return int(place.rpartition(" ")[2])


def _write_parquet(file: str, spans: Mapping[Path, tuple[int, int]]) -> None:
    import pyarrow.parquet as pq

    table = pq.read_table(file)
    for out, (first, last) in spans.items():
        pq.write_table(table.slice(first - 1, last - first + 1), out)


def _write_text(file: str, columns: Columns, spans: Mapping[Path, tuple[int, int]]) -> None:
    from rtamt_gym.recorded.csv_reader import CsvRecording, open_file

    with open_file(file, columns) as recording:
        above = cast("CsvRecording", recording).last_above
    with _opened(file, "rb") as raw:
        lines = raw.readlines()
    if lines and lines[0].startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"--clip: {shown(file)} is UTF-16 text. Save it as UTF-8.")
    for out, (first, last) in spans.items():
        with _opened(str(out), "wb") as raw:
            raw.writelines(lines[:above])
            raw.writelines(_rows(lines, first, last))


def _rows(lines: Sequence[bytes], first: int, last: int) -> Sequence[bytes]:
    """Return the lines of rows, by the last line of the first and of the last row, from 1.

    A quoted cell of the first row may start above.
    """
    begin = first - 1
    while begin > 0 and sum(line.count(b'"') for line in lines[begin:first]) % 2:
        begin -= 1
    return lines[begin:last]


def _opened(file: str, mode: str) -> BinaryIO:
    if file.lower().endswith(".gz"):
        return cast("BinaryIO", gzip.open(file, mode))
    return cast("BinaryIO", Path(file).open(mode))
