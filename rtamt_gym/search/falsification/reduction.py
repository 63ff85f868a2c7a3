"""Reduction: the simplest input that still violates, found by trying simpler ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.ranges import Parameter, Signal
from rtamt_gym.inputs.space import Space
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.results.trial import Trial

__all__ = ["reduced"]

_DIGITS = (1, 2, 3, 4)
"""The numbers of digits that values are rounded to."""

_Entry = float | Waveform


def reduced(
    row: Trial, space: Space, again: Callable[[Case], Trial | None], most: int
) -> tuple[Trial, int]:
    """Make a violating case simpler, in steps that keep the violation.

    In this order: parameters get their defaults, which removes faults; signals become constant, or
    lose control points; numbers are rounded. Steps are tried in a fixed order, each on the result
    of the steps before.

    Args:
        row: A simulation that violates.
        space: The space of the search: values stay in its ranges, or become defaults.
        again: Runs a case; gives None if it does not violate.
        most: The most cases that are run.

    Returns:
        The simulation of the simplest case that was found, and how many were run.
    """
    budget = _Budget(row, again, most)
    for entry in space:
        if isinstance(entry, Parameter) and entry.default is not None:
            budget.attempt(entry.name, entry.default)
    for entry in space:
        if isinstance(entry, Signal):
            _fewer_points(entry, budget)
    for entry in space:
        _fewer_digits(entry, budget)
    return budget.row, budget.count


class _Budget:
    """The simplest case so far, and the number of cases that were run."""

    def __init__(self, row: Trial, again: Callable[[Case], Trial | None], most: int) -> None:
        self.row = row
        self.count = 0
        self._again = again
        self._most = most

    @property
    def case(self) -> Case:
        return self.row.case

    def attempt(self, name: str, entry: _Entry) -> bool:
        """Give a name another entry if the case then still violates."""
        if entry == self.case[name] or self.count >= self._most:
            return False
        self.count += 1
        row = self._again(Case({**self.case, name: entry}))
        self.row = row or self.row
        return row is not None


def _fewer_points(signal: Signal, budget: _Budget) -> None:
    """Make a signal constant, or remove control points one by one."""
    wave = budget.case[signal.name]
    assert isinstance(wave, Waveform)  # noqa: S101 - the space has made it
    for value in dict.fromkeys([_mean(wave), *wave.values]):
        if len(wave.values) > 1 and budget.attempt(signal.name, Waveform([0.0], [value])):
            return
    index = len(wave.values) - 1
    while index >= 0:
        wave = budget.case[signal.name]
        assert isinstance(wave, Waveform)  # noqa: S101
        fewer = _without(wave, index)
        if fewer is not None:
            budget.attempt(signal.name, fewer)
        index -= 1


def _without(wave: Waveform, at: int) -> Waveform | None:
    """The waveform without a control point; None if it would have too few."""
    if len(wave.values) <= (1 if wave.interpolation == "hold" else 2):
        return None
    times, values = list(wave.times), list(wave.values)
    # Before its first control point a waveform has the value of that: the second takes its place.
    del times[max(at, 1)], values[at]
    return Waveform(times, values, wave.interpolation)


def _mean(wave: Waveform) -> float:
    return math.fsum(wave.values) / len(wave.values)


def _fewer_digits(entry: Signal | Parameter, budget: _Budget) -> None:
    """Rounds the numbers of an entry, each to as few digits as do."""
    now = budget.case[entry.name]
    if not isinstance(now, Waveform):
        if isinstance(entry, Parameter) and entry.values is not None:
            return
        for value in _rounded(now, entry):
            if budget.attempt(entry.name, value):
                return
        return
    for index in range(len(now.values)):
        wave = budget.case[entry.name]
        assert isinstance(wave, Waveform)  # noqa: S101
        for value in _rounded(wave.values[index], entry):
            values = [*wave.values[:index], value, *wave.values[index + 1 :]]
            if budget.attempt(entry.name, Waveform(wave.times, values, wave.interpolation)):
                break


def _rounded(value: float, entry: Signal | Parameter) -> Iterator[float]:
    """A number rounded to more and more digits, up to itself; only results inside the range."""
    if not math.isfinite(value):
        return
    # The range sets the first digit: 0.0031 in a range up to 100 is 0.
    size = max(abs(entry.low), abs(entry.high))
    position = math.floor(math.log10(size)) if size else 0
    for digits in _DIGITS:
        number = round(value, digits - 1 - position) + 0.0
        if number == value:
            return
        if entry.low <= number <= entry.high:
            yield number
