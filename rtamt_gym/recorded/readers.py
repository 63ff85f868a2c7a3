"""The formats of recorded traces: one row for each, and one module that reads it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Final

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.plugins import plugins
from rtamt_gym.recorded import contained
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Recording

__all__ = [
    "FORMATS",
    "GROUP",
    "Format",
    "extensions",
    "format_of",
    "formats",
    "is_bag",
    "is_bag_folder",
    "open_recording",
]


@dataclass(frozen=True, slots=True)
class Format:
    """A format of recorded traces.

    Attributes:
        name: What it is called.
        extensions: The ends of the names of such files, in lower case.
        module: The module that reads them. Its function ``open_file(path, columns)`` is a context
            manager that gives a `Recording`; a module for bags has ``read_bag``.
        bag: Whether they are bags, whose topics have times of their own.
        table: Whether a file is one table, whose rows ``--where`` selects and whose columns the
            reader gives as they are too.
        contained: Whether another process reads them, as what reads them may crash on a damaged
            file. Rows then come with `RowNumbers`.
    """

    name: str
    extensions: tuple[str, ...]
    module: str
    bag: bool = False
    contained: bool = False
    table: bool = False


FORMATS = [
    Format("CSV", (".csv", ".csv.gz", ".tsv", ".txt"), "rtamt_gym.recorded.csv_reader", table=True),
    Format("Parquet", (".parquet",), "rtamt_gym.recorded.arrow_reader", table=True),
    Format("Feather", (".feather", ".arrow"), "rtamt_gym.recorded.arrow_reader", table=True),
    Format("JSON lines", (".ndjson", ".jsonl"), "rtamt_gym.recorded.arrow_reader", table=True),
    Format("NumPy", (".npz",), "rtamt_gym.recorded.npz_reader", table=True),
    Format("MATLAB", (".mat",), "rtamt_gym.recorded.mat_reader", contained=True, table=True),
    Format("MDF", (".mf4", ".mdf"), "rtamt_gym.recorded.mdf_reader", contained=True),
    Format("ULog", (".ulg",), "rtamt_gym.recorded.ulog_reader"),
    Format("rosbag2", (".mcap", ".db3"), "rtamt_gym.recorded.bag_trace", bag=True),
    Format("ROS 1 bag", (".bag",), "rtamt_gym.recorded.bag_trace", bag=True),
]
"""A row for each format; the first reads what has no extension, and standard input."""

GROUP: Final = "rtamt.trace_formats"
"""The entry points of other packages that add a format, each the name of a `Format`."""


def formats() -> list[Format]:
    """The formats of this package, and those that other packages add.

    Raises:
        InputError: If what is added is no format, or takes an extension that another has.
    """
    rows = [*FORMATS]
    for name, row in plugins(GROUP).items():
        if not isinstance(row, Format):
            raise InputError(
                f"expected a Format as the entry point {name!r} of {GROUP}, got {row!r}"
            )
        taken = {extension: each.name for each in rows for extension in each.extensions}
        for extension in row.extensions:
            if extension in taken:
                raise InputError(
                    f"the entry point {name!r} of {GROUP} takes {extension}, which "
                    f"{taken[extension]} has; give it another extension"
                )
        rows.append(row)
    return rows


def extensions() -> list[str]:
    """The ends of the names of files that can be read."""
    return [extension for row in formats() for extension in row.extensions]


def is_bag_folder(path: str | Path) -> bool:
    """Whether a folder is a bag of rosbag2, which counts as one trace."""
    try:
        return (Path(path) / "metadata.yaml").is_file()
    except OSError:  # a formula may be longer than a name
        return False


def format_of(path: str) -> Format:
    """The format of a file by the end of its name; CSV for standard input, or without an extension.

    A folder with the file ``metadata.yaml`` is a bag of rosbag2.

    Raises:
        InputError: If no format has the extension.
    """
    name = ".db3" if is_bag_folder(path) else Path(path).name.lower()
    for row in formats():
        if name.endswith(row.extensions):
            return row
    if Path(path).suffix:
        raise InputError(
            f"{shown(path)}: expected a name that ends in {', '.join(extensions()[:-1])} or "
            f"{extensions()[-1]}"
        )
    return FORMATS[0]


def is_bag(path: str) -> bool:
    """Whether a path names a bag."""
    try:
        return format_of(path).bag
    except InputError:
        return False


@contextmanager
def open_recording(path: str, columns: Columns | None = None) -> Iterator[Recording]:
    """Opens a file of recorded values with the reader of its extension.

    A name without an extension is read as CSV; ``-`` is CSV on stdin.

    Args:
        path: The file.
        columns: How its columns are read.

    Raises:
        OSError: If there is no such file.
        InputError: If no format has the extension or a format of bags has it, or if the file is not
            in the format of its reader.
        ModuleNotFoundError: If the reader needs a package that is not installed.
    """
    row = format_of(path)
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
