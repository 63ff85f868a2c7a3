"""Clips: parts of a recording around each violation, in the format of the recording."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

import numpy as np

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import file_of
from rtamt_gym.recorded.readers import is_bag
from rtamt_gym.recorded.ruled import read_row_times
from rtamt_gym.results.trial import Trial

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
    """Check that clips of traces can be written to a folder.

    Raises:
        InputError: If the folder is not empty, or a trace has another format.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"--clip: expected an empty folder or a new one, got {shown(str(folder))}")
    for path in paths:
        if not is_bag(path) and _extension(path) not in (*_TEXTS, ".parquet"):
            raise InputError(f"--clip: expected a CSV or Parquet file or a bag, got {shown(path)}")


def clips_of(rows: Sequence[Trial], around: float, most: int) -> tuple[list[list[Clip]], int]:
    """Return the clips of each trace, and the number of violations without one.

    Args:
        rows: The traces with their occurrences.
        around: Seconds before and after each violation.
        most: The maximum number of clips of all traces.

    Raises:
        InputError: If a trace with violations has no times.
    """
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

    Args:
        path: The trace.
        variables: The variables that the requirements read.
        columns: How its columns are read.
        clips: The clips.
        folder: The folder of the clips.
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
    """Return the lines of rows.

    Args:
        lines: The lines of the file.
        first: The line, from 1, with the last part of the first row; a quoted cell may start above.
        last: The line with the last part of the last row.
    """
    begin = first - 1
    while begin > 0 and sum(line.count(b'"') for line in lines[begin:first]) % 2:
        begin -= 1
    return lines[begin:last]


def _opened(file: str, mode: str) -> BinaryIO:
    if file.lower().endswith(".gz"):
        return cast("BinaryIO", gzip.open(file, mode))
    return cast("BinaryIO", Path(file).open(mode))
