"""Writes judged traces: the report on one trace, JSON, and files of robustness."""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, Verdict
from rtamt.errors import shown
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import RESULT, Series, TraceJudgement
from rtamt_gym.recorded.names import VALUE, VARIABLE
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import format_of
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TIME
from rtamt_gym.results.codec import document_parts, plain, plain_results, plain_trial
from rtamt_gym.results.matrix import Matrix, indented, label, undecided_lines
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted, number, shorten, table

if TYPE_CHECKING:
    import pyarrow as pa

ColumnTable = Mapping[str, NDArray[Any]]
"""Columns of doubles, integers or text."""

_LONG = 1 << 17
"""Cells from which on a text is worth the import of pyarrow."""

_PIECE = 1 << 15
"""Rows that one thread writes at once."""


def check_output(path: Path) -> None:
    """Check that robustness can be written to a file with this extension."""
    writer_of(path)


def save(judgements: Mapping[str, TraceJudgement], path: Path, *, dense: bool) -> None:
    """Write the robustness of every formula in the format of the file's extension.

    For samples, the columns are the times, or the sample numbers if the period is unknown, and the
    robustness of each formula, nan before its variables are known. In dense time a row is one
    event, with its time, variable and value.
    """
    series = _named(judgements)
    table: dict[str, NDArray[Any]]
    if dense:
        times, values = (
            np.concatenate([getattr(line, part) for line in series.values()])
            for part in ("times", "values")
        )
        counts = [len(line.times) for line in series.values()]
        named = np.repeat(np.array([*series]), counts)
        order = np.lexsort((values, named, times))
        table = {TIME: times[order], VARIABLE: named[order], VALUE: values[order]}
    else:
        first = max(series.values(), key=lambda line: len(line.times))
        table = {name: _filled(line.values, len(first.times)) for name, line in series.items()}
        if first.step is None:
            table = {"sample": np.arange(len(first.times)), **table}
        else:
            table = {TIME: first.times, **table}
    writer_of(path)(table, path)


def _filled(values: Floats, count: int) -> Floats:
    """Return values of the last samples with nan before them, in the required number."""
    missing = count - len(values)
    return np.concatenate([np.full(missing, np.nan), values]) if missing else values


def writer_of(path: Path) -> Callable[[ColumnTable, Path], None]:
    """Return the function that writes a table to a file with the extension of a path."""
    for extension, write in WRITERS.items():
        if path.name.lower().endswith(extension):
            return write
    *others, last = WRITERS
    raise InputError(
        f"cannot write {path}: expected a name that ends in {', '.join(others)} or {last}"
    )


def _named(judgements: Mapping[str, TraceJudgement]) -> dict[str, Series]:
    named = {}
    for spec, judgement in judgements.items():
        for formula, series in judgement.series.items():
            parts = [spec] if len(judgements) > 1 else []
            if formula != RESULT:
                parts.append(formula)
            named[".".join(parts) or "robustness"] = series
    return named


def _write_csv(table: ColumnTable, path: Path) -> None:
    rows = len(next(iter(table.values())))
    with _opened(path) as file:
        head = io.StringIO()
        csv.writer(head, lineterminator="\n").writerow(table)
        file.write(head.getvalue().encode())
        if rows * len(table) >= _LONG and find_spec("pyarrow"):
            for piece in _pieces(_arrow(table), rows):
                file.write(piece)
        else:
            text = io.TextIOWrapper(file, encoding="utf-8", newline="")
            columns = (column.tolist() for column in table.values())
            csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
            text.detach()


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    with path.open("wb") as file:
        if path.suffix.lower() != ".gz":
            yield file
            return
        with gzip.GzipFile(fileobj=file, mode="wb", compresslevel=1) as packed:
            yield cast("BinaryIO", packed)


