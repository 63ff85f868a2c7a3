"""The extent of a recorded trace, and its gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import ClassVar, Final, Self

from rtamt_gym.tables import counted, number, time_text

_LONG: Final = 10
"""A gap of more than this number of usual steps gets a note."""

_WIDTH: Final = 80

_NAMED: Final = 3
"""The number of short traces that a warning names."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The time between two neighbouring records of a variable."""

    seconds: float
    begin: float
    usual: float
    of: str = ""  # the variables, joined by commas; empty if all have the gap

    sparse: ClassVar = True  # JSON leaves out defaults

    @property
    def long(self) -> bool:
        """Whether it is long enough for a note."""
        return self.seconds > _LONG * self.usual

    @property
    def note(self) -> str:
        """The warning about the gap, for values that are held."""
        of = f" of {self.of}" if self.of else ""
        steps = f", {number(self.seconds / self.usual)} usual steps" if self.usual else ""
        return (
            f"nothing{of} was recorded for {number(self.seconds)} s after "
            f"{time_text(self.begin, self.seconds)}{steps}: the last values hold; --max-gap limits "
            "for how long"
        )


@dataclass(frozen=True, slots=True)
class LateStart:
    """The start of the trace of a requirement that starts later than the recording."""

    time: float
    begin: float
    of: tuple[str, ...] = ()  # the variables that are later than others, if any
    before: int = 0  # the number of events or samples from begin until time
    what: str = "event"  # or "sample"
    verdict: str = ""  # of the trace from time on
    counted: bool = False  # whether the reported verdict includes the time from begin on

    json_keys: ClassVar = (
        *("time", "begin", "of", "before", "what", "verdict", "counted", "left_out"),
    )

    @property
    def judged(self) -> float:
        """The start time, in seconds, of the trace of the reported verdict."""
        return self.begin if self.counted else self.time

    @property
    def left_out(self) -> int:
        """The number of events or samples that the reported verdict leaves out."""
        return 0 if self.counted else self.before

    @property
    def text(self) -> str:
        """The start in words: the late variable, its delay, and the samples left out."""
        start = f"from {number(self.time)} s on"
        if not self.of:
            return f"evaluated {start}, with its first {self.what}"
        names = ", ".join(f"'{name}'" for name in self.of)
        has_its = "has its" if len(self.of) == 1 else "have their"
        first = f"where {names} {has_its} first {self.what}"
        missing = f"the {number(self.time - self.begin)} s before it"
        remainder = counted(self.before, self.what)
        if not self.counted:
            return f"evaluated {start}, {first}: {missing} are left out, with {remainder}"
        return (
            f"{self.verdict} if evaluated {start}, {first}; {missing}, with {remainder}, count "
            f"with {names} unknown; --start known leaves them out"
        )


@dataclass(frozen=True, slots=True)
class Extent:
    """The recorded part of a trace."""

    samples: int | None = None
    events: int | None = None
    period: Fraction | None = None
    begin: float | None = None
    end: float | None = None
    usual_step: float | None = None
    gap: Gap | None = None

    sparse: ClassVar = True  # JSON leaves out defaults
    json_keys: ClassVar = (
        *("samples", "events", "period", "begin", "end", "length", "usual_step", "gap"),
    )

    @property
    def length(self) -> float | None:
        """Seconds from start to end; None if bounds count samples."""
        if self.period is not None and self.samples is not None:
            # equals the float of a Fraction in a tenth of the time
            return (self.samples - 1) * self.period.numerator / self.period.denominator
        return None if self.begin is None or self.end is None else self.end - self.begin

    def starting(self, time: float) -> Self:
        """Return the extent from a time on, of a trace with times."""
        if self.begin is None or time <= self.begin:
            return self
        samples = self.samples
        if samples is not None and self.period is not None:
            samples -= round((time - self.begin) / float(self.period))
        return replace(self, samples=samples, begin=time)

    def shorter(self, minimum: Fraction) -> bool:
        """Return whether it is shorter than ``minimum`` seconds, by more than rounding."""
        return self.length is not None and self.length < float(minimum) * (1 - 1e-9)

    @property
    def text(self) -> str:
        """The extent in words: the number of samples or events, the times, the longest gap."""
        return ", ".join(filter(None, (self._times, self._length)))

    def lines(self, source: str) -> list[str]:
        """Return the text in lines of a terminal: one if it fits in 80 columns; otherwise two."""
        text = f"{source}: {self.text}"
        if len(text) <= _WIDTH or not self._length:
            return [text]
        return [f"{source}: {self._times}", f"  {self._length}"]

    @property
    def _times(self) -> str:
        phrase = counted(self.samples or 0, "sample")
        if self.events is not None:
            phrase = counted(self.events, "event")
        if self.begin is None or self.end is None:
            return f"{phrase}, bounds count samples"
        every = "" if self.period is None else f"one every {number(float(self.period))} s, "
        begin, end = (time_text(time, self.usual_step) for time in (self.begin, self.end))
        return f"{phrase}, {every}{begin} to {end}"

    @property
    def _length(self) -> str:
        if self.length is None:
            return ""
        length = f"{time_text(self.length, self.usual_step)} long"
        if self.gap is None:
            return length
        of = f" of {self.gap.of}" if self.gap.of else ""
        return f"{length}, longest gap {number(self.gap.seconds)} s{of}"


def length_text(seconds: float | Fraction | None) -> str:
    """Return a length of time as a cell of a table; empty if it is unknown."""
    return "" if seconds is None else f"{number(float(seconds))} s"


def short_text(extents: Mapping[str, Extent], minimum: Fraction) -> str:
    """Return a text about traces that are too short; empty without such a trace."""
    short = {name: value.length or 0.0 for name, value in extents.items() if value.shorter(minimum)}
    if not short:
        return ""
    named = [f"{name} ({number(value)} s)" for name, value in list(short.items())[:_NAMED]]
    more = f" and {len(short) - _NAMED} more" if len(short) > _NAMED else ""
    return f"shorter than {number(float(minimum))} s: {', '.join(named)}{more}"


def gap_summary(extents: Mapping[str, Extent]) -> str:
    """Return a text about traces with a long gap, and the longest gap; empty without a gap."""
    gaps = {name: extent.gap for name, extent in extents.items() if extent.gap is not None}
    long = {name: gap for name, gap in gaps.items() if gap.long}
    if not long:
        return ""
    name = max(long, key=lambda trace: long[trace].seconds)
    return (
        f"gaps of more than {_LONG} usual steps in {len(long)} of "
        f"{counted(len(extents), 'trace')}, the longest {number(long[name].seconds)} s in {name}"
    )
