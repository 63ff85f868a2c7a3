"""Samples of signals with different times: messages of bags, and records of logs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.grid import Records, hole_note, longest_gap
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TIME, TimeAxis
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.tables import number

_MOST: Final = 10_000_000
"""The most samples that a bag is turned into."""

Stamps = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class BagSignals:
    """The values of variables at the times of their messages.

    Attributes:
        source: The name of the bag.
        signals: The increasing times in nanoseconds and the values of each variable.
        zero: The time that counts as 0 s.
        end: The time up to which the last values hold.
        epoch: Time 0 s in nanoseconds on the clock that recorded.
        notes: Sentences to print about changes that the reader made.
        recorded: When each variable was recorded, in seconds since ``zero``, and the end.
        defaults: The variables that have their default up to their first message, or throughout.
    """

    source: str
    signals: Mapping[str, tuple[Stamps, Floats]]
    zero: int
    end: int
    epoch: int
    notes: Sequence[str]
    recorded: Mapping[str, Floats]
    defaults: Mapping[str, float]


def sampled(
    signals: BagSignals,
    groups: Sequence[Collection[str]],
    period: Fraction,
    columns: Columns | None = None,
    origin: float = 0.0,
) -> Trace:
    """Sample a bag at the multiples of a period, from its start to its end.

    A sample has the values of the last messages at or before its time. The first sample is the
    first at which any variable has a value, or the start of the bag if a specification reads no
    variable.

    Args:
        signals: The values at the times of their messages.
        groups: The variables of each specification.
        period: Seconds between samples.
        columns: The options that name the times and limit how long a message holds.
        origin: The time in seconds at which the bag starts; 0 for a bag of ROS.
    """
    step, zero = period * 10**9, signals.zero
    known = {
        name: math.ceil((int(times[0]) - zero) / step)
        for name, (times, _) in signals.signals.items()
    }
    first = min(min((known[name] for name in group), default=0) for group in groups)
    count = int((signals.end - zero) / step) + 1 - first
    if not 0 < count <= _MOST:
        got = f"{count}, one every" if count > 0 else "none at the multiples of"
        advice = "longer --period" if count > 0 else "shorter --period"
        raise InputError(
            f"{signals.source}: expected 1 to {_MOST} samples, got {got} {float(period):g} s in "
            f"{(signals.end - zero) / 1e9:.6g} s; give a {advice}, or --dense"
        )
    # Times of messages are whole nanoseconds, so rounding down loses no message.
    after = np.arange(first, first + count, dtype=object) * step.numerator // step.denominator
    places: Stamps = zero + after.astype(np.int64)
    columns = columns or Columns()
    sampled_at = {name: _held(*signal, places) for name, signal in signals.signals.items()}
    records = {name: Records.of(times) for name, times in signals.recorded.items()}
    notes = [*signals.notes]
    if hole := hole_note(records, columns.most, origin):
        notes.append(hole)
        for name, record in records.items():
            silent = signals.signals[name][0][-1] < signals.end
            holes = _in_holes(record, (places - zero) / 1e9, columns.most, silent=bool(silent))
            sampled_at[name][holes] = np.nan
    since: Floats = np.arange(float(count)) * period.numerator / period.denominator
    start = origin + float(first * period)
    times = TimeAxis(columns.time or "log", since, start, 1e-9, certain=True, step=period)
    late = {name: time - first for name, time in known.items() if time > first}
    return Trace(
        signals.source,
        sampled_at,
        count,
        times,
        lambda sample: f"{signals.source}, at {start + since[sample]:.9g} s",
        notes=notes,
        epoch=signals.epoch,
        known_from=late,
        unknown=[
            name
            for name, values in sampled_at.items()
            if np.isnan(values[late.get(name, 0) :]).any()
        ],
        defaults=signals.defaults,
        gap=longest_gap(records, origin),
        start_known=columns.start == "known",
    )


def sampled_events(
    trace: EventTrace, groups: Sequence[Collection[str]], period: Fraction, columns: Columns
) -> Trace:
    """Sample events at the multiples of a period from the start of the recording, as in a bag.

    Args:
        trace: The events.
        groups: The variables of each specification.
        period: Seconds between samples.
        columns: The options that name the times and limit how long a value holds.
    """
    begin, end = trace.span
    signals = {
        name: (np.rint(times * 1e9).astype(np.int64), values)
        for name, (times, values) in trace.signals.items()
    }
    note = (
        f"sampled every {number(float(period))} s: a value holds until the next record of its "
        "column"
    )
    bag = BagSignals(
        trace.source,
        signals,
        round(begin * 1e9),
        round(end * 1e9),
        trace.epoch,
        [*trace.notes, note],
        {n: times - begin for n, (times, _) in trace.signals.items() if n not in trace.absent},
        trace.defaults,
    )
    columns = replace(columns, time=columns.time or TIME)
    samples = sampled(bag, groups, period, columns, begin)
    return replace(samples, notes=[*dict.fromkeys(samples.notes)])


def _held(times: Stamps, values: Floats, places: Stamps) -> Floats:
    """Return the last value at or before each place; nan before the first."""
    index = np.searchsorted(times, places, side="right") - 1
    return np.where(index >= 0, values[index], np.nan)


def _in_holes(records: Records, at: Floats, most: float, *, silent: bool) -> NDArray[np.bool_]:
    """Return which times lie between two records that are farther apart than values hold.

    Values at both records are known, except at the end of a bag, which has no message.
    """
    last = len(records.steps) - 1
    if last < 0:
        return np.zeros(len(at), bool)
    index = np.clip(np.searchsorted(records.times, at, side="right") - 1, 0, last)
    ends = records.times[index + 1]
    inside: NDArray[np.bool_] = (at > records.times[index]) & (
        (at < ends) | (silent & (index == last))
    )
    inside &= records.steps[index] > most
    return inside
