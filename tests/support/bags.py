"""Bags of ROS that tests write, with messages from their fields."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

__all__ = ["START", "Said", "plain_mcap", "twist", "write_bag"]

START = 1_700_000_000_000_000_000
"""A time of recording, in nanoseconds."""


@dataclass(frozen=True)
class Said:
    """A message.

    Attributes:
        time: When it was recorded, in nanoseconds.
        topic: Its topic.
        kind: Its class, ``geometry_msgs/Twist``.
        fields: Its fields, those of messages in it as mappings; others are 0, empty or "".
    """

    time: int
    topic: str
    kind: str
    fields: Mapping[str, Any]


def twist(time: int, speed: float, topic: str = "/robot0/cmd_vel") -> Said:
    """Return a command to drive straight on."""
    return Said(time, topic, "geometry_msgs/Twist", {"linear": {"x": speed}})


def store_of(generation: int, definitions: Mapping[str, str]) -> Any:  # noqa: ANN401 - of rosbags
    """Return the message classes of ROS 1 or 2, and more by their definitions."""
    store = get_typestore(Stores.ROS1_NOETIC if generation == 1 else Stores.ROS2_JAZZY)
    for kind, text in definitions.items():
        store.register(get_types_from_msg(text, long(kind)))
    return store


def long(kind: str) -> str:
    return kind.replace("/", "/msg/")


def message(store: Any, kind: str, fields: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of rosbags
    """Return a message of a class (a long name) with some fields, and defaults for the others."""
    made: dict[str, Any] = {}
    for name, (node, what) in store.get_msgdef(kind).fields:
        given = fields.get(name)
        if node == Nodetype.NAME:
            made[name] = message(store, what, given or {})
        elif node == Nodetype.BASE:
            empty: Any = "" if what[0] == "string" else 0
            made[name] = empty if given is None else given
        else:
            (inner, element), count = what
            many = [] if given is None else list(given)
            if inner == Nodetype.NAME:
                made[name] = [message(store, element, each) for each in many]
            else:
                short = np.zeros(count if node == Nodetype.ARRAY else len(many), element[0])
                short[: len(many)] = many
                made[name] = short
    return store.types[kind](**made)


def write_bag(
    path: Path,
    messages: Iterable[Said],
    *,
    definitions: Mapping[str, str] | None = None,
    silent: Sequence[tuple[str, str]] = (),
    compression: str | None = None,
) -> Path:
    """Write a bag in the format of its extension; without one, the folder of rosbag2.

    Args:
        path: ``.mcap``, ``.db3``, ``.bag``, or the name of a folder.
        messages: The messages, in the order in which they are written.
        definitions: Texts of classes that are not part of ROS.
        silent: Topics without messages, each with its class.
        compression: ``STORAGE`` (MCAP), ``MESSAGE`` or ``FILE`` (rosbag2), ``BZ2`` or ``LZ4`` (ROS
            1); None for no compression.
    """
    generation = 1 if path.suffix == ".bag" else 2
    store = store_of(generation, definitions or {})
    writer: Any
    folder = path
    if generation == 1:
        writer = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression])
        serialize = store.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        folder = path.with_name(f"{path.stem}_files") if path.suffix else path
        writer = Writer2(folder, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        serialize = store.serialize_cdr
    with writer:
        channels = {
            topic: writer.add_connection(topic, long(kind), typestore=store)
            for topic, kind in silent
        }
        for each in messages:
            kind = long(each.kind)
            if each.topic not in channels:
                channels[each.topic] = writer.add_connection(each.topic, kind, typestore=store)
            data = serialize(message(store, kind, each.fields), kind)
            writer.write(channels[each.topic], each.time, data)
    if folder != path:
        shutil.move(folder / f"{folder.name}{path.suffix}", path)
        shutil.rmtree(folder)
    return path


def plain_mcap(path: Path, messages: Sequence[Said]) -> Path:
    """Write an MCAP file without chunks, index and summary, record by record."""
    store = store_of(2, {})

    def text(value: str | bytes) -> bytes:
        data = value.encode() if isinstance(value, str) else value
        return struct.pack("<I", len(data)) + data

    def record(kind: int, data: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(data)) + data

    magic = b"\x89MCAP0\r\n"
    parts = [magic, record(1, text("ros2") + text("by hand"))]
    topics: dict[str, int] = {}
    for each in messages:
        kind = long(each.kind)
        if each.topic not in topics:
            number = topics[each.topic] = len(topics) + 1
            definition = store.generate_msgdef(kind, ros_version=2)[0]
            schema = struct.pack("<H", number) + text(kind) + text("ros2msg") + text(definition)
            channel = struct.pack("<HH", number, number) + text(each.topic) + text("cdr") + text("")
            parts += [record(3, schema), record(4, channel)]
        data = bytes(store.serialize_cdr(message(store, kind, each.fields), kind))
        head = struct.pack("<HIQQ", topics[each.topic], 0, each.time, each.time)
        parts.append(record(5, head + data))
    parts += [record(15, bytes(4)), record(2, bytes(20)), magic]
    path.write_bytes(b"".join(parts))
    return path
