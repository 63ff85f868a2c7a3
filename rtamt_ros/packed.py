"""Fast serialization of messages that differ only in a time and some numbers."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

_PROBES = (
    (1_700_000_123_456_789_012, 0.1234567890123),
    (1_700_000_321_012_345_678, -0.0),
    (1_800_000_000_000_000_001, math.nan),
    (0, math.inf),
)
"""Times and numbers of test messages: the first locates their bytes, the others check them."""


class MessageMaker:
    """Creates messages with a time in the header and numbers in some fields.

    Args:
        message: The class of the messages.
        fields: The path to the field of each number.
        set_stamp: As in `rtamt_ros.middleware.Middleware`.
    """

    def __init__(
        self,
        message: type,
        fields: Sequence[Sequence[str]],
        set_stamp: Callable[[Any, int], None],
    ) -> None:
        self._message = message
        self._set_stamp = set_stamp
        self._fields = [
            (attrgetter(".".join(outer)) if outer else None, last) for *outer, last in fields
        ]

    def __call__(self, time: int, numbers: Sequence[float]) -> Any:  # noqa: ANN401 - the classes of ROS have no types
        """Return a message with a time in nanoseconds, if it has a header, and with numbers."""
        message = self._message()
        for (holder, last), number in zip(self._fields, numbers, strict=True):
            setattr(message if holder is None else holder(message), last, number)
        self._set_stamp(message, time)
        return message

    @property
    def count(self) -> int:
        """The number of numbers in a message."""
        return len(self._fields)


class MessagePacker:
    """Writes the bytes of the messages of a `MessageMaker`, in a twentieth of the time.

    The numbers and the time are at fixed offsets, which one message shows. The bytes of further
    messages check them.

    Raises:
        ValueError: If the messages are not like this: a number has less than 64 bits, or is an
            integer.
    """

    def __init__(self, make: MessageMaker, serialize: Callable[[Any], bytes]) -> None:
        time, number = _PROBES[0]
        numbers = [number * (index + 1) for index in range(make.count)]
        data = serialize(make(time, numbers))
        parts = [
            (_offset(data, _DOUBLE.pack(number)), "d", index)
            for index, number in enumerate(numbers)
        ]
        stamp = _TIME.pack(*divmod(time, _SECOND))
        self._timed = stamp in data
        if self._timed:
            parts.append((_offset(data, stamp), "II", -1))
        parts.sort()
        layout, self._constants, end = "<", [], 0
        for offset, kind, _ in parts:
            layout += f"{offset - end}s{kind}"
            self._constants.append(data[end:offset])
            end = offset + 8
        self._tail = data[end:]
        self._indices = [index for _, _, index in parts]
        self._pack = struct.Struct(f"{layout}{len(self._tail)}s").pack
        for time, number in _PROBES:
            numbers = [number * (index + 1) for index in range(make.count)]
            if self(time, numbers) != serialize(make(time, numbers)):
                raise ValueError("messages also differ in other bytes")

    def __call__(self, time: int, numbers: Sequence[float]) -> bytes:
        """Return the bytes of a message with a time in nanoseconds and with numbers."""
        values: list[bytes | float] = []
        for constant, index in zip(self._constants, self._indices, strict=True):
            values.append(constant)
            if index < 0:
                values += divmod(time, _SECOND)
            else:
                values.append(numbers[index])
        return self._pack(*values, self._tail)


_SECOND = 1_000_000_000
_DOUBLE = struct.Struct("<d")
_TIME = struct.Struct("<II")


def _offset(data: bytes, part: bytes) -> int:
    """Return the offset of a part, which must occur once."""
    if data.count(part) != 1:
        raise ValueError(f"expected the bytes {part.hex()} once, found {data.count(part)}")
    return data.index(part)
