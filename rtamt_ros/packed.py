"""Fast serialization of messages that differ in a time and some numbers."""

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
"""Times and numbers that messages are made of to compare their bytes; the first are found again."""


class Made:
    """Makes messages with a time in the header, and numbers in some fields.

    Args:
        message: The class of the messages.
        fields: The paths to the fields of the numbers.
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


class Packed:
    """Returns the bytes of the messages of a `Made`, in a twentieth of the time.

    The numbers and the time have fixed places in the bytes, which are located in one message. The
    result is compared with the bytes of further messages.

    Raises:
        ValueError: If the numbers are not packed like this: they have less than 64 bits, or are
            integers.
    """

    def __init__(self, make: Made, serialize: Callable[[Any], bytes]) -> None:
        time, number = _PROBES[0]
        numbers = [number * (place + 1) for place in range(make.count)]
        data = serialize(make(time, numbers))
        parts = [
            (_place(data, _DOUBLE.pack(each)), "d", number_index)
            for number_index, each in enumerate(numbers)
        ]
        stamp = _TIME.pack(*divmod(time, _SECOND))
        self._timed = stamp in data
        if self._timed:
            parts.append((_place(data, stamp), "II", -1))
        parts.sort()
        layout, self._constants, end = "<", [], 0
        for place, kind, _ in parts:
            layout += f"{place - end}s{kind}"
            self._constants.append(data[end:place])
            end = place + 8
        self._rest = data[end:]
        self._order = [number_index for _, _, number_index in parts]
        self._pack = struct.Struct(f"{layout}{len(self._rest)}s").pack
        for time, number in _PROBES:
            numbers = [number * (place + 1) for place in range(make.count)]
            if self(time, numbers) != serialize(make(time, numbers)):
                raise ValueError("the bytes of messages do not have these places alone")

    def __call__(self, time: int, numbers: Sequence[float]) -> bytes:
        """Return the bytes of a message with a time in nanoseconds and with numbers."""
        values: list[bytes | float] = []
        for constant, at in zip(self._constants, self._order, strict=True):
            values.append(constant)
            if at < 0:
                values += divmod(time, _SECOND)
            else:
                values.append(numbers[at])
        return self._pack(*values, self._rest)


_SECOND = 1_000_000_000
_DOUBLE = struct.Struct("<d")
_TIME = struct.Struct("<II")


def _place(data: bytes, part: bytes) -> int:
    """Return where a part is, which must occur once."""
    if data.count(part) != 1:
        raise ValueError(f"expected the bytes {part.hex()} once, found {data.count(part)}")
    return data.index(part)
