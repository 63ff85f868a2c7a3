"""The folder with the rows of judged files: Parquet parts that become one file at the end.

A file with its final name is complete, whenever the program or the machine dies.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.fleet_worker import FileRow, KnownFile, Mark
from rtamt_gym.play.folder import LockedFolder, differing, is_own, locked, short_text
from rtamt_gym.results.matrix import IDENTITY, RESULTS

if TYPE_CHECKING:
    import pyarrow as pa

_PARTS: Final = "part-*.parquet"
_MERGED: Final = 200
"""The number of parts at which they are merged during a run."""

_TEXTS: Final = ("path", "verdict", "error", "described", "notes", "etag", "sha256", "worker")


class FleetFolder(LockedFolder):
    """The rows of files in a local folder, which one process at a time locks."""

    def __init__(
        self, path: Path, identity: Mapping[str, Any], requirements: Sequence[str]
    ) -> None:
        self.path = path
        try:
            import pyarrow.parquet
        except ModuleNotFoundError as error:
            raise naming_extra(error, "a folder of results") from None
        self._parquet = pyarrow.parquet
        self._schema = _schema(requirements)
        identity = json.loads(json.dumps(identity))
        if path.exists() and not path.is_dir():
            raise InputError("expected ", Argument("results"), f" as a folder, got the file {path}")
        path.mkdir(parents=True, exist_ok=True)
        self._check(identity)
        self._lock = locked(path, "rtamt monitor")
        try:
            self._delete_unfinished()
            if not (path / IDENTITY).exists():
                text = json.dumps(identity, indent=1) + "\n"
                self._write(IDENTITY, lambda file: file.write_text(text, encoding="utf-8"))
            numbers = [int(part.stem.partition("-")[2]) for part in path.glob(_PARTS)]
            self._number = max(numbers, default=0)
            self._parts = len(numbers)
        except BaseException:
            self.close()
            raise

    def known(self) -> dict[str, KnownFile]:
        """Return the state of each file with a valid row, without files to be tried again."""
        names = ["path", "size", "mtime", "etag", "sha256", "retry", "gone"]
        known: dict[str, KnownFile] = {}
        for file in self._files():
            columns = self._parquet.read_table(file, columns=names).to_pydict().values()
            for path, size, mtime, etag, sha256, retry, gone in zip(*columns, strict=True):
                if retry or gone:
                    known.pop(path, None)
                else:
                    known[path] = KnownFile(Mark(size, mtime, etag), sha256)
        return known

    def paths(self) -> set[str]:
        """Return all paths."""
        tables = [self._parquet.read_table(file, columns=["path"]) for file in self._files()]
        return {path for table in tables for path in table["path"].to_pylist()}

    def add(self, rows: Iterable[FileRow]) -> None:
        """Write rows so that a later kill does not lose them."""
        table = self._table(rows)
        if not table.num_rows:
            return
        self._number += 1
        name = f"part-{self._number:08d}.parquet"
        self._write(name, lambda file: self._parquet.write_table(table, file))
        self._parts += 1
        if self._parts >= _MERGED:
            self.finish()

    def finish(self, gone: Iterable[str] | None = None) -> pa.Table:
        """Replace the parts by one file with a row for each path, and return its table."""
        import pyarrow as pa
        import pyarrow.compute as pc

        files = self._files()
        tables = [self._parquet.read_table(file, schema=self._schema) for file in files]
        table = pa.concat_tables(tables) if tables else self._schema.empty_table()
        table = table.take(_last(table["path"].to_pylist()))
        if gone is not None:
            missing = pa.array([*gone], pa.string())
            marks = pc.is_in(table["path"], value_set=missing)
            table = table.set_column(
                table.schema.get_field_index("gone"), self._schema.field("gone"), marks
            )
        table = table.sort_by("path").cast(self._schema)
        if files != [self.path / RESULTS] or gone is not None:
            self._write(RESULTS, lambda file: self._parquet.write_table(table, file))
        for part in self.path.glob(_PARTS):
            part.unlink()
        self._parts = 0
        return table

    def _files(self) -> list[Path]:
        """Return the files with rows, the oldest first."""
        results = self.path / RESULTS
        return [*([results] if results.exists() else []), *sorted(self.path.glob(_PARTS))]

    def _check(self, identity: Mapping[str, Any]) -> None:
        """Raise InputError if the folder holds other results or other files."""
        file = self.path / IDENTITY
        if not file.exists():
            names = [entry.name for entry in self.path.iterdir()]
            others = [name for name in names if not is_own(name)]
            if others:
                raise InputError(
                    "expected ",
                    Argument("results"),
                    f" as a new folder or the folder of an earlier run, got {self.path}, which "
                    f"holds {listing(sorted(others)[:3])}",
                )
            return
        stored = json.loads(file.read_text(encoding="utf-8"))
        for key in dict.fromkeys([*identity, *stored]):
            if identity.get(key) != stored.get(key):
                raise InputError(
                    f"{self.path} holds other results: their {key} "
                    f"{differing(stored, key)}, not {short_text(identity.get(key))}. Give another "
                    "folder, or the same specification and options."
                )

    def _table(self, rows: Iterable[FileRow]) -> pa.Table:
        import pyarrow as pa

        listed = []
        for row in rows:
            mark: Mark = row["mark"]
            cells = {name: row.get(name, "") for name in _TEXTS}
            listed.append({"gone": False, **row, **cells, **mark._asdict()})
        return pa.Table.from_pylist(listed, schema=self._schema)

    def _write(
        self,
        name: str,
        write: Callable[[Path], object],
        called: Callable[[Path], str] | None = None,
    ) -> None:
        try:
            super()._write(name, write, called)
        except OSError as error:
            raise InputError(
                f"cannot write {self.path / name}: {error.strerror or error}. Free space, or make "
                "the folder writable, and try again: finished files are kept."
            ) from error


def _last(paths: Sequence[str]) -> list[int]:
    """Return the place of the last row of each path."""
    return list({path: place for place, path in enumerate(paths)}.values())


def _schema(requirements: Sequence[str]) -> pa.Schema:
    """Return the columns of the rows."""
    import pyarrow as pa

    text, real, whole = pa.string(), pa.float64(), pa.int64()
    columns = [("path", text), ("verdict", text)]
    for name in requirements:
        columns += [(f"verdict({name})", text)]
        columns += [(f"{kind}({name})", real) for kind in ("robustness", "lower", "upper")]
        columns += [(f"triggers({name})", whole)]
    columns += [("error", text), ("described", text), ("notes", text)]
    columns += [("size", whole), ("mtime", whole), ("etag", text), ("sha256", text)]
    columns += [("gone", pa.bool_()), ("retry", pa.bool_()), ("wall", real), ("worker", text)]
    return pa.schema(columns)
