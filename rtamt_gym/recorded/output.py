"""Writes robustness to files that can be read and judged as traces."""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.judge import RESULT, Series, TraceJudgement
from rtamt_gym.recorded.names import VALUE, VARIABLE
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TIME

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

    Args:
        judgements: The judgements by name of the specification. If there are several, the name
            precedes the names of its formulas.
        path: The file, with an extension of `WRITERS`.
        dense: Whether the robustness consists of events in dense time.
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
