"""The extent of a recorded trace, and its gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Final, Self

from rtamt_gym.tables import counted, number, time_text

_LONG: Final = 10
"""A gap of more than this number of usual steps gets a note."""

_WIDTH: Final = 80

_NAMED: Final = 3
"""The number of short traces that a warning names."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The time between two neighbouring records of a variable.

    Attributes:
        seconds: The length in seconds.
        begin: The start in seconds on the clock of the trace.
        usual: The median time between two records there, in seconds.
        of: The variables, joined by commas; empty if all have the gap.
    """

    seconds: float
    begin: float
    usual: float
    of: str = ""

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
    """The start of the trace of a requirement that starts later than the recording.

    Attributes:
        time: The first time in seconds when all variables of the requirement are known.
        begin: The first time when any variable is known.
        of: The variables that are known only from ``time`` on, if others are known before;
            otherwise empty.
        before: The number of events or samples from ``begin`` until ``time``.
        what: ``"event"`` or ``"sample"``.
        verdict: The name of the verdict if the trace starts at ``time``.
        counted: Whether the reported verdict includes the time from ``begin`` on, with the
            variables ``of`` unknown until they start.
    """

    time: float
    begin: float
    of: tuple[str, ...] = ()
    before: int = 0
    what: str = "event"
    verdict: str = ""
    counted: bool = False

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
    """The recorded part of a trace.

    Attributes:
        samples: The number of samples; None in dense time.
        events: The number of events of all variables; None for samples.
        period: Seconds between samples; None in dense time, or if bounds count samples.
        begin: The start time in seconds; None if bounds count samples.
        end: The end time in seconds; None if bounds count samples.
        step: The usual distance of two times; None if bounds count samples.
        gap: The longest gap; None with fewer than two times.
    """

    samples: int | None = None
    events: int | None = None
    period: Fraction | None = None
    begin: float | None = None
    end: float | None = None
    step: float | None = None
    gap: Gap | None = None

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

    def written(self) -> dict[str, Any]:
        """Return the fields as JSON holds them; unknown ones are left out."""
        gap = self.gap
        stored = {
            "samples": self.samples,
            "events": self.events,
            "period": self.period and str(self.period),
            "begin": self.begin,
            "end": self.end,
            "length": self.length,
            "usual_step": self.step,
            "gap": gap
            and {
                "seconds": gap.seconds,
                "begin": gap.begin,
                "usual": gap.usual,
                **({"of": gap.of} if gap.of else {}),
            },
        }
        return {name: value for name, value in stored.items() if value is not None}

    @classmethod
    def read(cls, stored: Mapping[str, Any]) -> Self:
        """Read the output of `written`."""
        period, gap = stored.get("period"), stored.get("gap")
        return cls(
            stored.get("samples"),
            stored.get("events"),
            None if period is None else Fraction(period),
            stored.get("begin"),
            stored.get("end"),
            stored.get("usual_step"),
            None if gap is None else Gap(**gap),
        )

    @property
    def text(self) -> str:
        """The extent in words: the number of samples or events, the times, the longest gap."""
        return ", ".join(filter(None, (self._times, self._length)))

    def lines(self, source: str) -> list[str]:
        """Return the text in lines of a terminal: one if it fits in 80 columns; otherwise two.

        Args:
            source: The name of the trace.
        """
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
        begin, end = (time_text(time, self.step) for time in (self.begin, self.end))
        return f"{phrase}, {every}{begin} to {end}"

    @property
    def _length(self) -> str:
        if self.length is None:
            return ""
        length = f"{time_text(self.length, self.step)} long"
        if self.gap is None:
            return length
        of = f" of {self.gap.of}" if self.gap.of else ""
        return f"{length}, longest gap {number(self.gap.seconds)} s{of}"


def length_text(seconds: float | Fraction | None) -> str:
    """Return a length of time as a cell of a table; empty if it is unknown."""
    return "" if seconds is None else f"{number(float(seconds))} s"


def short_text(extents: Mapping[str, Extent], minimum: Fraction) -> str:
    """Return a text about traces that are too short; empty without such a trace.

    Args:
        extents: The extent of each trace, by its name.
        minimum: The minimum duration of a trace, in seconds.
    """
    short = {name: value.length or 0.0 for name, value in extents.items() if value.shorter(minimum)}
    if not short:
        return ""
    named = [f"{name} ({number(value)} s)" for name, value in list(short.items())[:_NAMED]]
    more = f" and {len(short) - _NAMED} more" if len(short) > _NAMED else ""
    return f"shorter than {number(float(minimum))} s: {', '.join(named)}{more}"


def gap_summary(extents: Mapping[str, Extent]) -> str:
    """Return a text about traces with a long gap, and the longest gap; empty without a gap.

    Args:
        extents: The extent of each trace, by its name.
    """
    gaps = {name: extent.gap for name, extent in extents.items() if extent.gap is not None}
    long = {name: gap for name, gap in gaps.items() if gap.long}
    if not long:
        return ""
    name = max(long, key=lambda trace: long[trace].seconds)
    return (
        f"gaps of more than {_LONG} usual steps in {len(long)} of "
        f"{counted(len(extents), 'trace')}, the longest {number(long[name].seconds)} s in {name}"
    )
