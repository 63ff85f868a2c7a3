"""The times that a stated period replaces."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from rtamt_gym.recorded.columns import NEAR
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.tables import number


@dataclass(frozen=True, slots=True)
class AsideTimes:
    """The distances of rows in seconds, next to a stated period.

    Attributes:
        usual: The median distance.
        smallest: The smallest distance.
        largest: The largest distance.
        place: The row before the first largest distance.
        length: The time from the first row to the last.

    Example:
        >>> times = AsideTimes(0.1, 0.1, 6.4, "line 4", 6.6)
        >>> times.note("time", Fraction(1, 10), 4)[:66]
        "--period leaves the column 'time' aside, which has the rows 0.1 s "
        >>> AsideTimes(0.1, 0.1, 0.1, "line 2", 0.3).note("time", Fraction(1, 10), 4)
        ''
    """

    usual: float
    smallest: float
    largest: float
    place: str
    length: float

    @classmethod
    def of(cls, trace: Trace) -> AsideTimes | None:
        """Return the distances of a trace; None without two times."""
        grid, times = trace.grid, trace.times
        if grid is None or times is None:
            return None
        at = int(grid.steps.argmax())
        least, most = float(grid.steps.min()), float(grid.steps[at])
        return cls(grid.usual, least, most, trace.where(at), float(times.since[-1]))

    def meant(self, period: Fraction) -> str:
        """Return a question if a period in seconds equals the distances in milliseconds."""
        if self.smallest <= 0:
            return ""
        for unit, factor in (("ms", 10**3), ("us", 10**6)):
            if abs(self.usual * factor - float(period)) <= NEAR * float(period):
                return (
                    f"--period without a unit is in seconds; did you mean --period {period}{unit}?"
                )
        return ""

    def note(self, column: str, period: Fraction, samples: int) -> str:
        """Return the note on times that differ from the period; empty if they fit.

        Args:
            column: The column of times.
            period: The stated period in seconds.
            samples: The number of samples.
        """
        wanted, description = float(period), "in an order that does not increase"
        if self.smallest > 0:
            if max(self.largest - wanted, wanted - self.smallest) <= NEAR * wanted:
                return ""
            description = f"{number(self.usual)} s apart most of the time"
            if self.largest > 2 * self.usual:
                description += f", {number(self.largest)} s after {self.place}"
        note = (
            f"--period leaves the column '{column}' aside, which has the rows {description}: "
            f"{number(self.length)} s in all, not {number(float((samples - 1) * period))} s"
        )
        meant = self.meant(period)
        return f"{note}; {meant}" if meant else note