def _pieces(table: pa.Table, rows: int) -> Iterator[memoryview]:
    """Yield the text of a table in pieces, which threads write in parallel."""
    from concurrent.futures import ThreadPoolExecutor

    import pyarrow as pa
    import pyarrow.csv as pc

    options = pc.WriteOptions(include_header=False)

    def text(begin: int) -> memoryview:
        out = pa.BufferOutputStream()
        pc.write_csv(table.slice(begin, _PIECE), out, options)
        return memoryview(out.getvalue())

    with ThreadPoolExecutor(workers := os.cpu_count() or 1) as threads:
        begins = iter(range(0, rows, _PIECE))
        while batch := list(itertools.islice(begins, 4 * workers)):
            yield from threads.map(text, batch)


def _arrow(table: ColumnTable) -> pa.Table:
    import pyarrow as pa

    def array(column: NDArray[Any]) -> pa.Array:
        if column.dtype.kind == "U":
            return pa.array(column.tolist())
        kind = pa.float64() if column.dtype.kind == "f" else pa.int64()
        # Avoid a copy, and the import of pandas by pa.array.
        buffer = pa.py_buffer(np.ascontiguousarray(column))
        return pa.Array.from_buffers(kind, len(column), [None, buffer])

    return pa.Table.from_arrays([array(column) for column in table.values()], names=[*table])


