"""Traces of bags: sampled by hold at a period, or events at the times of the messages."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.options.evaluation import Reading
from rtamt_gym.recorded.bag_reader import open_bag
from rtamt_gym.recorded.bag_signals import BagSignals, Stamps, read_signals
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.event_rows import measured
from rtamt_gym.recorded.gaps import Records, hole_note, longest_gap
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TimeAxis
from rtamt_gym.recorded.trace import EventTrace, Trace, held

__all__ = ["read_bag", "sampled"]

_MOST: Final = 10_000_000
"""The most samples that a bag is turned into."""


def read_bag(
    path: str, specs: Mapping[str, rtamt.Specification], reading: Reading, columns: Columns
) -> tuple[Trace | EventTrace, Fraction | None]:
    """Reads a bag, and the period at which it was sampled; None for events.

    Args:
        path: The bag.
        specs: The specifications, whose topics and fields are read.
        reading: Whether the bag is sampled, and at which period.
        columns: Which fields are read, and which times count.

    Raises:
        InputError: If there is no period, or as `read_signals` does.
        OSError: If there is no such file.
    """
    if not reading.dense and reading.period is None:
        raise InputError(
            f"{shown(path)}: expected --period 100ms, at which the messages of a bag are sampled, "
            "or --dense, which takes them as events"
        )
    for option, given in {"--jitter": columns.jitter, "--time-unit": columns.time_unit}.items():
        if given is not None:
            raise InputError(f"{shown(path)}: expected {option} for a table, got it for a bag")
    with open_bag(path) as bag:
        signals = read_signals(bag, specs, columns)
    if reading.seconds is None:
        return _events(signals, columns), None
    groups = [spec.variables for spec in specs.values()]
    return sampled(signals, groups, reading.seconds, columns), reading.seconds


def sampled(
    signals: BagSignals,
    groups: Sequence[Collection[str]],
    period: Fraction,
    columns: Columns | None = None,
) -> Trace:
    """Samples a bag at the multiples of a period since its begin, up to its end.

    A sample has the values of the last messages at its time or before. The first sample is the
    first at which one of the variables has a value, or the begin of the bag if a specification
    reads none.

    Args:
        signals: The values at the times of their messages.
        groups: The variables of each specification.
        period: Seconds between samples.
        columns: What the times are called, and for how long a message holds.

    Raises:
        InputError: If there would be no sample, or more than ten million.
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
        way = "longer --period" if count > 0 else "shorter --period"
        raise InputError(
            f"{signals.source}: expected 1 to {_MOST} samples, got {got} {float(period):g} s in "
            f"{(signals.end - zero) / 1e9:.6g} s; give a {way}, or --dense"
        )
    # A message at a fraction of a nanosecond there is not: rounding down loses none.
    after = np.arange(first, first + count, dtype=object) * step.numerator // step.denominator
    places: Stamps = zero + after.astype(np.int64)
    columns = columns or Columns()
    sampled_at = {name: _held(*found, places) for name, found in signals.signals.items()}
    records = {name: Records.of(times) for name, times in signals.recorded.items()}
    notes = [*signals.notes]
    if hole := hole_note(records, columns.most):
        notes.append(hole)
        for name, each in records.items():
            silent = signals.signals[name][0][-1] < signals.end
            holes = _in_holes(each, (places - zero) / 1e9, columns.most, silent=bool(silent))
            sampled_at[name][holes] = np.nan
    since: Floats = np.arange(float(count)) * period.numerator / period.denominator
    start = float(first * period)
    times = TimeAxis(columns.time or "log", since, start, 1e-9, certain=True, step=period)
    late = {name: at - first for name, at in known.items() if at > first}
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
        gap=longest_gap(records),
        start_known=columns.start == "known",
    )


def _held(times: Stamps, values: Floats, places: Stamps) -> Floats:
    """The last of some values at each place or before; nan before the first."""
    at = np.searchsorted(times, places, side="right") - 1
    return np.where(at >= 0, values[at], np.nan)


def _in_holes(records: Records, at: Floats, most: float, *, silent: bool) -> NDArray[np.bool_]:
    """Which of some times lie between two records that are farther apart than values hold.

    The times of both are known, but for the end of the bag if it is silent: no message is there.
    """
    last = len(records.steps) - 1
    if last < 0:
        return np.zeros(len(at), bool)
    place = np.clip(np.searchsorted(records.times, at, side="right") - 1, 0, last)
    ends = records.times[place + 1]
    inside: NDArray[np.bool_] = (at > records.times[place]) & (
        (at < ends) | (silent & (place == last))
    )
    inside &= records.steps[place] > most
    return inside


def _events(signals: BagSignals, columns: Columns) -> EventTrace:
    """The messages as events; the last value of each variable holds to the end of the bag."""
    events = {
        name: ((times - signals.zero) / 1e9, values)
        for name, (times, values) in signals.signals.items()
    }
    end = (signals.end - signals.zero) / 1e9
    absent = events.keys() - signals.recorded.keys()
    trace = EventTrace(
        signals.source,
        held(events, end, columns.max_gap, absent),
        (0.0, end),
        sum(
            len(times) - (name in signals.defaults)
            for name, (times, _) in events.items()
            if name not in absent
        ),
        signals.notes,
        signals.epoch,
        columns.max_gap,
        signals.defaults,
        start_known=columns.start == "known",
        absent=absent,
    )
    return measured(trace, signals.recorded, columns)
