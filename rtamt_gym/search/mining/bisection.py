"""Bisection for the tightest value with which all traces satisfy a requirement.

Values of the parameter are numbered from 0: the multiples of a step, or all floats of a range.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, NamedTuple

from rtamt import InputError, Verdict
from rtamt.errors import Advice, Argument, Message
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.numbers import exact
from rtamt_gym.tables import counted, number, shorten


@dataclass(frozen=True)
class GridValues:
    """The multiples of a step in a range, with both ends, which may be closer to a neighbour."""

    low: Fraction
    high: Fraction
    step: Fraction

    @property
    def last(self) -> int:
        """The number of the largest value."""
        return math.ceil(self.high / self.step) - math.floor(self.low / self.step)

    def at(self, place: int) -> Fraction:
        """Return the value of a number."""
        value = (math.floor(self.low / self.step) + place) * self.step
        return min(max(value, self.low), self.high)

    def near(self, part: Fraction) -> int:
        """Return the number of a value near a part of the range, from 0 to 1."""
        return round(part * self.last)


@dataclass(frozen=True)
class FloatValues:
    """All floats of a range, without floats closer to 0 than 1e-300, which no text can contain."""

    low: float
    high: float

    @property
    def last(self) -> int:
        """The number of the largest value."""
        return _ordinal(self.high) - _ordinal(self.low)

    def at(self, place: int) -> Fraction:
        """Return the value of a number."""
        return Fraction(_float(_ordinal(self.low) + place))

    def near(self, part: Fraction) -> int:
        """Return the number of a value near a part of the range, from 0 to 1."""
        value = Fraction(self.low) + part * (Fraction(self.high) - Fraction(self.low))
        return _ordinal(float(value)) - _ordinal(self.low)


Candidates = GridValues | FloatValues
"""Increasing values of a parameter, numbered from 0."""


def _bits(value: float) -> int:
    """Return the number of a float above 0 in the order of all positive floats."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return int(bits)


_SMALLEST: Final = _bits(1e-300)


def _ordinal(value: float) -> int:
    """Return the number of a float in the order of all: 0 for 0, 1 for 1e-300."""
    ordinal = max(0, _bits(abs(value)) - _SMALLEST + 1)
    return ordinal if value > 0 else -ordinal


def _float(ordinal: int) -> float:
    """Return the float of a number of `_ordinal`."""
    if ordinal == 0:
        return 0.0
    (value,) = struct.unpack("<d", struct.pack("<q", abs(ordinal) - 1 + _SMALLEST))
    return math.copysign(float(value), ordinal)


def values_between(low: float, high: float, tolerance: float | None) -> Candidates:
    """Return the candidate values of a constant: steps of a tolerance, or all floats if it is 0.

    The default step is the largest power of ten up to a 100,000th of the range.

    Example:
        >>> [text_of(values_between(1, 200, step).at(1)) for step in (None, 0.25, 0)]
        ['1.001', '1.25', '1.0000000000000002']
    """
    if tolerance == 0:
        return FloatValues(low, high)
    if tolerance is None:
        step = Fraction(10) ** (math.floor(math.log10(high - low)) - 5)
    else:
        step = exact(check_number("tolerance", tolerance, high - low))
    return GridValues(exact(low), exact(high), step)


def bounds_between(low: float, high: float, step: Fraction) -> Candidates:
    """Return the multiples of a step in a range; raise InputError if there are fewer than two."""
    smallest, largest = exact(low), exact(high)
    values = GridValues(math.ceil(smallest / step) * step, math.floor(largest / step) * step, step)
    if values.last < 1:
        raise InputError(
            f"expected a range with at least two multiples of the period, got {text_of(smallest)} "
            f"to {text_of(largest)}, where the period is {text_of(step)}"
        )
    return values


def text_of(value: Fraction | float) -> str:
    """Return a value as text that is read as the same float.

    Example:
        >>> text_of(Fraction(120214, 1000)), text_of(2.0), text_of(Fraction(1, 3))
        ('120.214', '2', '0.3333333333333333')
    """
    return repr(float(value)).removesuffix(".0")


