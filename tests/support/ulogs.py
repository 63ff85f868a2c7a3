"""Write logs in the format ULog of PX4, from its published description."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Topic", "Ulog"]

_MAGIC = b"ULog\x01\x12\x35"
_CODES = {
    "int8_t": "b",
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
    "bool": "?",
}


def _message(kind: str, body: bytes) -> bytes:
    """Return a message: the length of its body, its type, its body."""
    return struct.pack("<HB", len(body), ord(kind)) + body


@dataclass(frozen=True)
class Topic:
    """A topic with one instance in a log.

    Attributes:
        name: The topic, ``vehicle_status``.
        fields: Types and names of its fields after the time, ``("float[3]", "q")``.
        instance: The number of the instance.
        subscription: The number of the subscription: a logger may subscribe to a topic twice.
    """

    name: str
    fields: tuple[tuple[str, str], ...]
    instance: int = 0
    subscription: int = 0

    @property
    def format(self) -> str:
        """Return its format message; it is padded to a multiple of 8 bytes."""
        every = (("uint64_t", "timestamp"), *self.fields)
        text = "".join(f"{kind} {name};" for kind, name in every)
        padding = -self.size % 8
        return f"{self.name}:{text}" + (f"uint8_t[{padding}] _padding0;" if padding else "")

    @property
    def codes(self) -> str:
        """Return the struct codes of its values."""
        codes = ["<"]
        for kind, _ in self.fields:
            base, _, count = kind.partition("[")
            codes.append(f"{count.rstrip(']')}{_CODES[base]}")
        return "".join(codes)

    @property
    def size(self) -> int:
        """Return the number of bytes of its values."""
        return struct.calcsize(self.codes)


@dataclass
class Ulog:
    """A log that is written message by message.

    Attributes:
        start: Its start in microseconds.
        messages: The messages after the definitions.
    """

    start: int = 0
    messages: list[bytes] = field(default_factory=list)
    _topics: list[Topic] = field(default_factory=list)

    def data(self, topic: Topic, micros: int, values: Sequence[float]) -> None:
        """Add a record of a topic."""
        if topic not in self._topics:
            self._topics.append(topic)
            head = struct.pack("<BH", topic.instance, self._topics.index(topic))
            self.messages.append(_message("A", head + topic.name.encode()))
        body = struct.pack("<HQ", self._topics.index(topic), micros)
        self.messages.append(_message("D", body + struct.pack(topic.codes, *values)))

    def records(self, topic: Topic, rows: Iterable[tuple[int, Sequence[float]]]) -> None:
        """Add records of a topic."""
        for micros, values in rows:
            self.data(topic, micros, values)

    def dropout(self, milliseconds: int) -> None:
        """Add a period in which nothing could be written."""
        self.messages.append(_message("O", struct.pack("<H", milliseconds)))

    def sync(self) -> None:
        """Add bytes that let a reader find the next message."""
        self.messages.append(_message("S", bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])))

    def text(self, micros: int, text: str) -> None:
        """Add a line of the autopilot's log."""
        self.messages.append(_message("L", struct.pack("<BQ", ord("6"), micros) + text.encode()))

    @property
    def definitions(self) -> list[bytes]:
        """Return the header and the messages before the data: flags, formats, information."""
        info = b"char[3] sys_name"
        formats = dict.fromkeys(topic.format for topic in self._topics)
        return [
            _MAGIC + struct.pack("<BQ", 1, self.start),
            _message("B", bytes(40)),
            *(_message("F", text.encode()) for text in formats),
            _message("I", bytes([len(info)]) + info + b"PX4"),
        ]

    def save(self, path: Path) -> Path:
        """Write the file."""
        path.write_bytes(b"".join([*self.definitions, *self.messages]))
        return path
