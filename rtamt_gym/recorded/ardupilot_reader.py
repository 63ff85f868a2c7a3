"""Reads dataflash logs of ArduPilot, ``.bin``: a column for each field of a message type."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Recording
from rtamt_gym.recorded.topics import TopicField, TopicRecording, cut_note, named_fields

_HEAD: Final = b"\xa3\x95"
"""The bytes before the type of every message."""

_FORMAT: Final = 128
"""The type of messages that describe a type."""

_TIMES: Final = {"TimeUS": 1, "TimeMS": 1000}
"""The fields with the time of a message, and their units in microseconds."""

_KINDS: Final[Mapping[str, tuple[str, float]]] = {
    "a": ("(32,)<i2", 1),
    "b": ("<i1", 1),
    "B": ("<u1", 1),
    "h": ("<i2", 1),
    "H": ("<u2", 1),
    "i": ("<i4", 1),
    "I": ("<u4", 1),
    "q": ("<i8", 1),
    "Q": ("<u8", 1),
    "g": ("<f2", 1),
    "f": ("<f4", 1),
    "d": ("<f8", 1),
    "n": ("S4", 1),
    "N": ("S16", 1),
    "Z": ("S64", 1),
    "c": ("<i2", 1e2),
    "C": ("<u2", 1e2),
    "e": ("<i4", 1e2),
    "E": ("<u4", 1e2),
    "L": ("<i4", 1e7),
    "M": ("<u1", 1),
}
"""The type of a field by its letter, and the number that it is divided by."""


class _Type(NamedTuple):
    """A type of messages.

    Attributes:
        name: The name of the type, such as ``ATT``.
        length: The length of a message in bytes, with its header.
        letters: The type of each field.
        fields: The names of the fields.
    """

    name: str
    length: int
    letters: str
    fields: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """The layout of a message with its header."""
        kinds = [_KINDS[letter][0] for letter in self.letters]
        fields = list(zip(self.fields, kinds, strict=True))
        return np.dtype([("head", "V3"), *fields])


_OWN: Final = _Type("FMT", 89, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))


@contextmanager
def open_file(path: str, columns: Columns) -> Iterator[Recording]:
    """Open a log."""
    data = Path(path).read_bytes()
    if not data.startswith(_HEAD + bytes([_FORMAT])):
        raise InputError(f"{shown(path)}: expected a dataflash log of ArduPilot")
    types, places, remainder = _messages(path, data)
    raw = np.frombuffer(data, np.uint8)
    arrays = {number: _array(raw, types[number], offsets) for number, offsets in places.items()}
    instances = _instances(types, arrays)
    topics: dict[str, dict[int, dict[str, TopicField]]] = {}
    lines = []
    for number, array in arrays.items():
        kind = types[number]
        time = next((name for name in kind.fields if name in _TIMES), None)
        if time is None or kind.name in topics:
            continue
        micros = array[time].astype(np.uint64) * np.uint64(_TIMES[time])
        lines.append(micros)
        topics[kind.name] = _by_instance(kind, array, micros, instances.get(number))
    if not lines:
        raise InputError(f"{shown(path)}: expected messages with TimeUS or TimeMS, got none")
    notes = [cut_note(max(int(times.max()) for times in lines) / 1e6)] if remainder else []
    yield TopicRecording(path, named_fields(topics), lines, notes, columns.same_time)


def _messages(path: str, data: bytes) -> tuple[dict[int, _Type], dict[int, list[int]], bool]:
    """Return the types, the offsets of their messages, and whether the last message is cut."""
    types: dict[int, _Type] = {_FORMAT: _OWN}
    lengths = [0] * 256
    lengths[_FORMAT] = _OWN.length
    places: list[list[int]] = [[] for _ in range(256)]
    offset, size, head = 0, len(data), _HEAD
    while offset < size:
        if data[offset : offset + 2] != head[: size - offset]:
            if not any(data[offset:]):  # the autopilot reserves space filled with zeros
                break
            raise InputError(
                f"{shown(path)}: expected a complete dataflash log of ArduPilot; the bytes from "
                f"{offset} on are not a message"
            )
        if offset + 3 > size:
            return types, _there(places), True
        number = data[offset + 2]
        length = lengths[number]
        if not length:
            raise InputError(
                f"{shown(path)}: expected a whole dataflash log of ArduPilot; the message at byte "
                f"{offset} has the type {number}, which no FMT message describes"
            )
        if offset + length > size:
            return types, _there(places), True
        places[number].append(offset)
        if number == _FORMAT:
            described, kind = _described(path, data, offset)
            if types.setdefault(described, kind) != kind:
                raise InputError(
                    f"{shown(path)}: expected one format of the type {described}, got "
                    f"{types[described].name} and {kind.name}"
                )
            lengths[described] = kind.length
        offset += length
    return types, _there(places), False


def _there(places: list[list[int]]) -> dict[int, list[int]]:
    return {number: offsets for number, offsets in enumerate(places) if offsets}


def _described(path: str, data: bytes, at: int) -> tuple[int, _Type]:
    """Return the type that a FMT message describes, and its number."""
    number, length, name, letters, fields = struct.unpack_from("<BB4s16s64s", data, at + 3)
    texts = [part.split(b"\0")[0].decode("ascii", "replace") for part in (name, letters, fields)]
    kind = _Type(texts[0], length, texts[1], tuple(filter(None, texts[2].split(","))))
    known = {*kind.letters} <= _KINDS.keys() and len(kind.letters) == len(kind.fields)
    if not known or len({*kind.fields}) < len(kind.fields) or kind.dtype.itemsize != length:
        raise InputError(
            f"{shown(path)}: expected a format of {length} bytes for {shown(kind.name)}, got the "
            f"letters {shown(kind.letters)!r} for {len(kind.fields)} fields"
        )
    return number, kind


def _array(raw: NDArray[np.uint8], kind: _Type, offsets: list[int]) -> NDArray[Any]:
    """Return the messages of a type as a structured array."""
    places = np.array(offsets, np.intp)[:, None] + np.arange(kind.length)
    array: NDArray[Any] = raw[places].view(kind.dtype)[:, 0]
    return array


def _instances(types: Mapping[int, _Type], arrays: Mapping[int, NDArray[Any]]) -> dict[int, str]:
    """Return the field with the instance number, by the type that has such a field.

    Messages FMTU give each field a letter for its unit; ``#`` marks the number of an instance.
    """
    fields = {}
    for number, kind in types.items():
        if kind.name != "FMTU" or number not in arrays or "UnitIds" not in kind.fields:
            continue
        for row in arrays[number]:
            letters = bytes(row["UnitIds"]).decode("ascii", "replace")
            described = types.get(int(row["FmtType"]))
            if described is not None and 0 <= letters.find("#") < len(described.fields):
                fields[int(row["FmtType"])] = described.fields[letters.find("#")]
    return fields


def _by_instance(
    kind: _Type, array: NDArray[Any], micros: NDArray[np.uint64], field: str | None
) -> dict[int, dict[str, TopicField]]:
    """Return the numeric fields of each instance; without instance numbers there is one."""
    own = np.zeros(len(array), np.int64) if field is None else array[field].astype(np.int64)
    topics = {}
    for instance in np.unique(own).tolist():
        rows = own == instance
        topics[instance] = {
            name: TopicField(kind.name, micros[rows], values)
            for name, values in _values(kind, array[rows])
        }
    return topics


def _values(kind: _Type, array: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, letter in zip(kind.fields, kind.letters, strict=True):
        scale = _KINDS[letter][1]
        values = array[name]
        if name in _TIMES or values.dtype.kind == "S":
            continue
        if values.ndim == 2:
            yield from ((f"{name}[{i}]", values[:, i]) for i in range(values.shape[1]))
        else:
            yield name, values if scale == 1 else values / scale
