"""Reads traces from bags by rosbags: MCAP, rosbag2 with SQLite, and ROS 1; no ROS is needed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from keyword import iskeyword
from pathlib import Path
from struct import unpack_from
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, Nodetype
from rosbags.typesys import Stores, get_typestore

import rtamt
from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt.internal import StampOrder
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.bag_topics import TopicFields, topic_fields
from rtamt_gym.recorded.columns import Columns, FieldError, FieldPath, path_text
from rtamt_gym.recorded.event_rows import Stamps, measured, sampled
from rtamt_gym.recorded.names import starts_of, take_default
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import one_record, same_as_before
from rtamt_gym.recorded.trace import EventTrace, Trace, held
from rtamt_gym.tables import counted, number, shorten


def read_bag(
    path: str,
    specs: Mapping[str, rtamt.Specification],
    reading: EvaluationOptions,
    columns: Columns,
) -> tuple[Trace | EventTrace, Fraction | None]:
    """Return the trace of a bag, and the period of its samples; None for events."""
    if not reading.dense and reading.period is None:
        raise InputError(
            f"{shown(path)}: expected --period, such as 100ms, to sample the messages of a bag, or "
            "--dense to read them as events"
        )
    for option, value in {"--jitter": columns.jitter, "--time-unit": columns.time_unit}.items():
        if value is not None:
            raise InputError(f"{shown(path)}: expected {option} for a table, got it for a bag")
    with open_bag(path) as bag:
        trace, recorded = _events(bag, specs, columns)
    if reading.seconds is None:
        return measured(trace, recorded, columns), None
    groups = [spec.variables for spec in specs.values()]
    return sampled(trace, recorded, groups, reading.seconds, columns), reading.seconds


CLOCKS: Final = ("log", "header")
"""The times of messages: when they were recorded, and what their headers say."""

_APART: Final = 60.0
"""Seconds between stamps and times of recording from which on they are of different clocks."""

_QUIET, _LEAST_QUIET = 5.0, 0.5
"""A topic without a message for so many usual distances, and so many seconds, is quiet."""


@dataclass(slots=True)
class _Messages:
    """The messages of a topic.

    Attributes:
        topic: Its name.
        variables: The variables that are read of a message.
        logged: The time of recording of each message.
        stamps: The time in the header of each message; empty if headers are not read.
        values: The values of each variable, nan if a message has no value.
    """

    topic: str
    variables: tuple[str, ...]
    logged: list[int] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    values: list[list[Any]] = field(default_factory=list)


def _events(
    bag: Bag, specs: Mapping[str, rtamt.Specification], columns: Columns
) -> tuple[EventTrace, dict[str, Floats]]:
    """Return the messages as events, and the times in seconds at which each variable is recorded.

    Last values hold to the end of the bag.
    """
    clock = columns.time or "log"
    if clock not in CLOCKS:
        raise InputError(
            f"{bag.source}: expected --time log, the times of recording of a bag, or --time "
            f"header, got {clock!r}{nearest(clock, CLOCKS)}"
        )
    wanted = topic_fields(bag, specs, columns)
    read = _read(bag, wanted, stamped=clock == "header", strict=columns.missing == "raise")
    notes, choice = list(bag.notes), columns.same_time or "last"
    signals: dict[str, tuple[Stamps, Floats]] = {}
    offsets: dict[str, float] = {}
    spans: dict[str, Stamps] = {}
    for messages in read:
        every, order = _times(bag, messages, notes, offsets, stamped=clock == "header")
        same = same_as_before(every)
        apart_from = np.append(~same, True) if choice == "last" else np.append(True, ~same)
        times, places = every[apart_from], order[apart_from]
        spans[messages.topic] = times
        for variable, values in zip(messages.variables, messages.values, strict=True):
            numbers, seconds = np.array(values, np.float64), (every - bag.begin) / 1e9
            subject = f"{messages.topic}, '{variable}'"
            one_record(every, numbers[order], choice, subject, notes, seconds)
            signals[variable] = times, numbers[places]
            if columns.missing != "unknown":
                signals[variable] = _numbers(bag, messages.topic, variable, *signals[variable])
    _check_clocks(bag, offsets)
    zero = min((int(times[0]) for times in spans.values()), default=bag.begin)
    end = max((int(times[-1]) for times in spans.values()), default=bag.end)
    if clock == "log":  # metadata may describe only the first of several files
        zero, end = min(zero, bag.begin), max(end, bag.end)
    else:
        others = [*_ends_of_others(bag, spans, offsets)]
        zero, end = min([zero, *others]), max([end, *others])
    starts = starts_of(specs, columns)
    topics = {v: m.topic for m in read for v in m.variables}
    recorded = {name: times for name, (times, _) in signals.items()}
    known = replace(columns, starts=starts)
    defaults, default_notes = _started(bag.source, signals, known, zero, topics)
    notes += default_notes
    offset = min(offsets.values(), key=abs, default=0.0)
    epoch = zero + (round(offset * 1e9) if abs(offset) > _APART else 0)
    ends = {name: np.unique(np.append(times, end)) for name, times in recorded.items()}
    recorded_at = {name: (times - zero) / 1e9 for name, times in ends.items()}
    notes += _missing(read, columns)
    notes += _silences(bag.source, spans, zero, end, columns)
    names = dict.fromkeys(v for spec in specs.values() for v in spec.variables)
    events = {v: ((signals[v][0] - zero) / 1e9, signals[v][1]) for v in names}
    absent = events.keys() - recorded.keys()
    length = (end - zero) / 1e9
    trace = EventTrace(
        bag.source,
        held(events, length, columns.max_gap, absent),
        (0.0, length),
        sum(len(events[v][0]) - (v in defaults) for v in events.keys() - absent),
        notes,
        epoch,
        columns.max_gap,
        defaults,
        start_known=columns.start == "known",
        absent=absent,
    )
    return trace, recorded_at


def _read(
    bag: Bag, wanted: Sequence[TopicFields], *, stamped: bool, strict: bool
) -> list[_Messages]:
    """Read the fields of all messages in one pass."""
    readers_of: dict[str, tuple[_Messages, list[Any], bool]] = {}
    for source in wanted:
        collected = _Messages(source.topic, tuple(one.variable for one in source.fields))
        collected.values = [[] for _ in source.fields]
        readers = [(one, collected.values[i].append) for i, one in enumerate(source.fields)]
        readers_of[source.topic] = (
            collected,
            readers,
            stamped and bag.stamped(bag.types[source.topic]),
        )
    for topic, time, message in bag.messages([*readers_of]):
        messages, readers, with_stamp = readers_of[topic]
        messages.logged.append(time)
        if with_stamp:
            stamp = message.header.stamp
            messages.stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
        for one, append in readers:
            try:
                value, got = one.read(message), "nan"
            except IndexError:
                value, got = math.nan, "a list that is shorter"
            if strict and value != value:  # noqa: PLR0124 - nan; math.isnan refuses what is no float
                raise _no_number(bag, messages, one.variable, got)
            append(value)
    return [collected for collected, _, _ in readers_of.values()]


def _no_number(bag: Bag, messages: _Messages, variable: str, got: str) -> InputError:
    """Return the error of a message without a number."""
    seconds = (messages.logged[-1] - bag.begin) / 1e9
    return InputError(
        f"{bag.source}, message {len(messages.logged)} of {messages.topic}, recorded at "
        f"{seconds:.9g} s: expected a number for '{variable}', got {got}; "
        "give --missing hold or --missing drop"
    )


def _times(
    bag: Bag,
    messages: _Messages,
    notes: list[str],
    offsets: dict[str, float],
    *,
    stamped: bool,
) -> tuple[Stamps, NDArray[np.intp]]:
    """Return the times of a topic's messages in order, and the indices of these messages.

    With stamps, late messages and strays do not count (`rtamt.inputs.stamps.StampOrder`).
    """
    if not messages.logged:  # the index of the bag may still count messages
        raise InputError(f"{bag.source}: expected messages on {messages.topic}, got none")
    logged = np.array(messages.logged, np.int64)
    times = logged
    order = np.argsort(logged, kind="stable")  # files of a bag may overlap
    if stamped:
        times = np.array(messages.stamps, np.int64)
        if not times.any():  # no header, or an unset header
            times = logged
            notes.append(f"{messages.topic} has no stamps: its times are when it was recorded")
    if times is not logged:
        order = _in_line(bag, messages.topic, times, logged, notes)
    offsets[messages.topic] = float(np.median(logged - times)) / 1e9
    return times[order], order


def _span(stamps: Sequence[int], logged: Sequence[int]) -> Iterable[int]:
    """Return the first and the last stamp of a topic, without strays."""
    order = StampOrder()
    in_order = [
        accepted.stamp
        for stamp, time in zip(stamps, logged, strict=True)
        for accepted in order.take(stamp, time, None)
    ]
    return min(in_order), max(in_order)


def _in_line(
    bag: Bag, topic: str, stamps: Stamps, logged: Stamps, notes: list[str]
) -> NDArray[np.intp]:
    """Return the indices of messages with valid stamps, in order of recording."""
    by_log = np.argsort(logged, kind="stable")
    order, positions = StampOrder(), list[int]()
    largest = 0
    for position in by_log.tolist():
        for accepted in order.take(int(stamps[position]), int(logged[position]), position):
            positions.append(accepted.message)
            largest = max(largest, accepted.offset)
            if accepted.jump:
                size = f"{abs(accepted.jump) / 1e9:.6g} s"
                jump = (
                    f"that is {size} older than the one before it"
                    if accepted.jump < 0
                    else f"that jumps ahead of the recording by {size}"
                )
                raise InputError(
                    f"{bag.source}: expected stamps of {topic} that increase, got one {jump}, in "
                    f"message {accepted.message + 1} of {len(stamps)}: the clock restarted; cut "
                    "the bag there, or give --time log"
                )
    strays = order.strays + (order.held is not None)
    if strays > len(positions):
        raise InputError(
            f"{bag.source}: expected stamps of {topic} from a clock as fast as the recording, got "
            f"{counted(strays, 'message')} of {len(stamps)} out of line; give --time log"
        )
    if order.late:
        notes.append(
            f"{topic}: {counted(order.late, 'message')} older than the one before left out"
        )
    if strays:
        notes.append(
            f"{topic}: {counted(strays, 'message')} left out, more than 1 s out of line with the "
            "stamps before and after"
        )
    if order.ahead:
        most = round(largest / 1e9, 1)
        notes.append(
            f"{topic}: {counted(order.ahead, 'stamp')} up to {most:g} s ahead of the recording"
        )
    return np.array(positions, np.intp)


def _ends_of_others(bag: Bag, read: Collection[str], offsets: Mapping[str, float]) -> Iterator[int]:
    """Yield the first and last stamps of other topics on the same clock."""
    usual = min(offsets.values(), key=abs, default=0.0)
    for logged, stamps in bag.times(bag.types.keys() - read).values():
        delay = float(np.median(np.array(logged, np.int64) - np.array(stamps, np.int64))) / 1e9
        if abs(delay - usual) <= _APART:
            yield from _span(stamps, logged)


def _check_clocks(bag: Bag, offsets: Mapping[str, float]) -> None:
    """Check that the stamps of all topics can be of one clock."""
    ordered = sorted(offsets, key=lambda topic: offsets[topic])
    if ordered and offsets[ordered[-1]] - offsets[ordered[0]] > _APART:
        raise InputError(
            f"{bag.source}: expected times of one clock, got {ordered[0]} and {ordered[-1]}, which "
            f"are {offsets[ordered[-1]] - offsets[ordered[0]]:.6g} s apart; give --time log"
        )


def _numbers(
    bag: Bag, topic: str, variable: str, times: Stamps, values: Floats
) -> tuple[Stamps, Floats]:
    """Return the values that are numbers, with their times."""
    there = ~np.isnan(values)
    if not there.any():
        raise InputError(
            f"{bag.source}: expected a number for '{variable}' in a message of {topic}, got none"
        )
    return (times, values) if there.all() else (times[there], values[there])


def _missing(read: Sequence[_Messages], columns: Columns) -> list[str]:
    """Return the note on messages without a number for a variable."""
    counts = {
        variable: sum(map(math.isnan, values))
        for messages in read
        for variable, values in zip(messages.variables, messages.values, strict=True)
        if columns.missing != "raise"
    }
    listed = ", ".join(f"{name}: {count}" for name, count in counts.items() if count)
    does = "leave the value before"
    if columns.missing == "unknown":
        does = "leave the value unknown until the next"
    return [f"messages without a number {does} ({listed})"] if listed else []


def _started(
    source: str,
    signals: dict[str, tuple[Stamps, Floats]],
    columns: Columns,
    zero: int,
    topics: Mapping[str, str],
) -> tuple[dict[str, float], list[str]]:
    """Add the defaults of variables before their first message, and return them with notes."""
    defaults, notes = {}, []
    for name, start in columns.starts.items():
        times, values = signals.get(name, (np.array([], np.int64), np.array([])))
        if len(times) and times[0] <= zero:
            continue
        signals[name] = np.append(zero, times), np.append(start, values)
        until = "no message is there"
        if len(times):
            until = f"its first message comes at {number((int(times[0]) - zero) / 1e9)} s"
        on_topic = f" of {topics[name]}" if name in topics else ""
        notes.append(take_default(source, name, columns, until, on_topic))
        defaults[name] = start
    return defaults, notes


def _silences(
    source: str, spans: Mapping[str, Stamps], zero: int, end: int, columns: Columns
) -> list[str]:
    """Describe the topics that pause or end early while their last values hold."""
    notes, stale = [], columns.stale
    for topic, times in spans.items():
        ends = np.append(times, end)
        gaps = np.diff(ends) / 1e9
        usual = float(np.median(gaps[:-1])) if len(times) > 1 else 0.0
        index = int(gaps.argmax())
        since = (int(times[index]) - zero) / 1e9
        if stale is not None and gaps[index] > stale:
            raise InputError(
                f"{source}: expected a message of {topic} every {stale:g} s at least, got "
                f"none for {number(gaps[index])} s after {number(since)} s; a longer --stale "
                "lets it hold so long"
            )
        if columns.most >= gaps[index] > max(_LEAST_QUIET, _QUIET * usual):
            until = "to the end" if index == len(times) - 1 else "until the next"
            notes.append(
                f"{topic}: the message at {number(since)} s is held for {number(gaps[index])} s, "
                f"{until}"
            )
    return notes


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
