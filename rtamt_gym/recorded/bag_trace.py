"""Reads traces from bags: values at the times of messages, as samples or events."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt.internal import StampOrder
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.bag_reader import Bag, open_bag
from rtamt_gym.recorded.bag_topics import TopicFields, topic_fields
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.event_rows import Stamps, measured, sampled
from rtamt_gym.recorded.names import starts_of, take_default
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import one_record, same_as_before
from rtamt_gym.recorded.trace import EventTrace, Trace, held
from rtamt_gym.tables import counted, number


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
