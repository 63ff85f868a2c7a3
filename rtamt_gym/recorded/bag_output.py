"""Writes a copy of a bag as MCAP, with topics for robustness and verdicts."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

import rtamt
from rtamt import InputError
from rtamt.monitors import Occurrences
from rtamt_gym.recorded.bag_reader import Bag, damaged, open_bag
from rtamt_gym.recorded.judge import RESULT, Series, TraceJudgement
from rtamt_gym.recorded.occurrences import states_of
from rtamt_gym.recorded.readers import is_bag
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.trace import EventTrace, Trace

_Message = tuple[int, Connection, bytes | memoryview]
"""A message to write: its time, its connection and its bytes."""


@dataclass(frozen=True, slots=True)
class _Topic:
    """A topic to add.

    Attributes:
        kind: The class of its messages.
        times: The times of the messages in seconds.
        values: The numbers or texts of the messages.
    """

    kind: str
    times: Floats
    values: NDArray[Any]


def check_output(out: Path, path: str) -> None:
    """Check that a copy of a trace can be written to a file."""
    if not is_bag(path):
        raise InputError(
            f"--write-mcap copies a bag, got {path}; --out writes the robustness of any trace"
        )
    if out.suffix.lower() != ".mcap":
        raise InputError(f"cannot write {out}: expected a name that ends in .mcap")
    if Path(path).resolve() in out.resolve().parents:
        raise InputError(f"cannot write {out}: it is in the bag that is read")


def write_mcap(
    trace: Trace | EventTrace,
    judgements: Mapping[str, TraceJudgement],
    specs: Mapping[str, rtamt.Specification],
    out: Path,
    occurrences: Mapping[str, Occurrences],
) -> tuple[list[str], list[str]]:
    """Write all messages of a bag, with robustness and verdicts at the times of the samples.

    The robustness of a requirement is on the topic of its output variable; otherwise, on
    ``/rtamt/NAME``, and its verdict so far (-1, 0 or 1) on that topic with ``/verdict``; named
    formulas have topics of their own. Requirements with occurrences have their state as text on
    that topic with ``/state``. If the bag already has the topic, the added topic ends in
    ``/offline``. Messages of ROS 1 become messages of ROS 2 with the same fields, but for the
    ``seq`` of headers.

    Returns:
        The added topics, and the topics omitted because the bag does not define their classes.
    """
    with open_bag(trace.source) as bag, TemporaryDirectory(dir=out.parent) as folder:
        added = _added(trace, judgements, specs, bag, occurrences)
        folder_path = Path(folder) / "copy"
        writer = Writer(folder_path, version=8, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            left_out = _write(writer, bag, added, trace.epoch)
        (folder_path / "copy.mcap").replace(out)
    return [*added], left_out


def write_bag_clips(path: str, epoch: int, clips: Mapping[Path, tuple[float, float]]) -> None:
    """Write clips of a bag to files."""
    with ExitStack() as opened:
        bag = opened.enter_context(open_bag(path))
        store, outputs = _store(bag), []
        for out, span in clips.items():
            folder = Path(opened.enter_context(TemporaryDirectory(dir=out.parent))) / "clip"
            writer = Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP)
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            opened.callback((folder / "clip.mcap").replace, out)
            opened.enter_context(writer)
            first, last = (epoch + round(time * 1e9) for time in span)
            outputs.append((first, last, writer, _channels(writer, bag, store)))
        every = outputs[0][3]
        for time, to, data in _copied(bag, store, every):
            for first, last, writer, channels in outputs:
                if first <= time <= last:
                    writer.write(channels[to.topic, to.msgtype], time, data)


def _channels(writer: Writer, bag: Bag, store: Typestore) -> dict[tuple[str, str], Connection]:
    """Add the topics of a bag with known classes to a copy."""
    channels: dict[tuple[str, str], Connection] = {}
    for connection in bag.reader.connections:
        name = connection.topic, connection.msgtype
        if connection.msgtype in store.fielddefs and name not in channels:
            ext = connection.ext
            qos = ext.offered_qos_profiles if isinstance(ext, ConnectionExtRosbag2) else ()
            channels[name] = writer.add_connection(*name, typestore=store, offered_qos_profiles=qos)
    return channels


def _write(
    writer: Writer,
    bag: Bag,
    added: Mapping[str, _Topic],
    epoch: int,
) -> list[str]:
    """Write the messages of a bag and the added messages in the order of their times.

    Return the omitted topics: a message of a class that the bag does not define cannot be written.
    """
    store = _store(bag)
    channels = _channels(writer, bag, store)
    sources = [_copied(bag, store, channels)]
    for topic, addition in added.items():
        to = writer.add_connection(topic, addition.kind, typestore=store)
        sources.append(_messages(to, addition, _maker(store, addition.kind), epoch))
    for time, to, data in heapq.merge(*sources, key=lambda connection: connection[0]):
        writer.write(to, time, data)
    copied = {topic for topic, _ in channels}
    return [topic for topic in bag.types if topic not in copied]


def _copied(
    bag: Bag,
    store: Typestore,
    channels: Mapping[tuple[str, str], Connection],
) -> Iterator[_Message]:
    """Yield the messages of the bag that can be written: time, connection and bytes."""
    for connection, time, raw in bag.raw():
        to = channels.get((connection.topic, connection.msgtype))
        if to is None:
            continue
        data: bytes | memoryview = raw
        if not bag.reader.is2:
            try:
                data = store.ros1_to_cdr(raw, connection.msgtype)
            except Exception as error:  # noqa: BLE001 - rosbags raises what it stumbles on
                raise damaged(bag.source, error) from None
        yield time, to, data


def _messages(
    to: Connection,
    addition: _Topic,
    message_of: Callable[[int, Any], memoryview],
    epoch: int,
) -> Iterator[_Message]:
    """Yield the messages of an added topic: time, connection and bytes."""
    times = epoch + np.rint(addition.times * 1e9).astype(np.int64)
    for time, value in zip(times.tolist(), addition.values.tolist(), strict=True):
        yield time, to, message_of(time, value)


_FLOAT, _INT, _TEXT = "std_msgs/msg/Float64", "std_msgs/msg/Int8", "std_msgs/msg/String"
_STAMPED = ("rtamt_msgs/msg/FloatStamped", "rtamt_msgs/msg/FloatMessage")
_STAMPED_TEXT = "std_msgs/Header header\nfloat64 value\n"
_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"


def _store(bag: Bag) -> Typestore:
    """Return the classes of the copy: from the bag, from ROS 2, and for our topics."""
    ours = get_typestore(Stores.ROS2_JAZZY).fielddefs
    known = bag.reader.typestore.fielddefs
    store = get_typestore(Stores.EMPTY)
    head = known if bag.reader.is2 and _HEADER in known else ours
    store.register({**known, _HEADER: head[_HEADER]})
    store.register({kind: ours[kind] for kind in (_FLOAT, _INT, _TEXT) if kind not in known})
    for kind in _STAMPED:
        if kind not in known:
            store.register({kind: get_types_from_msg(_STAMPED_TEXT, kind)[kind]})
    return store


def _maker(store: Typestore, kind: str) -> Callable[[int, Any], memoryview]:
    """Return a function from a time and a number to the bytes of a message."""
    message_class = store.types[kind]
    if kind not in _STAMPED:
        return lambda _time, value: store.serialize_cdr(message_class(data=value), kind)
    stamp, header = store.types[_TIME], store.types[_HEADER]

    def stamped(time: int, value: float) -> memoryview:
        stamp_time = stamp(sec=time // 10**9, nanosec=time % 10**9)
        return store.serialize_cdr(
            message_class(header=header(stamp=stamp_time, frame_id=""), value=value), kind
        )

    return stamped


def _added(
    trace: Trace | EventTrace,
    judgements: Mapping[str, TraceJudgement],
    specs: Mapping[str, rtamt.Specification],
    bag: Bag,
    occurrences: Mapping[str, Occurrences],
) -> dict[str, _Topic]:
    """Return the topics of all formulas, and the topics of the verdicts."""
    added: dict[str, _Topic] = {}
    for name, judgement in judgements.items():
        publications = specs[name].publications(name)
        for publication in publications:
            series = judgement.series[publication.formula or RESULT]
            kind, topic = _placed(publication, publications)
            addition = _Topic(kind, series.times, series.values)
            topic = _free(topic, bag)
            if topic in added and not _same(
                added[topic], addition
            ):  # another requirement uses the topic
                stem = [publications[-1].default]
                stem += (
                    []
                    if publication is publications[-1]
                    else [publication.default.removeprefix("rtamt/")]
                )
                topic = _free("/".join(stem), bag)
            added[topic] = addition
        added[f"{topic}/verdict"] = _Topic(_INT, *_verdicts(judgement, series, trace))
        if name in occurrences:
            states = states_of(occurrences[name], float(series.times[0]))
            added[f"{topic}/state"] = _Topic(_TEXT, *states)
    return added


def _placed(
    publication: rtamt.language.Publication, publications: tuple[rtamt.language.Publication, ...]
) -> tuple[str, str]:
    """Return the class of the messages of a formula and their topic.

    It is the stamped class if it is declared. The fields of a message have topics below the topic
    of the message.
    """
    topic = publication.topic or publication.default
    if sum(topic == (other.topic or other.default) for other in publications) > 1:
        return _FLOAT, "/".join([topic, *publication.path])
    kind = f"{publication.package}/msg/{publication.message}"
    return kind if kind in _STAMPED and publication.path == ("value",) else _FLOAT, topic


def _free(topic: str, bag: Bag) -> str:
    """Return an unused name for a topic."""
    name = f"/{topic.lstrip('/')}"
    return f"{name}/offline" if name in bag.types else name


def _same(one: _Topic, other: _Topic) -> bool:
    return np.array_equal(one.times, other.times) and np.array_equal(one.values, other.values)


def _verdicts(
    judgement: TraceJudgement, series: Series, trace: Trace | EventTrace
) -> tuple[Floats, NDArray[np.int8]]:
    """Return the verdict so far at each time: 0 until it is certain, or until the trace ends."""
    end = trace.span[1] if isinstance(trace, EventTrace) else float(series.times[-1])
    since = judgement.certain_from
    stamp_time = end if since is None else since
    times = np.union1d(series.times[np.abs(series.times - stamp_time) > 1e-9], [stamp_time, end])
    return times, np.where(times >= stamp_time, int(judgement.verdict), 0).astype(np.int8)
