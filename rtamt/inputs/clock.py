"""Times as whole ticks of a clock: times of events become integers here, and times again.

`rtamt/native/dense/clock.hpp` is the twin in C++, which reads and writes the frequent times.
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

__all__ = ["EXACT", "Clock", "Ticks", "Times", "shown"]

Times = NDArray[Any]
"""Times as they are given: doubles, integers, `numpy.datetime64`, or objects that are rational."""
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
"""Those that dates of ticks have."""


class Clock:
    """Counts times in ticks, and gives the times of ticks.

    A double stands for its shortest decimal text. A time that is no whole number of ticks goes to
    the nearest one, of two equally near to the even one.

    Args:
        dense: The program, which has the length of a tick.
    """

    __slots__ = ("resolution", "tick")

    def __init__(self, dense: DenseProgram) -> None:
        self.tick = dense.tick
        """The length of a tick in the unit of the times."""
        self.resolution = dense.resolution
        """The length of a tick in seconds."""

    def ticks(self, times: Times, name: str) -> Ticks:
        """The nearest tick of every time; the times are finite.

        Raises:
            InputError: On a time that is `MAX_TICKS` ticks or more from 0. It names the event, and
                a resolution that would do.
        """
        if times.dtype.kind == "f":
            return self.nearest_ones(times, name)
        tick, given = self.tick, times
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
            [self._counted(t, given[i], i, name) for i, t in enumerate(exact)], np.int64
        )

    def nearest(self, time: Any) -> int:  # noqa: ANN401 - a float or a rational number
        """The nearest tick of a time, however far."""
        return round(_exact(time) / self.tick)

    def on_one_tick(self, first: object, second: object) -> bool:
        """Whether two times are the same or have the same nearest tick; other objects have none."""
        try:
            if isinstance(first, float) and isinstance(second, float):
                # What is far apart needs no exact arithmetic.
                tick = self.tick.numerator / self.tick.denominator
                if abs(second - first) > 4 * (tick + math.ulp(max(abs(first), abs(second)))):
                    return False
            return first == second or self.nearest(first) == self.nearest(second)
        except (TypeError, ValueError, OverflowError):
            return False

    def nearest_ones(self, times: Times, name: str) -> Ticks:
        """The nearest ticks of doubles; errors as of `ticks`."""
        # The product is off by less than 2^-51 of it, the text of the double included: if it is not
        # that near to the middle between two ticks, it rounds as the exact number does.
        with np.errstate(over="ignore", invalid="ignore"):
            products = times * float(1 / self.tick)
            whole = np.rint(products)
            sure = np.abs(products - whole) + np.abs(products) * 2.0**-51 < 0.5
        ticks: Ticks = np.where(sure, whole, 0.0).astype(np.int64)
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
        """The time of a tick: the nearest double, or a `numpy.datetime64`, which is exact."""
        if dated:
            time: float = self._dates(np.array([tick]))[0]
            return time
        return tick * self.tick.numerator / self.tick.denominator

    def times(self, ticks: Ticks, *, dated: bool = False) -> Floats:
        """The times of ticks, as `time` gives each."""
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
            # Of a unit that is a tick every time has as few ticks as a datetime64 holds.
            far = farthest * self.resolution
            would_do = next((u for u in _FINEST_FIRST if far < MAX_TICKS * _UNITS[u]), "s")
            raise InputError(
                f"expected times that datetime64[{unit}] holds, as the resolution is "
                f"{duration_text(self.resolution)}",
                Advice("; ", Argument("resolution", f"1{would_do}"), " would do"),
            )
        return (ticks * np.int64(count)).astype(f"M8[{unit}]")

    def _unit(self) -> tuple[str, int]:
        """The longest unit of dates of which a tick is a whole number, and that number."""
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
        """The end of the error about two times on one tick: a resolution that tells them apart.

        It is empty if the time does not come after the one before.
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
    """Dates as numbers of a unit, and the unit in seconds."""
    unit, count = np.datetime_data(dates.dtype)
    if unit in ("Y", "M"):
        dates, unit, count = dates.astype("M8[D]"), "D", 1
    return dates.astype(np.int64), _UNITS[unit] * count


def shown(time: Any) -> str:  # noqa: ANN401 - a date, a float or a rational number
    """A time in an error: an integer as a double if it is one."""
    if isinstance(time, np.datetime64):
        return str(time)
    return repr(float(time)) if abs(time) < EXACT or isinstance(time, float) else str(time)
