"""Files that hold several traces, and the names of these traces: ``data[episode_index=3]``."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple
from urllib.parse import quote, unquote

from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listed

_PLAIN: Final = " !#$&'()*+-./:;<>?@^_`{|}~\""
"""The marks in a value that the name of a trace shows as they are."""


class TracePart(NamedTuple):
    """One of the traces in a file.

    Attributes:
        file: The path of the file or folder.
        values: The text of each key column.
    """

    file: str
    values: Mapping[str, str]

    @property
    def key(self) -> str:
        """The name of the first column."""
        return next(iter(self.values))

    @property
    def value(self) -> str:
        """The text of the first column."""
        return self.values[self.key]


_KEY = r"[^\[\]=,]+=[^\[\]=,]*"
_NAME = re.compile(rf"(?P<file>.+)\[(?P<keys>{_KEY}(?:,{_KEY})*)\]", re.DOTALL)


def part_name(file: str, key: str, value: str) -> str:
    """Return the name of a trace in a file; brackets, commas and the like are percent-escaped."""
    return group_name(file, {key: value})


def group_name(file: str, values: Mapping[str, str]) -> str:
    """Return the name of a trace with several key columns."""
    pairs = values.items()
    keys = ",".join(f"{_quoted(key)}={_quoted(text)}" for key, text in pairs)
    return f"{file}[{keys}]"


def _quoted(text: str) -> str:
    return text if _AS_IT_IS.fullmatch(text) else quote(text, safe=_PLAIN)


_AS_IT_IS: Final = re.compile(rf"[A-Za-z0-9{re.escape(_PLAIN)}]*")
"""The texts that no escape changes; `quote` takes longer to find out."""


def group_names(
    file: str,
    by: Sequence[str],
    groups: Iterable[tuple[str, ...]],
    chosen: Mapping[str, str],
) -> dict[str, tuple[str, ...]]:
    """Return the keys of groups by the names of their traces."""
    return {
        group_name(file, {**chosen, **dict(zip(by, keys, strict=True))}): keys for keys in groups
    }


def part_of(path: str) -> TracePart | None:
    """Return the file and the trace that a name states; None if it is the name of a file.

    A name with a column twice is not the name of a trace.

    Example:
        >>> from tempfile import NamedTemporaryFile
        >>> with NamedTemporaryFile(suffix=".hdf5") as file:
        ...     part_of(f"{file.name}[demo=a%2Cb]").values, part_of(file.name)
        ({'demo': 'a,b'}, None)
    """
    match = _NAME.fullmatch(path)
    if match is None or os.path.exists(path) or not os.path.exists(match["file"]):  # noqa: PTH110 - a formula may be longer than a name
        return None
    pairs = [pair.partition("=") for pair in match["keys"].split(",")]
    values = {unquote(key): unquote(text) for key, _, text in pairs}
    return TracePart(match["file"], values) if len(values) == len(pairs) else None


def split_name(name: str) -> tuple[str, str]:
    """Return the file in the name of a trace and the rest, whether or not the file exists."""
    match = _NAME.fullmatch(name)
    file = name if match is None else match["file"]
    return file, name[len(file) :]


def file_of(path: str) -> str:
    """Return the file of a trace: the path itself if it names a file."""
    part = part_of(path)
    return path if part is None else part.file


def files_of(paths: Iterable[str]) -> list[str]:
    """Return the files of traces, each once."""
    files: dict[str, None] = {}
    file = None
    for path in paths:
        # Names of traces of one file follow each other.
        known = file is not None and path.startswith(f"{file}[") and path.endswith("]")
        if not known or os.path.exists(path):  # noqa: PTH110 - as in part_of
            file = file_of(path)
            files.setdefault(file)
    return [*files]


def choose(
    file: str,
    key: str,
    values: Mapping[str, Mapping[str, Collection[str]]],
    where: Mapping[str, str],
) -> list[str]:
    """Return the names of the traces in a file that ``--where`` selects; without it, of all."""
    chosen = [*values]
    for name, wanted in where.items():
        known = {
            value: (value,) if name == key else texts.get(name) for value, texts in values.items()
        }
        chosen = [v for v in chosen if (texts := known[v]) is None or wanted in texts]
        if not chosen:
            every = [*dict.fromkeys(text for texts in known.values() for text in texts or ())]
            selection = " and ".join(f"{column}={text}" for column, text in where.items())
            raise InputError(
                f"{shown(file)}: no trace with {selection}, which --where selects; the values of "
                f"'{name}' are {listed(every, wanted)}"
                f"{nearest(wanted, every)}"
            )
    return [part_name(file, key, value) for value in chosen]
