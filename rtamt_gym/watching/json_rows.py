"""Rows of JSON: an object in each line."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any, NoReturn

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.watching.rows import BadLine, RowBlock


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not strict JSON")


def _loader() -> Callable[[bytes], Any]:
    """Return the parser: orjson if it is installed, otherwise the json of Python."""
    try:
        import orjson
    except ModuleNotFoundError:
        decoder = json.JSONDecoder(parse_constant=_refuse_constant)

        def load(line: bytes) -> Any:  # noqa: ANN401 - what a line holds
            return decoder.decode(line.decode("utf-8"))

        return load
    loads: Callable[[bytes], Any] = orjson.loads
    return loads


class JsonRows:
    """Divides lines of JSON into cells; nested fields have dotted names.

    Args:
        source: The name of the stream, for messages.
    """

    def __init__(self, source: str) -> None:
        self._source, self._load = source, _loader()
        self.names: list[str] = []
        self._wanted: list[str] = []
        self._plain = False
        self._absent: Collection[str] = ()

    def choose(self, names: Sequence[str], absent: Collection[str] = ()) -> None:
        """Set the columns of all further blocks.

        Args:
            names: The columns.
            absent: Names that no line may have, because their variables have their default.
        """
        self._wanted, self._absent = [*names], {*absent}
        self._plain = self._plain and not absent

    def finish(self) -> None:
        """Raise InputError if no line came."""
        if not self.names:
            raise InputError(f"{self._source}: expected one JSON object in each line, got none")

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows in lines, of which the first has a number."""
        if first == 1 and lines:
            lines[0] = lines[0].removeprefix(b"\xef\xbb\xbf")
        if self._plain and (block := self._fast(lines, first)) is not None:
            yield block
            return
        good: list[Mapping[str, Any]] = []
        numbers: list[int] = []
        for line, text in enumerate(lines, first):
            if not text.strip():
                continue
            row = self._row(text)
            if isinstance(row, str):
                if good:
                    yield self._block(good, numbers)
                    good, numbers = [], []
                yield BadLine(line, row)
                continue
            if not self.names:
                self._start(row, text)
            good.append(row)
            numbers.append(line)
        if good:
            yield self._block(good, numbers)

    def _start(self, row: Mapping[str, Any], text: bytes) -> None:
        self.names = [*row]
        self._wanted = self._wanted or self.names
        self._plain = [*self._load(text)] == self.names  # nothing is nested

    def _fast(self, lines: list[bytes], first: int) -> RowBlock | None:
        """Return lines of plain objects that have all columns; None if one may be another."""
        try:
            if len(self._wanted) < 2:  # then a getter returns no tuple
                return None
            # Nothing but an object has members with names.
            objects = list(map(self._load, lines))
            rows = list(map(itemgetter(*self._wanted), objects))
            if _may_repeat(b"\n".join(lines), sum(map(len, objects))):
                return None
            columns = dict(zip(self._wanted, zip(*rows, strict=True), strict=True))
        except (ValueError, KeyError, TypeError, RecursionError):
            return None
        return RowBlock(range(first, first + len(lines)), columns)

    def _row(self, text: bytes) -> Mapping[str, Any] | str:
        """Return the fields of a line, or its fault."""
        try:
            row = self._load(text)
        except (ValueError, RecursionError) as error:
            reason, _, _ = str(error).partition(":")
            return f"expected one JSON object, got an error: {shown(reason)}"
        if not isinstance(row, dict):
            return f"expected one JSON object, got {type(row).__name__}"
        if _may_repeat(text, _names_in(row)) and (name := _repeated(text)) is not None:
            return f"expected one value of each field, got two of '{shown(name)}'"
        fields = list(_fields(row, ""))
        row = dict(fields)
        if len(row) < len(fields):
            name = next(name for name, count in Counter(n for n, _ in fields).items() if count > 1)
            return f"expected one value of each field, got two of '{name}'"
        for name in self._absent:
            if name in row:
                return (
                    f"'{shown(name)}' is not in the first line, so that its variable has its "
                    "default. Write all fields in the first line."
                )
        return row

    def _block(self, rows: list[Mapping[str, Any]], lines: list[int]) -> RowBlock:
        columns = {name: [row.get(name) for row in rows] for name in self._wanted}
        return RowBlock(lines, columns)


def _may_repeat(text: bytes, names: int) -> bool:
    """Return whether objects may have fields of one name, of which the parser keeps the last.

    Args:
        text: The objects as JSON.
        names: The number of their names after parsing.
    """
    if text.count(b":") == names:  # each name has one, also a repeated one
        return False
    return text.count(b'":') != names or any(gap in text for gap in (b'" ', b'"\t', b'"\r'))


def _names_in(value: object) -> int:
    """Return the number of names in a value of JSON."""
    if isinstance(value, dict):
        return len(value) + sum(map(_names_in, value.values()))
    return sum(map(_names_in, value)) if isinstance(value, list) else 0


def _repeated(text: bytes) -> str | None:
    """Return a name that an object has twice; None without one."""
    repeated: list[str] = []

    def check(pairs: list[tuple[str, object]]) -> None:
        counts = Counter(name for name, _ in pairs)
        repeated.extend(name for name, count in counts.items() if count > 1)

    json.loads(text, object_pairs_hook=check)
    return repeated[0] if repeated else None


def _fields(value: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the fields of an object: those of objects in it have dotted names."""
    for key, field in value.items():
        name = f"{prefix}{key}"
        if isinstance(field, dict):
            yield from _fields(field, f"{name}.")
        elif isinstance(field, list):
            for index, element in enumerate(field):
                if isinstance(element, int | float) or element is None:
                    yield f"{name}[{index}]", element
        else:
            yield shown(name), field
