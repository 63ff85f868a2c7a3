"""Recordings of autopilots: each topic has its own times, in microseconds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.arrays import ArrayRecording, at_instants, check_records
from rtamt_gym.recorded.columns import SameTime
from rtamt_gym.recorded.recording import Recording, Rows, Wanted
from rtamt_gym.recorded.times import TIME, check_rising, one_record
from rtamt_gym.tables import counted, number


class TopicField(NamedTuple):
    """The values of a field, and their times in microseconds."""

    topic: str
    times: NDArray[np.uint64]
    values: NDArray[Any]


class TopicRecording(Recording):
    """The fields of topics, and the column ``time`` with the times of all values.

    A field is called ``topic.field``; ``topic.0.field`` is the field of the first instance of a
    topic. Times are seconds since the start of the autopilot. If a field has no value at a time of
    another field, its cell is empty; nan is a record without a number.
    """

    def __init__(
        self,
        source: str,
        fields: Mapping[str, TopicField],
        lines: Sequence[NDArray[np.uint64]],
        notes: Sequence[str] = (),
        same_time: SameTime | None = None,
    ) -> None:
        self.source, self._same_time = shown(source), same_time or "last"
        self._fields, self._lines, self._notes = fields, lines, notes
        self.names: Sequence[str] = [TIME, *fields]

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted fields."""
        names = [name for name in wanted.names if name != TIME]
        fields = {name: self._fields[name] for name in names or list(self._fields)[:1]}
        ordered, notes = self._in_order(fields)
        lines = [name.times for name in ordered.values()]
        own = wanted.time in (None, TIME)
        ends = [self._ends()] if wanted.ends and own else []
        micros = np.unique(np.concatenate([*lines, *ends]))
        arrays, invalid = at_instants(micros, {n: (f.times, f.values) for n, f in ordered.items()})
        rows = ArrayRecording(self.source, {TIME: micros / 1e6, **arrays}, invalid).read(wanted)
        check_records(rows, wanted)
        unit = "s" if own else rows.unit or _unit_of(str(wanted.time))
        return replace(rows, unit=unit, sparse=True, notes=[*rows.notes, *self._notes, *notes])

    def _ends(self) -> NDArray[np.uint64]:
        """Return the first and the last time of all topics."""
        stamped = [times[times > 0] for times in self._lines]
        ends = [end for times in stamped if len(times) for end in (times.min(), times.max())]
        return np.array([min(ends), max(ends)], np.uint64)

    def _in_order(
        self, fields: Mapping[str, TopicField]
    ) -> tuple[dict[str, TopicField], list[str]]:
        """Return the fields with increasing times, and notes on omitted records."""
        ordered: dict[str, TopicField] = {}
        left_out: dict[str, None] = {}
        notes: list[str] = []
        for name, (topic, times, values) in fields.items():
            stamped = _stamped(times)
            if not stamped.any():
                raise InputError(
                    f"{self.source}: expected records of {topic} with a time, got none"
                )
            check_rising(times[stamped] / 1e6, f"{self.source}, {topic}")
            micros, numbers = times[stamped], np.asarray(values[stamped], np.float64)
            seconds = micros / 1e6
            places = one_record(micros, numbers, self._same_time, f"'{name}'", notes, seconds)
            ordered[name] = TopicField(topic, micros[places], numbers[places])
            if not stamped.all():
                left = counted(int((~stamped).sum()), "record")
                left_out[f"{topic}: {left} without a time"] = None
        return ordered, [*notes, *([f"left out: {', '.join(left_out)}"] if left_out else [])]


def _unit_of(field: str) -> str:
    """Return the unit of times in a field; PX4 writes timestamps in microseconds."""
    return "us" if field.rsplit(".", maxsplit=1)[-1].startswith("timestamp") else ""


def _stamped(times: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Return which records have a time; 0 stands for a missing time.

    The first record is at 0 if the next one follows within two usual steps: the log starts there.
    """
    stamped = times > 0
    if len(times) > 2 and stamped[1:].all():
        stamped[0] = times[0] > 0 or times[1] <= 2 * np.median(np.diff(times[1:].astype(float)))
    return stamped


def cut_note(last: float) -> str:
    """Return the note on a log that ends within a message."""
    return f"the log ends within a message, after {number(last)} s; what came before is read"


def named_fields(
    topics: Mapping[str, Mapping[int, Mapping[str, TopicField]]],
) -> dict[str, TopicField]:
    """Return the fields of topics by name."""
    return {shown(name): field for name, field in _named(topics)}


def _named(
    topics: Mapping[str, Mapping[int, Mapping[str, TopicField]]],
) -> Iterator[tuple[str, TopicField]]:
    for topic, instances in topics.items():
        for instance, fields in instances.items():
            for name, field in fields.items():
                if len(instances) == 1:
                    yield f"{topic}.{name}", field
                    yield f"{topic}.{instance}.{name}", field
                else:
                    own = field._replace(topic=f"{topic}.{instance}")
                    yield f"{topic}.{instance}.{name}", own
