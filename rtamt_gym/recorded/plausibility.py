"""Checks of the values in a trace: declared ranges, and variables that never change."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

import rtamt
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.tables import number, time_text

__all__ = ["constant_note", "outside_ranges"]


def outside_ranges(spec: rtamt.Specification, trace: Trace | EventTrace) -> dict[str, str]:
    """Return a text for each variable with values outside the range that it is declared with.

    Unknown values are not compared.

    Args:
        spec: The specification.
        trace: The samples or events.
    """
    texts = {}
    for name, (low, high) in spec.ranges.items():
        values = _values(trace).get(name, np.zeros(0))
        outside = (values < low) | (values > high)
        if outside.any():
            at = int(outside.argmax())
            texts[name] = (
                f"{int(outside.sum())} of {len(values)} values of {name} are outside the declared "
                f"range [{number(low)}, {number(high)}], the first is {number(float(values[at]))} "
                f"{_place(trace, name, at)}"
            )
    return texts


def constant_note(trace: Trace | EventTrace) -> str:
    """Return the note on variables with one value in the whole trace; empty without one."""
    constant = {}
    for name, values in _values(trace).items():
        known = values[~np.isnan(values)]
        if name not in trace.defaults and len(known) > 1 and known.min() == known.max():
            constant[name] = float(known[0])
    if not constant:
        return ""
    listed = ", ".join(f"{name} ({number(value)})" for name, value in constant.items())
    return f"constant over the whole trace: {listed}"


def _values(trace: Trace | EventTrace) -> Mapping[str, Floats]:
    if isinstance(trace, Trace):
        return trace.columns
    return {name: values for name, (_, values) in trace.signals.items()}


def _place(trace: Trace | EventTrace, name: str, at: int) -> str:
    """Return where a value is, by its time, or without times by its row."""
    if isinstance(trace, EventTrace):
        return f"at {time_text(float(trace.signals[name][0][at]), trace.step)}"
    if trace.times is None:
        return f"in {trace.where(at)}"
    step = 1.0 if trace.gap is None else trace.gap.usual
    return f"at {time_text(trace.start + float(trace.times.since[at]), step)}"
