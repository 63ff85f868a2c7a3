"""Traces of bags: sampled by hold at a period, or events at the times of the messages."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import Final

import numpy as np

import rtamt
from rtamt import InputError
from rtamt_gym.judging.reading import Reading
from rtamt_gym.recorded.bag_reader import open_bag
from rtamt_gym.recorded.bag_signals import BagSignals, Stamps, read_signals
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TimeAxis
from rtamt_gym.recorded.trace import EventTrace, Trace

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
            f"{path}: expected --period 100ms, at which the messages of a bag are sampled, or "
            "--dense, which takes them as events"
        )
    for option, given in {"--jitter": columns.jitter, "--time-unit": columns.time_unit}.items():
        if given is not None:
            raise InputError(f"{path}: expected {option} for a table, got it for a bag")
    with open_bag(path) as bag:
        signals = read_signals(bag, specs, columns)
    if reading.seconds is None:
        return _events(signals), None
    groups = [spec.variables for spec in specs.values()]
    return sampled(signals, groups, reading.seconds, columns.time or "log"), reading.seconds


def sampled(
    signals: BagSignals, groups: Sequence[Collection[str]], period: Fraction, clock: str
) -> Trace:
    """Samples a bag at the multiples of a period since its begin, up to its end.

    A sample has the values of the last messages at its time or before. The first sample is the
    first at which all variables of a group have a value.

    Args:
        signals: The values at the times of their messages.
        groups: The variables of each specification.
        period: Seconds between samples.
        clock: What the times are called.

    Raises:
        InputError: If there would be no sample, or more than ten million.
    """
    step, zero = period * 10**9, signals.zero
    known = {
        name: math.ceil((int(times[0]) - zero) / step)
        for name, (times, _) in signals.signals.items()
    }
    first = min(max((known[name] for name in group), default=0) for group in groups)
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
    held = {name: _held(*found, places) for name, found in signals.signals.items()}
    since: Floats = np.arange(float(count)) * period.numerator / period.denominator
    start = float(first * period)
    times = TimeAxis(clock, since, start, 1e-9, certain=True, step=period)
    return Trace(
        signals.source,
        held,
        count,
        times,
        lambda sample: f"{signals.source}, at {start + since[sample]:.9g} s",
        notes=signals.notes,
        epoch=signals.epoch,
        known_from={name: at - first for name, at in known.items() if at > first},
        unknown=[name for name, (_, values) in signals.signals.items() if np.isnan(values).any()],
    )


def _held(times: Stamps, values: Floats, places: Stamps) -> Floats:
    """The last of some values at each place or before; nan before the first."""
    at = np.searchsorted(times, places, side="right") - 1
    return np.where(at >= 0, values[at], np.nan)


def _events(signals: BagSignals) -> EventTrace:
    """The messages as events; the last value of each variable holds to the end of the bag."""
    events = {}
    for name, (times, values) in signals.signals.items():
        at, held = times, values
        if at[-1] < signals.end:
            at, held = np.append(at, signals.end), np.append(held, held[-1])
        events[name] = (at - signals.zero) / 1e9, held
    return EventTrace(signals.source, events, signals.notes, signals.epoch)