PROBES: Final = 17
"""The number of values at which every trace is judged, to check that it is monotone."""


class ValueVerdict(NamedTuple):
    """The verdict and robustness of a trace at one value of the parameter."""

    verdict: Verdict
    robustness: float


@dataclass(frozen=True, slots=True)
class Tightest:
    """The tightest value, with its evidence; values and traces are numbers.

    Attributes:
        tighter: The neighbour of the value, where the requirement does not hold.
        failing: The traces that do not satisfy it there, in ascending order of robustness.
        robustness: The robustness of each failing trace at the tightest value.
        probes: The number of values at which every trace was judged.
    """

    place: int
    tighter: int
    failing: tuple[int, ...]
    robustness: tuple[float, ...]
    evaluations: int
    probes: int


class _Bisection:
    """Judges traces at values, each once."""

    def __init__(
        self,
        names: Sequence[str],
        values: Candidates,
        parameter: str,
        judge: Callable[[int, Fraction], ValueVerdict],
    ) -> None:
        self.names, self.values, self.parameter = names, values, parameter
        self._judge = judge
        self._known: dict[tuple[int, int], ValueVerdict] = {}
        parts = (Fraction(i, PROBES - 1) for i in range(PROBES))
        self.probes = sorted({values.near(part) for part in parts})

    @property
    def evaluations(self) -> int:
        return len(self._known)

    def judged(self, trace: int, place: int) -> ValueVerdict:
        if (trace, place) not in self._known:
            self._known[trace, place] = self._judge(trace, self.values.at(place))
        return self._known[trace, place]

    def holds(self, trace: int, place: int) -> bool:
        return self.judged(trace, place).verdict is Verdict.SATISFIED

    def text(self, place: int) -> str:
        return f"{self.parameter} = {text_of(self.values.at(place))}"

    def check_monotone(self, trace: int) -> None:
        """Refuse a trace that satisfies the requirement, then does not, and then does; or back."""
        places = sorted(position for number, position in self._known if number == trace)
        held = [self.holds(trace, position) for position in places]
        changes = [i for i in range(1, len(places)) if held[i] != held[i - 1]]
        if len(changes) < 2:
            return
        first, second = changes[:2]
        values = [places[first - 1], places[first], places[second]]
        verdicts = [self.judged(trace, position).verdict.name for position in values]
        shown = ", ".join(
            f"{verdict} at {self.text(position)}"
            for verdict, position in zip(verdicts, values, strict=True)
        )
        raise InputError(
            f"expected a requirement that is monotone in {self.parameter!r}; {self.names[trace]} "
            f"is {shown}; give a range with a single change"
        )


def tightest(
    names: Sequence[str],
    values: Candidates,
    parameter: str,
    judge: Callable[[int, Fraction], ValueVerdict],
    advance: Callable[[int], None],
) -> Tightest:
    """Return the tightest value with which all traces satisfy a requirement.

    Every trace is judged at `PROBES` values. Then each trace that does not satisfy the requirement
    at the tightest value so far is bisected. In the end all traces are judged at the resulting
    value and at its neighbour. ``advance`` gets the number of traces judged at all probes.

    Raises:
        InputError: If a trace changes its verdict more than once over the values, two traces change
            in opposite directions, or the requirement holds at no value or at all of them.
    """
    search = _Bisection(names, values, parameter, judge)
    brackets: list[tuple[int, int, int]] = []  # the last that fails, the first that holds, trace
    never = []
    for trace in range(len(names)):
        held = [search.holds(trace, position) for position in search.probes]
        search.check_monotone(trace)
        advance(1)
        if not any(held):
            never.append(trace)
        elif not all(held):
            change = next(i for i in range(1, len(held)) if held[i] != held[i - 1])
            ends = search.probes[change - 1], search.probes[change]
            brackets.append((*(ends if held[change] else ends[::-1]), trace))
    _refuse_opposite(search, brackets)
    _refuse_never(search, never)
    if not brackets:
        raise _everywhere(search)
    rising = brackets[0][0] < brackets[0][1]
    # The traces with the strictest brackets come first, so that few others have to be bisected.
    brackets.sort(
        key=lambda bracket: (
            -bracket[0] if rising else bracket[0],
            search.judged(bracket[2], bracket[0]).robustness,
        )
    )
    best: int | None = None
    for last_fail, first_hold, trace in brackets:
        fail, hold = last_fail, first_hold
        if best is not None:
            if search.holds(trace, best):
                continue
            search.check_monotone(trace)
            fail = best
        while abs(hold - fail) > 1:
            middle = (fail + hold) // 2
            fail, hold = (fail, middle) if search.holds(trace, middle) else (middle, hold)
        best = hold
    assert best is not None  # noqa: S101 - there is a bracket
    tighter = best - 1 if rising else best + 1
    for trace in range(len(names)):
        search.holds(trace, best)
        search.holds(trace, tighter)
        search.check_monotone(trace)
    failing = [trace for trace in range(len(names)) if not search.holds(trace, tighter)]
    failing.sort(key=lambda trace: search.judged(trace, tighter).robustness)
    robustness = tuple(search.judged(trace, best).robustness for trace in failing)
    return Tightest(
        best, tighter, tuple(failing), robustness, search.evaluations, len(search.probes)
    )


