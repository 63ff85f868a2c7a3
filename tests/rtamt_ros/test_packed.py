"""Packed messages have the bytes of serialized messages."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import CLASSES

from rtamt_ros.packed import MessageMaker, MessagePacker

PARTS = CLASSES["my_msgs", "Parts"]


def set_stamp(message: Any, time: int) -> None:  # noqa: ANN401 - the classes of ROS have no types
    if hasattr(message, "header"):
        message.header.stamp.ns = time


def serialized(message: Any) -> bytes:  # noqa: ANN401
    """Return the bytes of `PARTS` or a number, between fixed others."""
    if not hasattr(message, "header"):
        return b"begin" + struct.pack("<d", message.data)
    time = struct.pack("<II", *divmod(message.header.stamp.ns, 10**9))
    numbers = struct.pack("<ddd", message.b, message.a, message.inner.y)
    return b"\0" * 4 + time + b"frame" + numbers + b"end"


@given(
    time=st.integers(0, 2**31 * 10**9),
    numbers=st.lists(st.floats(), min_size=3, max_size=3),
    order=st.permutations([("a",), ("b",), ("inner", "y")]),
)
def test_bytes_are_those_of_the_message(
    time: int, numbers: list[float], order: list[tuple[str, ...]]
) -> None:
    made = MessageMaker(PARTS, order, set_stamp)
    assert MessagePacker(made, serialized)(time, numbers) == serialized(made(time, numbers))


@given(time=st.integers(0, 2**31 * 10**9), number=st.floats())
def test_a_message_without_a_header_has_no_time(time: int, number: float) -> None:
    made = MessageMaker(CLASSES["std_msgs", "Float64"], [("data",)], set_stamp)
    assert MessagePacker(made, serialized)(time, [number]) == serialized(made(time, [number]))


def shortened(message: Any) -> bytes:  # noqa: ANN401
    return struct.pack("<f", message.data)


def doubled(message: Any) -> bytes:  # noqa: ANN401
    return serialized(message) * 2


def summed(message: Any) -> bytes:  # noqa: ANN401
    bits = serialized(message)
    return bits + bytes([sum(bits) % 256])


@pytest.mark.parametrize("odd", [shortened, doubled, summed])
def test_bytes_of_another_kind_are_refused(odd: Callable[[Any], bytes]) -> None:
    made = MessageMaker(CLASSES["std_msgs", "Float64"], [("data",)], set_stamp)
    with pytest.raises(ValueError, match="bytes"):
        MessagePacker(made, odd)
