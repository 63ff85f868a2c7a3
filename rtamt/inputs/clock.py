"""Times as whole ticks of a clock: times of events become integers here, and times again.

`rtamt/native/dense/clock.hpp` is the C++ twin, which reads and writes the frequent times.
"""

from __future__ import annotations

import math
import numbers
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import Advice, Argument, InputError, Message
from rtamt.inputs.arrays import Floats
from rtamt.program.dense_lowering import MAX_TICKS, DenseProgram, duration_text

Times = NDArray[Any]
"""Times of callers: doubles, integers, `numpy.datetime64`, or rational objects."""
Ticks = NDArray[np.int64]

EXACT = 2**53
"""Every whole number up to this one is a double."""
_UNITS = {
    "W": Fraction(604_800),
    "D": Fraction(86_400),
    "h": Fraction(3_600),
    "m": Fraction(60),
    "s": Fraction(1),
    **{
        unit: Fraction(1, 1000**k) for k, unit in enumerate(("ms", "us", "ns", "ps", "fs", "as"), 1)
    },
}
"""The units of `numpy.datetime64` in seconds, except years and months, whose lengths differ."""
_FINEST_FIRST = ("as", "fs", "ps", "ns", "us", "ms", "s")
"""The units of dates from ticks."""


class Clock:
    """Converts times to ticks and back.

    A double stands for its shortest decimal text. A time is rounded to the nearest tick, or to the
    even one of two.

    Args:
        dense: The program with the length of a tick.
    """

    __slots__ = ("resolution", "tick")

    def __init__(self, dense: DenseProgram) -> None:
        self.tick = dense.tick
        """The length of a tick in the unit of the times."""
        self.resolution = dense.resolution
        """The length of a tick in seconds."""

    def ticks(self, times: Times, name: str) -> Ticks:
        """Return the nearest tick of every time.

        The error about a time of `MAX_TICKS` ticks or more names a resolution that fits.
        """
        if times.dtype.kind == "f":
            return self.nearest_ones(times, name)
        tick, original = self.tick, times
        if times.dtype.kind == "M":
            self._unit()
            times, unit = _since_1970(times)
            tick = self.resolution / unit
        if times.dtype.kind in "iu" and tick.numerator == 1:
            most = MAX_TICKS // tick.denominator
            if not len(times) or (times.max() < most and times.min() > -most):
                return times.astype(np.int64) * np.int64(tick.denominator)
        exact = (_exact(time) / tick for time in times.tolist())
        return np.array(
            [self._counted(t, original[i], i, name) for i, t in enumerate(exact)], np.int64
        )

    def nearest(self, time: Any) -> int:  # noqa: ANN401 - a float or a rational number
        """Return the nearest tick of a time, however far."""
        return round(_exact(time) / self.tick)

    def on_one_tick(self, first: object, second: object) -> bool:
        """Return whether two times are equal or on one tick; False for other objects."""
        try:
            if isinstance(first, float) and isinstance(second, float):
                # distant times need no exact arithmetic
                tick = self.tick.numerator / self.tick.denominator
                if abs(second - first) > 4 * (tick + math.ulp(max(abs(first), abs(second)))):
                    return False
            return first == second or self.nearest(first) == self.nearest(second)
        except (TypeError, ValueError, OverflowError):
            return False

    def nearest_ones(self, times: Times, name: str) -> Ticks:
        """Return the nearest ticks of doubles; errors as in `ticks`."""
        # The relative error of the product, with the text of the double, is below 2^-51. Unless it
        # is that close to the middle between two ticks, it rounds as the exact number does.
        with np.errstate(over="ignore", invalid="ignore"):
            products = times * float(1 / self.tick)
            rounded = np.rint(products)
            sure = np.abs(products - rounded) + np.abs(products) * 2.0**-51 < 0.5
        ticks: Ticks = np.where(sure, rounded, 0.0).astype(np.int64)
        for i in np.flatnonzero(~sure).tolist():
            time = times[i].item()
            ticks[i] = self._counted(_exact(time) / self.tick, time, i, name)
        return ticks

    def _counted(self, exact: Fraction, time: object, i: int, name: str) -> int:
        ticks = round(exact)
        if abs(ticks) >= MAX_TICKS:
            coarser = self.resolution
            while abs(exact) * self.resolution >= MAX_TICKS * coarser:
                coarser *= 10
            raise InputError(
                f"expected a time of less than 2**62 ticks of {duration_text(self.resolution)} at "
                f"event {i}{name}, got {shown(time)}",
                Advice("; ", Argument("resolution", duration_text(coarser)), " would do"),
            )
        return ticks

    def time(self, tick: int, *, dated: bool = False) -> float:
        """Return the time of a tick: the nearest double, or an exact `numpy.datetime64`."""
        if dated:
            time: float = self._dates(np.array([tick]))[0]
            return time
        return tick * self.tick.numerator / self.tick.denominator

    def times(self, ticks: Ticks, *, dated: bool = False) -> Floats:
        """Return the times of ticks, as `time` does."""
        if dated:
            return self._dates(ticks)
        if (
            self.tick.numerator == 1
            and self.tick.denominator <= EXACT
            and (not len(ticks) or max(-ticks.min(), ticks.max()) <= EXACT)
        ):
            return ticks / np.float64(self.tick.denominator)
        return np.array([self.time(tick) for tick in ticks.tolist()], np.float64)

    def _dates(self, ticks: Ticks) -> Times:
        unit, count = self._unit()
        farthest = int(max(-ticks.min(), ticks.max())) if len(ticks) else 0
        if farthest > (2**63 - 1) // count:
            # If a tick is one unit, a datetime64 holds as many ticks as a time can have.
            far = farthest * self.resolution
            would_do = next((u for u in _FINEST_FIRST if far < MAX_TICKS * _UNITS[u]), "s")
            raise InputError(
                f"expected times that datetime64[{unit}] holds, as the resolution is "
                f"{duration_text(self.resolution)}",
                Advice("; ", Argument("resolution", f"1{would_do}"), " would do"),
            )
        return (ticks * np.int64(count)).astype(f"M8[{unit}]")

    def _unit(self) -> tuple[str, int]:
        """Return the longest unit of dates that divides a tick, and its number in a tick."""
        for unit in reversed(_FINEST_FIRST):
            count = self.resolution / _UNITS[unit]
            if count.denominator == 1:
                return unit, int(count)
        raise InputError(
            "expected numbers as times, because no datetime64 counts ticks of "
            f"{duration_text(self.resolution)}",
            Advice("; ", Argument("resolution", "1ns"), " would do"),
        )

    def same_tick(self, before: object, time: object) -> Message:
        """Return the end of the error about two times on one tick: a finer resolution.

        It is empty if the second time is not after the first one.
        """
        first, second = (self._seconds(t) for t in (before, time))
        if first >= second:
            return Message()
        finer = self.resolution
        while round(first / finer) >= round(second / finer):
            finer /= 10
        on_one = f", which is on the same tick of {duration_text(self.resolution)}"
        if max(abs(first), abs(second)) >= MAX_TICKS * finer:
            return Message(
                f"{on_one}; subtract the time of the first event from all, or leave one out"
            )
        return Message(
            on_one, Advice("; ", Argument("resolution", duration_text(finer)), " would do")
        )

    def _seconds(self, time: object) -> Fraction:
        if isinstance(time, np.datetime64):
            count, unit = _since_1970(np.array([time]))
            return int(count[0]) * unit
        return _exact(time) * self.resolution / self.tick


def _exact(time: Any) -> Fraction:  # noqa: ANN401 - a float or a rational number
    if isinstance(time, numbers.Integral):
        return Fraction(int(time))
    return Fraction(time if isinstance(time, Fraction) else float.__repr__(float(time)))


def _since_1970(dates: Times) -> tuple[Times, Fraction]:
    """Return dates as numbers of a unit, and the unit in seconds."""
    unit, count = np.datetime_data(dates.dtype)
    if unit in ("Y", "M"):
        dates, unit, count = dates.astype("M8[D]"), "D", 1
    return dates.astype(np.int64), _UNITS[unit] * count


def shown(time: Any) -> str:  # noqa: ANN401 - a date, a float or a rational number
    """Return a time in an error: an integer as a double if it is one."""
    if isinstance(time, np.datetime64):
        return str(time)
    return repr(float(time)) if abs(time) < EXACT or isinstance(time, float) else str(time)