def _refuse_opposite(search: _Bisection, brackets: Sequence[tuple[int, int, int]]) -> None:
    """Raise InputError if traces need values in opposite directions."""
    rising = next((bracket for bracket in brackets if bracket[0] < bracket[1]), None)
    falling = next((bracket for bracket in brackets if bracket[0] > bracket[1]), None)
    if rising is None or falling is None:
        return
    raise InputError(
        f"expected a requirement that is monotone in {search.parameter!r}; "
        f"{search.names[rising[2]]} satisfies it at {search.text(rising[1])} and not at "
        f"{search.text(rising[0])}, {search.names[falling[2]]} at {search.text(falling[1])} and "
        f"not at {search.text(falling[0])}"
    )


def _refuse_never(search: _Bisection, never: Sequence[int]) -> None:
    """Refuse a requirement that some trace satisfies at no value."""
    if not never:
        return
    trace = never[0]
    nearest = max(
        search.probes,
        key=lambda place: (search.judged(trace, place).verdict, search.judged(trace, place)[1]),
    )
    there = search.judged(trace, nearest)
    if there.verdict is Verdict.UNDECIDED:
        advice: str = Message(
            "the samples that would decide it are missing; leave it out",
            Advice(", or judge it as complete with ", Argument("end", "complete")),
        )
    elif nearest in {search.probes[0], search.probes[-1]}:
        advice = "give a wider range"
    else:
        advice = "a value between them might; give a narrower range around it"
    others = f", and {counted(len(never) - 1, 'other')} alike" * (len(never) > 1)
    raise InputError(
        f"none of the {len(search.probes)} tried values of {search.parameter!r} from "
        f"{_span(search)} satisfies the requirement on {_traces(search)}: "
        f"{shorten(search.names[trace], 60)} comes closest at {search.text(nearest)}, "
        f"{there.verdict.name} with robustness {number(there.robustness + 0.0)}{others}; ",
        advice,
    )


def _everywhere(search: _Bisection) -> InputError:
    ends = search.probes[0], search.probes[-1]
    shown = []
    for position in ends:
        worst = min(range(len(search.names)), key=lambda i: search.judged(i, position).robustness)
        height = number(search.judged(worst, position).robustness)
        shown.append(f"{height} at {search.text(position)} ({shorten(search.names[worst], 60)})")
    return InputError(
        f"all {len(search.probes)} tried values of {search.parameter!r} from "
        f"{_span(search)} satisfy the requirement on {_traces(search)}; the minimum robustness is "
        f"{' and '.join(shown)}; give a wider range"
    )


def _traces(search: _Bisection) -> str:
    return "the trace" if len(search.names) == 1 else f"all {len(search.names)} traces"


def _span(search: _Bisection) -> str:
    low, high = (text_of(search.values.at(position)) for position in (0, search.values.last))
    return f"{low} to {high}"
