"""Reads bags of ROS by rosbags: MCAP, rosbag2 with SQLite, and ROS 1; no ROS is needed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from keyword import iskeyword
from pathlib import Path
from struct import unpack_from
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, Nodetype
from rosbags.typesys import Stores, get_typestore

from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt_gym.recorded.columns import FieldError, FieldPath, path_text
from rtamt_gym.tables import shorten

_KINDS = {".mcap": "an MCAP file of ROS 2", ".bag": "a bag of ROS 1"}
_RECOVERY = {
    ".mcap": "; what is whole in it: mcap recover FILE -o WHOLE.mcap",
    ".bag": "; rosbag reindex FILE writes the index of a bag that was not closed",
}
_HEADER = (Nodetype.NAME, "std_msgs/msg/Header")
_TEXTS = ("string", "wstring")
_STAMP_AT, _STAMP_END = 4, 12
"""Where the stamp of a message that starts with a header is: after the encoding in ROS 2, after
``seq`` in ROS 1."""


class Bag:
    """An open bag. Times are nanoseconds of the clock that recorded.

    Attributes:
        source: The name of the bag, for messages.
        reader: The open reader of rosbags.
        types: The class of the messages on each topic, ``geometry_msgs/Twist``.
        counts: The number of messages on each topic.
        begin: The time of the first message on any topic.
        end: The time of the last message.
        notes: Sentences to print about changes that the reader made.
    """

    def __init__(self, reader: AnyReader, source: str) -> None:
        self.source = source = shown(source)
        self.reader = reader
        self.types: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        for connection in reader.connections:
            kind, topic = shown(_short(connection.msgtype)), shown(connection.topic)
            if self.types.setdefault(topic, kind) != kind:
                raise InputError(
                    f"{source}: expected messages of one class on {topic}, got "
                    f"{self.types[topic]} and {kind}"
                )
            self.counts[topic] = self.counts.get(topic, 0) + connection.msgcount
        if not reader.message_count:
            raise InputError(f"{source}: expected a bag with messages, got one without any")
        if not self.types:
            raise InputError(
                f"{source}: expected an index that lists the topics, got none"
                f"{_RECOVERY.get(Path(source).suffix.lower(), '')}"
            )
        self.begin: int = reader.start_time
        self.end: int = reader.end_time - 1  # rosbags returns one nanosecond more
        has_definitions = any(connection.msgdef.data for connection in reader.connections)
        self.notes: list[str] = []
        if reader.connections and not has_definitions:
            self.notes.append("the bag defines no classes of messages: Humble's are taken")

    def stamped(self, kind: str) -> bool:
        """Return whether messages of a class have a header."""
        fields = self._fields(_long(kind)) or {}
        return fields.get("header") == _HEADER

    def times(self, topics: Collection[str]) -> dict[str, tuple[list[int], list[int]]]:
        """Return the times of recording of messages on some topics, and the times in their headers.

        They are read from the bytes of messages that start with a header; other messages have the
        time of recording.
        """
        by_topic: dict[str, tuple[list[int], list[int]]] = {}
        for connection, time, raw in self.raw(topics):
            topic, stamp = shown(connection.topic), time
            first = next(iter(self.fields(topic)), "")
            if first == "header" and self.stamped(self.types[topic]) and len(raw) >= _STAMP_END:
                order = "<" if not self.reader.is2 or raw[1] & 1 else ">"
                seconds, nanoseconds = unpack_from(f"{order}iI", raw, _STAMP_AT)
                stamp = seconds * 1_000_000_000 + nanoseconds or time
            logged, stamps = by_topic.setdefault(topic, ([], []))
            logged.append(time)
            stamps.append(stamp)
        return by_topic

    def fields(self, topic: str) -> Collection[str]:
        """Return the fields of the messages on a topic; empty if their class is not defined."""
        return self._fields(_long(self.types[topic])) or ()

    def class_at(self, topic: str, path: FieldPath) -> str | None:
        """Return the class of the message at a path in a topic; None for a number."""
        kind: Any = (Nodetype.NAME, _long(self.types[topic]))
        position = f"{topic} ({self.types[topic]})"
        for depth, step in enumerate(path):
            here = path_text(path[:depth])
            where = (
                f"{self.source}: '{here}' of {position}" if here else f"{self.source}: {position}"
            )
            kind = self._within(kind, step, where, depth)
        match kind:
            case (Nodetype.NAME, str(name)):
                return _short(name)
            case (Nodetype.BASE, (name, _)) if name not in _TEXTS:
                return None
            case (Nodetype.BASE, _):
                got, hint = "text", ""
            case _:
                got, hint = "a list", f"write an element, such as {path_text(path)}[0]"
        reason = f"{self.source}: expected a number in '{path_text(path)}' of {position}, got {got}"
        raise FieldError(len(path) - 1, reason, hint)

    def _within(
        self,
        kind: Any,  # noqa: ANN401 - as rosbags
        step: str | int,
        where: str,
        depth: int,
    ) -> Any:  # noqa: ANN401
        """Return the type of a field or an element of a type."""
        match kind:
            case (Nodetype.NAME, str(name)) if isinstance(step, str):
                fields = self._fields(name)
                if fields is None:
                    raise InputError(f"{where}: the bag does not define {_short(name)}")
                if step not in fields:
                    hint = nearest(step, fields).removeprefix("; ")
                    hint = hint or f"its fields are {', '.join(fields)}"
                    raise FieldError(depth, f"{where} has no field '{step}'", hint)
                return fields[step]
            case (Nodetype.ARRAY, (_, count)) if isinstance(step, int) and step >= count:
                reason = f"{where} ends with element [{count - 1}], got [{step}]"
                raise FieldError(depth, reason)
            case (Nodetype.ARRAY | Nodetype.SEQUENCE, (element, _)) if isinstance(step, int):
                return element
            case (Nodetype.ARRAY | Nodetype.SEQUENCE, _):
                raise FieldError(
                    depth, f"{where} is a list", f"write an element, such as [0].{step}"
                )
        is_message = isinstance(step, str)
        phrase, got = (
            ("message", f"field '{step}'") if is_message else ("list", f"element [{step}]")
        )
        raise FieldError(depth, f"{where} is no {phrase}, got {got}")

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Yield the messages of some topics: topic, time of recording, and the message."""
        read = self.reader.deserialize
        for connection, time, raw in self.raw(topics):
            try:
                message = read(raw, connection.msgtype)
            except Exception as error:  # noqa: BLE001 - rosbags raises what it stumbles on
                raise damaged(self.source, error) from None
            yield shown(connection.topic), time, message

    def raw(self, topics: Collection[str] | None = None) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of some topics, or of all: connection of rosbags, time, and bytes."""
        reader = self.reader
        all_of = reader.connections
        wanted = [
            connection
            for connection in all_of
            if topics is None or shown(connection.topic) in topics
        ]
        if not wanted:
            return  # rosbags would read all topics
        try:
            yield from reader.messages(wanted)
        except Exception as error:  # noqa: BLE001 - rosbags raises what it stumbles on
            raise damaged(self.source, error) from None

    def _fields(self, kind: str) -> Mapping[str, Any] | None:
        """Return the types of the fields of a class in order; None if it is not defined."""
        known = self.reader.typestore.fielddefs
        if kind not in known:
            return None
        # rosbags cannot use a Python keyword as an attribute.
        return {f"{name}_" if iskeyword(name) else name: phrase for name, phrase in known[kind][1]}


@contextmanager
def open_bag(path: str) -> Iterator[Bag]:
    """Open a bag: an ``.mcap``, ``.db3`` or ``.bag`` file, or the folder of a rosbag2 bag."""
    Path(path).stat()
    humble = get_typestore(Stores.ROS2_HUMBLE)  # later versions store definitions in bags
    try:
        reader = AnyReader([Path(path)], default_typestore=humble)
        reader.open()
    except Exception as error:  # rosbags raises errors of any type
        if isinstance(error, OSError) and error.filename is not None:
            raise
        raise damaged(path, error) from None
    with closing(reader):
        yield Bag(reader, path)


def _short(name: str) -> str:
    """Return ``geometry_msgs/Twist`` for ``geometry_msgs/msg/Twist``."""
    return name.replace("/msg/", "/")


def _long(name: str) -> str:
    """``geometry_msgs/msg/Twist`` for ``geometry_msgs/Twist``."""
    package, _, message = name.partition("/")
    return name if "/" in message else f"{package}/msg/{message}"


def damaged(path: str, error: Exception) -> InputError:
    """Return the error about a bag that rosbags cannot read."""
    ending = Path(path).suffix.lower()
    path = shown(path)
    kind = _KINDS.get(ending, "a bag of rosbag2")
    text = shorten(" ".join(str(error).split()) or type(error).__name__, 200)
    if "Profile" in text:
        return InputError(f"{path}: expected {kind}, got one with another profile")
    if isinstance(error, KeyError):
        return InputError(f"{path}: expected {kind}, got messages or schemas of {text}")
    if text.startswith("Could not parse"):
        return InputError(f"{path}: expected {kind}, got a definition of messages: {text}")
    intact = f"a whole {kind.partition(' ')[2]}"
    other = text.startswith(("File magic", "File type magic")) or "seems to be empty" in text
    way_out = "" if other else _RECOVERY.get(ending, "")  # other damage cannot be repaired
    return InputError(f"{path}: expected {intact}, got an error: {text.removesuffix('.')}{way_out}")
