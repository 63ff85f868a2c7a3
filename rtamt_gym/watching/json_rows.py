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


TakeField = Callable[[str, object], tuple[str, bool]]
"""Takes a new field and its value; returns its fault, or if further blocks have its column."""


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
        self._known: set[str] = set()
        self._needed: Collection[str] = ()
        self._take_field: TakeField | None = None

    def choose(
        self,
        names: Sequence[str],
        needed: Collection[str] = (),
        take_field: TakeField | None = None,
    ) -> None:
        """Set the columns of all further blocks.

        Args:
            names: The columns.
            needed: Those of variables, times and groups.
            take_field: Takes the first field of a name that the first line does not have.
        """
        self._wanted, self._needed, self._take_field = [*names], {*needed}, take_field

    def finish(self) -> None:
        """Raise InputError if no line came."""
        if not self.names:
            raise InputError(f"{self._source}: expected one JSON object in each line, got none")

    def rows(self, lines: list[bytes], first: int) -> Iterator[RowBlock | BadLine]:
        """Yield the rows of the lines; ``first`` is the number of the first line."""
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
            good.append(row)
            numbers.append(line)
            if not self.names:  # the next lines are read by its names
                self._start(row, text)
                yield self._block(good, numbers)
                good, numbers = [], []
        if good:
            yield self._block(good, numbers)

    def _start(self, row: Mapping[str, Any], text: bytes) -> None:
        self.names = [*row]
        self._known = {*row}
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
            if not set().union(*objects) <= self._known:
                return None
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
        lists: dict[str, int] = {}
        fields = list(_fields(row, "", lists))
        row = dict(fields)
        if len(row) < len(fields):
            name = next(name for name, count in Counter(n for n, _ in fields).items() if count > 1)
            return f"expected one value of each field, got two of '{name}'"
        for name in self._needed:
            if name not in row and (fault := _other_kind(name, row, lists)):
                return fault
        return self._fault_of_fields(row) or row

    def _fault_of_fields(self, row: Mapping[str, Any]) -> str:
        """Take the fields that no line before had; return their fault, or an empty text."""
        if self._take_field is None:
            return ""
        for name in row:
            if name in self._known:
                continue
            fault, wanted = self._take_field(name, row[name])
            if fault:
                return fault
            self._known.add(name)
            if wanted:
                self._wanted.append(name)
        return ""

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


def _fields(
    value: Mapping[str, Any], prefix: str, lists: dict[str, int]
) -> Iterator[tuple[str, Any]]:
    """Yield the fields of an object: those of objects in it have dotted names.

    Args:
        value: The object.
        prefix: The text before their names.
        lists: Receives the lengths of lists; -1 for an object.
    """
    for key, field in value.items():
        name = f"{prefix}{key}"
        if isinstance(field, dict):
            lists[shown(name)] = -1
            yield from _fields(field, f"{name}.", lists)
        elif isinstance(field, list):
            lists[shown(name)] = len(field)
            for index, element in enumerate(field):
                if not isinstance(element, dict | list):
                    yield f"{name}[{index}]", element
        else:
            yield shown(name), field


def _other_kind(name: str, row: Mapping[str, Any], lists: Mapping[str, int]) -> str:
    """Return the fault of a line that has something else in place of a field; empty without one.

    Args:
        name: A field that the line does not have.
        row: The fields of the line.
        lists: The lengths of its lists; -1 for an object.
    """
    if name in lists:
        return f"column '{name}': expected a number, got {_container(lists[name])}"
    for place, mark in enumerate(name):
        outer = name[:place]
        if mark == "." and (row.get(outer) is not None or lists.get(outer, -1) >= 0):
            kind = _container(lists[outer]) if outer in lists else repr(row[outer])
            return f"column '{name}': expected an object in '{outer}', got {kind}"
        if mark == "[" and (row.get(outer) is not None or outer in lists):
            kind = _container(lists[outer]) if outer in lists else repr(row[outer])
            return f"column '{name}': expected a list with this element, got {kind}"
    return ""


def _container(length: int) -> str:
    return "an object" if length < 0 else f"a list of {length}"
