"""The formats of recorded traces: one row for each, and one module that reads it.

To add a format:

1. Add a row to `FORMATS` and write the module that the row names. A reader sets ``Rows.unit`` if
   the format states the unit of its times, and ``Rows.invalid`` if it marks samples as not valid.
   It calls the library inside `refusing`. Set ``contained`` if the library can crash. A bag has
   ``bag`` and a module with ``read_bag``; `rtamt_gym.recorded.bag_trace` reads its messages. A file
   with several traces has ``several``; a file with columns that have their own times has
   ``clocks``.
2. Add a writer to ``tests/rtamt_gym/recorded/test_formats.py``, which runs `check_trace_format` on
   every format with one trace in a file, and rows to ``docs/traces.md``, ``docs/commands.md`` and,
   for the files of a tool, ``docs/tools.md``. A library is an extra of ``pyproject.toml`` and
   part of the extra ``all``, listed in ``docs/installation.md``, in `rtamt_gym.checks.extras` and
   in ``tests/project/test_packaging.py``; without types, it is also in the overrides of mypy. An
   error in ``tests/rtamt_gym/commands/cli_errors.txt`` lists all extensions, and so does
   ``docs/reference/commands.md``, which ``tests/support/command_options.py`` writes.
3. If commands write robustness in the format, add a row to ``WRITERS`` of
   `rtamt_gym.recorded.output`.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Final

from rtamt import InputError, RtamtError
from rtamt.errors import shown
from rtamt_gym.checks.extras import plugins
from rtamt_gym.recorded import contained
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import choose, file_of, part_of
from rtamt_gym.recorded.recording import Recording
from rtamt_gym.tables import shorten


@dataclass(frozen=True, slots=True)
class Format:
    """A format of recorded traces.

    Attributes:
        name: The name of the format, for messages.
        extensions: The extensions of the files, in lower case.
        module: The module that reads them. Its function ``open_file(path, columns)`` is a context
            manager that yields a `Recording`; a module for bags has ``read_bag``.
        bag: Whether they are bags; each topic of a bag has its own times.
        contained: Whether another process reads them, because their library may crash on a
            damaged file. Rows then come with `RowNumbers`.
        table: Whether a file is one table. ``--where`` selects its rows, and its reader can return
            columns without conversion.
        clocks: Whether columns have their own times, so that ``--period`` samples them like topics
            of a bag.
        marker: The file that identifies a folder of this format; empty without such a file.
        several: Whether a file holds several traces. The module then has ``traces_in(path)``, which
            returns the key column and its text for each trace, as `parts.choose` takes them;
            ``open_file`` takes a `parts.part_name`.
        choice: Whether ``--where`` has to name a trace of the file.
        numbered: Whether the texts of the key column are whole numbers.
        marks: Byte strings that identify the format near the start of a file; one is enough. Empty
            if the extension identifies the format. In a folder, a file without them is not a trace.
    """

    name: str
    extensions: tuple[str, ...]
    module: str
    bag: bool = False
    contained: bool = False
    table: bool = False
    clocks: bool = False
    marker: str = ""
    several: bool = False
    choice: bool = False
    numbered: bool = False
    marks: tuple[bytes, ...] = ()


FORMATS = [
    Format("CSV", (".csv", ".csv.gz", ".tsv", ".txt"), "rtamt_gym.recorded.csv_reader", table=True),
    Format("Parquet", (".parquet",), "rtamt_gym.recorded.arrow_reader", table=True),
    Format("Feather", (".feather", ".arrow"), "rtamt_gym.recorded.arrow_reader", table=True),
    Format("JSON lines", (".ndjson", ".jsonl"), "rtamt_gym.recorded.arrow_reader", table=True),
    Format("NumPy", (".npz",), "rtamt_gym.recorded.arrays", table=True),
    Format("MATLAB", (".mat",), "rtamt_gym.recorded.arrays", contained=True, table=True),
    Format("MDF", (".mf4", ".mdf"), "rtamt_gym.recorded.mdf_reader", contained=True, clocks=True),
    Format("ULog", (".ulg",), "rtamt_gym.recorded.ulog_reader", clocks=True),
    Format(
        *("LeRobot data set", (), "rtamt_gym.recorded.lerobot_reader"),
        marker="meta/info.json",
        several=True,
        numbered=True,
    ),
    Format(
        *("ArduPilot log", (".bin",), "rtamt_gym.recorded.ardupilot_reader"),
        clocks=True,
        marks=(b"\xa3\x95",),
    ),
    Format(
        *("HDF5", (".hdf5", ".h5"), "rtamt_gym.recorded.hdf5_reader"),
        contained=True,
        several=True,
    ),
    Format(
        *("SQLite", (".sqlite", ".sqlite3", ".db"), "rtamt_gym.recorded.sqlite_reader"),
        table=True,
        several=True,
        choice=True,
        marks=(b"SQLite format 3\0",),
    ),
    Format(
        *("SUMO", (".xml", ".xml.gz"), "rtamt_gym.recorded.sumo_reader"),
        several=True,
        marks=(b"<fcd-export", b"<emission-export"),
    ),
    Format(
        *("rosbag2", (".mcap", ".db3"), "rtamt_gym.recorded.bag_trace"),
        bag=True,
        marker="metadata.yaml",
    ),
    Format("ROS 1 bag", (".bag",), "rtamt_gym.recorded.bag_trace", bag=True),
]
"""A row for each format; the first reads files without an extension, and standard input."""

_HEAD: Final = 1 << 14
"""The bytes of a file that are searched for `Format.marks`; SUMO starts files with comments."""

GROUP: Final = "rtamt.trace_formats"
"""The entry points of other packages that add a format, each the name of a `Format`."""


def formats() -> list[Format]:
    """Return the formats of this package, and the formats that other packages add."""
    rows = [*FORMATS]
    for name, row in plugins(GROUP).items():
        if not isinstance(row, Format):
            raise InputError(
                f"expected a Format as the entry point {name!r} of {GROUP}, got {row!r}"
            )
        owners = {extension: other.name for other in rows for extension in other.extensions}
        for extension in row.extensions:
            if extension in owners:
                raise InputError(
                    f"the entry point {name!r} of {GROUP} takes {extension}, which "
                    f"{owners[extension]} has; give it another extension"
                )
        rows.append(row)
    return rows


def extensions() -> list[str]:
    """Return the extensions of readable files."""
    return [extension for row in formats() for extension in row.extensions]


def has_marks(path: Path) -> bool:
    """Return whether a file has a mark of its format; True if the format has no marks."""
    name = path.name.lower()
    row = next((row for row in formats() if name.endswith(row.extensions)), None)
    if row is None or not row.marks:
        return True
    try:
        with gzip.open(path) if name.endswith(".gz") else path.open("rb") as file:
            head = file.read(_HEAD)
    except (OSError, EOFError, zlib.error):
        return True  # reading the trace reports the error
    return any(mark in head for mark in row.marks)


def folder_format(path: str | Path) -> Format | None:
    """Return the format of a folder that counts as one file, such as a bag of rosbag2, or None."""
    folder = Path(path)
    try:
        if not folder.is_dir():  # most paths are files
            return None
        rows = (row for row in formats() if row.marker and (folder / row.marker).is_file())
        return next(rows, None)
    except (OSError, ValueError):  # the text may be a formula that is too long for a path
        return None


def format_of(path: str) -> Format:
    """Return the format of a file by the end of its name, or of the folder of a bag or data set.

    It is CSV for standard input, and for a name without an extension.
    """
    path = file_of(path)
    if (folder := folder_format(path)) is not None:
        return folder
    name = Path(path).name.lower()
    for row in formats():
        if name.endswith(row.extensions):
            return row
    if Path(path).suffix:
        raise InputError(
            f"{shown(path)}: expected a name that ends in {', '.join(extensions()[:-1])} or "
            f"{extensions()[-1]}"
        )
    return FORMATS[0]


def traces_in(path: str, where: Mapping[str, str]) -> list[str]:
    """Return the names of the traces in a file: its path, unless the format holds several."""
    try:
        row = format_of(path)
        if not row.several or part_of(path) is not None:
            return [path]
        listing = partial(import_module(row.module).traces_in, path)
        if row.contained:
            listing = partial(contained.call, row.module, "traces_in", path)
        key, values = listing()
    except (InputError, ImportError, OSError):
        return [path]
    if not values or (row.choice and key not in where and len(values) > 1):
        return [path]
    return choose(path, key, values, where)


def group_of(path: str) -> Mapping[str, object]:
    """Return the key values of a trace in its file; empty if the path names a file."""
    part = part_of(path)
    if part is None:
        return {}
    numbered = format_of(path).numbered
    return {
        name: int(text) if numbered and text.isdecimal() else text
        for name, text in part.values.items()
    }


def is_bag(path: str) -> bool:
    """Return whether a path names a bag."""
    try:
        return format_of(path).bag
    except InputError:
        return False


def samples_clocks(path: str) -> bool:
    """Return whether ``--period`` samples a file by its times instead of ignoring them."""
    try:
        row = format_of(path)
    except InputError:
        return False
    return row.bag or row.clocks


@contextmanager
def open_recording(
    path: str, columns: Columns | None = None, row: Format | None = None
) -> Iterator[Recording]:
    """Open a file of recorded values with the reader of its extension; ``-`` is CSV on stdin."""
    row = format_of(path) if row is None else row
    if row.bag:
        raise InputError(f"{shown(path)}: expected a table, got a bag; rtamt monitor reads it")
    opened: AbstractContextManager[Recording]
    if row.contained:
        opened = contained.open_file(row.module, path, columns or Columns())
    else:
        opened = import_module(row.module).open_file(path, columns or Columns())
    try:
        with opened as recording:
            yield recording
    except UnicodeDecodeError:
        raise InputError(f"{'stdin' if path == '-' else path}: expected UTF-8 text") from None


@contextmanager
def refusing(path: str, expected: str) -> Iterator[None]:
    """Turn errors of a library into InputErrors that expect, for instance, a whole MATLAB file."""
    try:
        yield
    except (RtamtError, ModuleNotFoundError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise
        text = shorten(" ".join(str(error).split()), 120)
        kind = type(error).__name__.lstrip("_")
        raise InputError(
            f"{shown(path)}: expected {expected}, got an error: {kind}{': ' * bool(text)}{text}"
        ) from None
