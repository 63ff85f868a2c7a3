"""Reads tables of SQLite files; a file with several tables needs the name of one."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.arrays import ArrayRecording
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import refusing
from rtamt_gym.recorded.recording import Recording, Rows, Wanted

TABLE: Final = "table"
"""The key of a table."""

_WHOLE: Final = "a whole SQLite file"


def traces_in(path: str) -> tuple[str, dict[str, dict[str, Sequence[str]]]]:
    """Return the key of tables, and their names."""
    with _connected(path) as connection:
        return TABLE, {name: {} for name in _tables(path, connection)}


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a table."""
    part = part_of(path)
    file = path if part is None else part.file
    with _connected(file) as connection:
        tables = _tables(file, connection)
        if part is None or part.key != TABLE or part.value not in tables:
            got = "a file without tables" if not tables else f"the tables {listed(tables)}"
            raise InputError(
                f"{shown(path)}: expected a table, got {got}"
                + f"; give --where {TABLE}=NAME" * bool(tables)
            )
        yield TableRecording(path, connection, part.value, columns)


class TableRecording(Recording):
    """The columns of a table in the order of its rows."""

    def __init__(
        self, path: str, connection: sqlite3.Connection, table: str, columns: Columns
    ) -> None:
        self.source, self._path, self._columns = shown(path), path, columns
        self._connection, self._table = connection, _quoted(table)
        with refusing(path, _WHOLE):
            described = connection.execute(f"PRAGMA table_info({self._table})").fetchall()
            self._places = {shown(name): name for _, name, *_ in described}
            first = self._select([*self._places.values()], "LIMIT 1")
        self.names: Sequence[str] = [*self._places]
        cells = first[0] if first else ()
        self.texts = [n for n, cell in zip(self.names, cells, strict=False) if type(cell) is str]

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns."""
        names = [name for name in wanted.names if name in self._places]
        if {*names} & {*self.texts}:  # all texts are evidence of the decimal mark
            names += [name for name in self.texts if name not in names]
        names = names or [*self.names[:1]]
        with refusing(self._path, _WHOLE):
            rows = self._select([self._places[name] for name in names])
        columns = list(zip(*rows, strict=True)) if rows else [()] * len(names)
        arrays: dict[str, NDArray[Any]] = {}
        empty: dict[str, NDArray[np.bool_]] = {}
        for name, cells in zip(names, columns, strict=True):
            arrays[name] = _array(cells)
            absent = np.array([cell is None for cell in cells], bool)
            if absent.any():
                empty[name] = absent
        recording = ArrayRecording(self._path, arrays, None, self._columns.decimal, empty)
        known = {name: text for name, text in wanted.where.items() if name in self._places}
        if known.keys() != wanted.where.keys():
            recording.names = self.names  # for the error about a column that does not exist
        return recording.read(wanted)

    def _select(self, names: Sequence[str], more: str = "") -> list[tuple[Any, ...]]:
        columns = ", ".join(map(_quoted, names))
        return self._connection.execute(
            f"SELECT {columns} FROM {self._table} {more}"  # noqa: S608 - quoted names
        ).fetchall()


def _array(cells: Sequence[Any]) -> NDArray[Any]:
    """Return cells as numbers with nan in empty cells, or as texts if a cell is a text."""
    kinds = {type(cell) for cell in cells}
    if str in kinds and bytes not in kinds:
        return np.array(["" if cell is None else str(cell).strip() for cell in cells])
    if kinds == {int}:
        return np.array(cells)
    if kinds <= {int, float, type(None)}:
        return np.array([np.nan if cell is None else cell for cell in cells], np.float64)
    return np.array(cells, object)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _tables(path: str, connection: sqlite3.Connection) -> list[str]:
    """Return the names of the tables and views."""
    query = "SELECT name FROM sqlite_master WHERE type IN ('table', 'view') ORDER BY rowid"
    with refusing(path, _WHOLE):
        names = [name for (name,) in connection.execute(query)]
    return [name for name in names if not name.startswith("sqlite_")]


@contextmanager
def _connected(path: str) -> Iterator[sqlite3.Connection]:
    """Open a file for reading; a file that is shorter than it states is an error."""
    with Path(path).open("rb") as file:
        head = file.read(100)
    size, there = _size(head), Path(path).stat().st_size
    if not head.startswith(b"SQLite format 3\0") or there < size:
        got = f"{there} of {size} bytes" if size > there else "another file"
        raise InputError(f"{shown(path)}: expected {_WHOLE}, got {got}")
    with refusing(path, _WHOLE):
        name = quote(str(Path(path).absolute()))
        connection = sqlite3.connect(f"file:{name}?mode=ro", uri=True)
    with closing(connection):
        connection.execute("PRAGMA trusted_schema = OFF")  # views call no other functions
        yield connection


def _size(head: bytes) -> int:
    """Return the size that the head of a file states; 0 if it does not."""
    if len(head) < 100 or head[24:28] != head[92:96]:
        return 0
    page = int.from_bytes(head[16:18], "big")
    return (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")