def _write_parquet(table: ColumnTable, path: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(_arrow(table), path)


def _write_feather(table: ColumnTable, path: Path) -> None:
    from pyarrow import feather

    feather.write_feather(_arrow(table), path)


WRITERS: Mapping[str, Callable[[ColumnTable, Path], None]] = {
    ".csv": _write_csv,
    ".csv.gz": _write_csv,
    ".parquet": _write_parquet,
    ".feather": _write_feather,
    ".arrow": _write_feather,
}
"""For each extension what writes a table to such a file."""


def report(
    judgements: Mapping[str, TraceJudgement],
    trace: Iterable[str],
    notes: Iterable[str] = (),
    reasons: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """Return the lines of judgements in words and as a table."""
    several = len(judgements) > 1
    rows = [("spec", "formula", "at the start", "minimum", "at", "violated from")]
    for name, judgement in judgements.items():
        for formula, values in judgement.series.items():
            series = values.instants
            least, below = series.least, series.below
            rows.append(
                (
                    name if several and formula == next(iter(judgement.series)) else "",
                    formula,
                    judgement.text_of(float(series.values[0])),
                    judgement.text_of(float(series.values[least])),
                    series.at(least),
                    "-" if below is None else series.at(below),
                )
            )
    room = 80 - sum(2 + max(map(len, column)) for column in list(zip(*rows, strict=True))[2:])
    width = max(8, (room - 2) // 2 if several else room)
    cells = [[shorten(text, width) for text in row[:2]] + [*row[2:]] for row in rows]
    verdicts, unknown = [], {}
    for name, judgement in judgements.items():
        verdicts.append(f"{shorten(name, 20)}: {judgement}" if several else str(judgement))
        if name in reasons:
            verdicts += indented(f"why: {reasons[name]}", "    ")
        verdicts += undecided_lines(judgement.not_recorded, judgement.way_out)
        if judgement.late_start is not None:
            verdicts += indented(judgement.late_start.text, "    ")
        verdicts += [line for text in judgement.asked for line in indented(text, "    ")]
        if judgement.from_start.unknown:
            unknown[name] = judgement.from_start.unknown
    notes = [*notes, *_left_out(unknown, several=several)]
    for name, judgement in judgements.items():
        notes += filter(None, [judgement.note_of_end(name if several else "")])
        if judgement.series and judgement.otherwise_complete:
            of_spec = f" of {name}" if several else ""
            notes.append(
                f"robustness over time{of_spec} assumes that nothing follows; with --end complete "
                f"the verdict is {judgement.otherwise_complete}"
            )
        late = judgement.late_start
        if judgement.series and late is not None and late.counted:
            of_spec = f" of {name}" if several else ""
            notes.append(f"robustness over time{of_spec} starts at {number(late.time)} s")
    return [
        *verdicts,
        *trace,
        *(line for note in notes for line in indented(f"note: {note}", "")),
        *(["", *table(cells, "<<>>>>")] if len(rows) > 1 else []),
    ]


def _left_out(unknown: Mapping[str, tuple[str, ...]], *, several: bool) -> list[str]:
    """Return a sentence on requirements that the table omits; empty if it has all."""
    if not unknown:
        return []
    of_specs = f" of {', '.join(unknown)}" if several else ""
    names = dict.fromkeys(name for variables in unknown.values() for name in variables)
    return [f"no robustness over time{of_specs}: values of {', '.join(names)} are not known"]


def json_parts(
    matrix: Matrix,
    rules: Mapping[str, Any],
    columns: Columns,
    exit_code: int,
    *,
    least: Fraction | None = None,
    mutants: Mapping[str, Any] | None = None,
    groups: Mapping[str, Mapping[str, object]] = MappingProxyType({}),
) -> Iterator[str]:
    """Yield the traces as a result of the kind ``"traces"``, in parts.

    The column options are those that are not the default, and a group is the key values of a trace
    in its file.
    """
    requirement, trace = matrix.worst_requirement(), matrix.worst_trace()
    default = Columns()
    options: dict[str, Any] = {
        option.name: getattr(columns, option.name) for option in fields(columns)
    }
    other = {name: value for name, value in options.items() if value != getattr(default, name)}
    trials = (
        {
            **plain_trial(row),
            **(
                {"group": {name: plain(_plain(value)) for name, value in keys.items()}}
                if (keys := groups.get(row.name))
                else {}
            ),
            "verdict": label(row.word),
        }
        for row in matrix.rows
    )
    counts = {label(word).lower(): count for word, count in matrix.counts().items()}
    return document_parts(
        "traces",
        {
            "reading": {**rules, "columns": other},
            "verdict": label(matrix.word),
            "exit_code": exit_code,
            **({} if least is None else {"shorter": matrix.shorter(least)}),
            "counts": counts,
            "worst_requirement": requirement and requirement[0],
            "worst_trace": trace and trace[0],
            **({} if mutants is None else {"mutants": _mutants(mutants)}),
            **plain_results(matrix, rates=False),
        },
        plain_rows=trials,
    )


def _plain(value: object) -> object:
    """Return a number, a text or a truth value; a date as text."""
    return value if isinstance(value, bool | int | float | str) else str(value)


def _mutants(scored: Mapping[str, Any]) -> dict[str, Any]:
    scores = {name: score.written() for name, score in scored["scores"].items()}
    return {"least": scored["least"], "requirements": scores}


def data_set_of(paths: Sequence[str]) -> str:
    """Return the data set of some episodes."""
    files: dict[str, None] = {}
    for path in paths:
        part = part_of(path)
        if part is None or format_of(path).name != "LeRobot data set":
            raise InputError(
                f"--violated-episodes: expected episodes of a LeRobot data set, got {shown(path)}"
            )
        files[part.file] = None
    if len(files) > 1:
        raise InputError(
            "--violated-episodes: expected one LeRobot data set, got "
            f"{', '.join(map(shown, files))}; judge one at a time"
        )
    return next(iter(files))


def violated_episodes(rows: Sequence[Trial], paths: Sequence[str]) -> tuple[str, str]:
    """Return the indices of the violated episodes as JSON, and a summary for the report.

    The list omits undecided episodes and episodes with errors; the summary counts them.
    """
    violated, undecided, errors = [], 0, 0
    for row, path in zip(rows, paths, strict=True):
        part = part_of(path)
        verdicts = {outcome.verdict for outcome in row.outcomes.values()}
        if Verdict.VIOLATED in verdicts and part is not None:
            violated.append(int(part.value))
        elif row.failures or row.error:
            errors += 1
        elif Verdict.UNDECIDED in verdicts:
            undecided += 1
    summary = f"{len(violated)} of {counted(len(rows), 'episode')}"
    others = [f"{undecided} undecided"] * bool(undecided) + [f"{errors} with errors"] * bool(errors)
    if others:
        summary += f"; not in it: {' and '.join(others)}"
    return json.dumps(sorted(violated)), summary
