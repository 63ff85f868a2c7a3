"""The inputs of one simulation: a `Case` of numbers and waveforms.

To add an interpolation of waveforms: its name in `WaveformInterpolation`, a row of `LEAST_POINTS`
and a row of `_PIECES`. `Waveform.from_steps` alone decides which value a step gets.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from numbers import Real
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError, InputTypeError
from rtamt.renamed import OldName
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import exact

WaveformInterpolation = Literal["hold", "linear", "pchip"]
"""How a waveform continues after a control point: it holds the value, or follows a straight line or
a monotone cubic to the next point."""

LEAST_POINTS: Final[Mapping[str, int]] = {"hold": 1, "linear": 2, "pchip": 2}
"""The minimum number of control points of an interpolation."""

Floats = NDArray[np.float64]


class _Piece(NamedTuple):
    """A cubic piece of a waveform from one control point to the next.

    Its value at the share x of its length is ``start + x (c1 + x (c2 + x c3))``, clipped to low and
    high because of rounding.
    """

    length: float
    start: float
    c1: float = 0.0
    c2: float = 0.0
    c3: float = 0.0
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True)
class Waveform:
    """A function of time through control points; constant before the first and after the last.

    A time that is a float stands for the nearest simple fraction, as periods do: 0.1 + 0.2 is 0.3.

    Attributes:
        times: The times of the control points, in seconds, increasing.
        values: The values at these times, in the unit of the input.
        interpolation: ``"hold"``: a value holds until the next time; ``"linear"``: straight lines
            join the points; ``"pchip"``: cubics join them, with continuous slopes and monotone
            between neighbouring points, so that no value is outside the range of ``values``.

    Raises:
        InputError: If the numbers of times and values differ, the times do not increase, a number
            is not finite, or there are too few points: ``"linear"`` and ``"pchip"`` need two.
        InputTypeError: If times or values are not numbers.

    Example:
        >>> ramp = Waveform([0, 10], [0, 50], "linear")
        >>> ramp(2.5), ramp(99), ramp.at([0, 5])
        (12.5, 50.0, array([ 0., 25.]))
        >>> steps = Waveform([0, 5], [1, 2])
        >>> steps(4.999), steps(5)
        (1.0, 2.0)

    Source: F. N. Fritsch, J. Butland: A method for constructing local monotone piecewise cubic
    interpolants, SIAM J. Sci. Stat. Comput. 5(2), 1984; for the slopes at both ends C. Moler:
    Numerical Computing with MATLAB, SIAM 2004, section 3.6.
    """

    times: Sequence[float]
    values: Sequence[float]
    interpolation: WaveformInterpolation = "hold"
    _pieces: tuple[_Piece, ...] = field(init=False, repr=False, compare=False)

    of_steps = OldName("from_steps")

    def __post_init__(self) -> None:
        check_choice("interpolation", self.interpolation, get_args(WaveformInterpolation))
        times = tuple(float(exact(time)) for time in _numbers("times", self.times))
        values = tuple(value + 0.0 for value in _numbers("values", self.values))  # no -0.0
        if len(times) != len(values):
            raise InputError(
                f"expected as many values as times, got {len(values)} and {len(times)}"
            )
        least = LEAST_POINTS[self.interpolation]
        if len(times) < least:
            raise InputError(
                f"expected {least} or more control points with "
                f"interpolation={self.interpolation!r}, got {len(times)}"
            )
        for before, after in pairwise(times):
            if before >= after:
                raise InputError(f"expected times that increase, got {before:g} and then {after:g}")
        pieces = (*_PIECES[self.interpolation](times, values), _Piece(1.0, values[-1]))
        if not all(math.isfinite(number) for piece in pieces for number in piece[:5]):
            raise InputError("expected values with finite differences")
        for name, value in (("times", times), ("values", values), ("_pieces", pieces)):
            object.__setattr__(self, name, value)  # the class is frozen

    def __call__(self, time: float) -> float:
        """Return the value at a time in seconds."""
        times = self.times
        time = min(max(time, times[0]), times[-1])
        index = bisect_right(times, time) - 1
        length, start, c1, c2, c3, low, high = self._pieces[index]
        x = (time - times[index]) / length
        return min(max(start + x * (c1 + x * (c2 + x * c3)), low), high)

    def at(self, times: ArrayLike) -> Floats:
        """Return the values at times in seconds, in an array of their shape, equal to calls."""
        knots = np.asarray(self.times)
        clipped = np.clip(np.asarray(times, np.float64), knots[0], knots[-1])
        index = knots.searchsorted(clipped, "right") - 1
        length, start, c1, c2, c3, low, high = np.array(self._pieces).T[:, index]
        x = (clipped - knots[index]) / length
        values: Floats = np.clip(start + x * (c1 + x * (c2 + x * c3)), low, high)
        return values

    def from_steps(self, period: float | Fraction, count: int) -> Floats:
        """Return the values for the first ``count`` steps of a simulation, shape ``(count,)``.

        Step i runs from ``i * period`` to ``(i + 1) * period``. With ``"hold"`` it gets the value
        at its start, with ``"linear"`` and ``"pchip"`` the value at its end.

        Example:
            >>> Waveform([0, 1], [0, 8], "linear").from_steps(0.25, 4)
            array([2., 4., 6., 8.])
            >>> Waveform([0, 0.5], [0, 8]).from_steps(0.25, 4)
            array([0., 0., 8., 8.])
        """
        period = exact(period)
        if period.numerator * (count + 1) >= 2**53:  # beyond, an array would round the product
            step = self.stepper(period)
            return np.array([step(i) for i in range(count)])
        return self.at(_instants(period, self._lead, count))

    def stepper(self, period: float | Fraction) -> Callable[[int], float]:
        """Return the function from the index of a step to its value, as `from_steps` defines it."""
        numerator, denominator = exact(period).as_integer_ratio()
        lead = self._lead
        # A quotient of whole numbers is the nearest float, so that the start of a step never misses
        # the time of a control point by rounding.
        return lambda step: self((step + lead) * numerator / denominator)

    @property
    def _lead(self) -> int:
        """Return how many steps after its start a step reads the waveform."""
        return 0 if self.interpolation == "hold" else 1


@lru_cache(maxsize=32)
def _instants(period: Fraction, lead: int, count: int) -> Floats:
    """Return the times at which the first steps read; the environments of a batch share them."""
    times: Floats = np.arange(lead, count + lead) * period.numerator / period.denominator
    times.setflags(write=False)
    return times


def _numbers(name: str, values: object) -> list[float]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputTypeError(f"expected {name} as several numbers, got {values!r}")
    numbers = []
    for value in values:
        if isinstance(value, bool) or not isinstance(value, Real):
            raise InputTypeError(f"expected {name} as numbers, got {value!r} among them")
        if not math.isfinite(value):
            raise InputError(f"expected {name} as finite numbers, got {float(value)!r} among them")
        numbers.append(float(value))
    return numbers


_Points = Sequence[float]


def _hold(times: _Points, values: _Points) -> list[_Piece]:
    return [
        _Piece(after - before, value)
        for (before, after), value in zip(pairwise(times), values, strict=False)
    ]


def _linear(times: _Points, values: _Points) -> list[_Piece]:
    return [
        _Piece(after - before, a, b - a, low=min(a, b), high=max(a, b))
        for (before, after), (a, b) in zip(pairwise(times), pairwise(values), strict=True)
    ]


def _pchip(times: _Points, values: _Points) -> list[_Piece]:
    lengths = [after - before for before, after in pairwise(times)]
    chords = [(b - a) / h for (a, b), h in zip(pairwise(values), lengths, strict=True)]
    parts = list(zip(lengths, chords, strict=True))
    inner = [_slope(*left, *right) for left, right in pairwise(parts)]
    if len(parts) == 1:
        first = last = chords[0]
    else:
        first = _end_slope(*parts[0], *parts[1])
        last = _end_slope(*parts[-1], *parts[-2])
    pieces = []
    slopes = pairwise([first, *inner, last])
    for (a, b), h, (left, right) in zip(pairwise(values), lengths, slopes, strict=True):
        rise, c1, end = b - a, h * left, h * right
        cubic = c1, 3 * rise - 2 * c1 - end, c1 + end - 2 * rise
        pieces.append(_Piece(h, a, *cubic, min(a, b), max(a, b)))
    return pieces


def _slope(h1: float, chord1: float, h2: float, chord2: float) -> float:
    """Return the slope between two pieces: a harmonic mean of the chords, 0 at a turning point."""
    if chord1 == 0 or chord2 == 0 or (chord1 < 0) != (chord2 < 0):
        return 0.0
    w1, w2 = 2 * h2 + h1, h2 + 2 * h1
    return (w1 + w2) / (w1 / chord1 + w2 / chord2)


def _end_slope(h1: float, chord1: float, h2: float, chord2: float) -> float:
    """Return the slope of a parabola through three points at its end, limited to be monotone."""
    slope = ((2 * h1 + h2) * chord1 - h1 * chord2) / (h1 + h2)
    if chord1 == 0 or slope == 0 or (slope < 0) != (chord1 < 0):
        return 0.0
    if (chord1 < 0) != (chord2 < 0) and abs(slope) > 3 * abs(chord1):
        return 3 * chord1
    return slope


_PIECES: dict[str, Callable[[Any, Any], list[_Piece]]] = {
    "hold": _hold,
    "linear": _linear,
    "pchip": _pchip,
}
"""The function of each interpolation that makes its pieces from times and values."""


class Case(Mapping[str, float | Waveform]):
    """The inputs of one simulation: a number or a waveform for each name; immutable.

    Args:
        entries: Numbers, which may be infinite, and waveforms by name.

    Raises:
        InputError: If a number is nan.
        InputTypeError: If a name is not a text, or an entry is neither a number nor a `Waveform`.

    Example:
        >>> case = Case({"mass": 1.5, "throttle": Waveform([0, 5], [80, 20])})
        >>> case["mass"], case["throttle"](7.0)
        (1.5, 20.0)
        >>> case.columns()
        {'mass': 1.5, 'throttle[0]': 80.0, 'throttle[1]': 20.0}
        >>> Case.from_json(case.to_json()) == case
        True
    """

    __slots__ = ("_entries",)

    def __init__(self, entries: Mapping[str, float | Waveform]) -> None:
        if not isinstance(entries, Mapping):
            way_out = "; space.case(point) gives one" if hasattr(entries, "case") else ""
            raise InputTypeError(
                f'expected a case as a mapping such as {{"mass": 1.5}}, got {entries!r}{way_out}'
            )
        self._entries = {_name(name): _entry(name, value) for name, value in entries.items()}

    def __getitem__(self, name: str) -> float | Waveform:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __hash__(self) -> int:
        return hash(frozenset(self._entries.items()))

    def __repr__(self) -> str:
        return f"Case({self._entries!r})"

    def columns(self) -> dict[str, float]:
        """Return the case as a row of a table: its numbers, and the values at its control points.

        The columns have the same names as in the `Space` of the case.
        """
        columns: dict[str, float] = {}
        for name, entry in self._entries.items():
            if isinstance(entry, Waveform):
                columns |= {f"{name}[{i}]": value for i, value in enumerate(entry.values)}
            else:
                columns[name] = entry
        return columns

    def to_json(self) -> str:
        """Return the case as JSON; infinite numbers are the texts ``"inf"`` and ``"-inf"``."""
        return json.dumps({name: _written(value) for name, value in self._entries.items()})

    @classmethod
    def from_json(cls, text: str) -> Case:
        """Read the output of `to_json`.

        Raises:
            InputError: If the text is not JSON, or not a case.
            InputTypeError: If it is not a text, or an entry has a wrong type.
        """
        if not isinstance(text, str):
            raise InputTypeError(f"expected a case as text in JSON, got {text!r}")
        try:
            entries = json.loads(text)
        except json.JSONDecodeError as error:
            raise InputError(f"expected a case in JSON, got {text!r}: {error}") from error
        if not isinstance(entries, dict):
            raise InputError(f'expected a case in JSON such as {{"mass": 1.5}}, got {text!r}')
        return cls({name: _read(name, value) for name, value in entries.items()})


_WAVEFORM = ("times", "values", "interpolation")
"""The keys of a waveform in JSON."""


def _name(name: object) -> str:
    if not isinstance(name, str) or not name:
        raise InputTypeError(f"expected the names of a case as texts, got {name!r}")
    return name


def _entry(name: str, value: object) -> float | Waveform:
    if isinstance(value, Waveform):
        return value
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputTypeError(
            f"expected {name!r} of a case as a number or a waveform such as "
            f"Waveform([0, 5], [1, 2]), got {value!r}"
        )
    if math.isnan(value):
        raise InputError(f"expected {name!r} of a case as a number, got nan")
    return float(value)


def _written(entry: float | Waveform) -> Any:  # noqa: ANN401 - what JSON holds
    if isinstance(entry, Waveform):
        return {key: getattr(entry, key) for key in _WAVEFORM}
    return entry if math.isfinite(entry) else repr(entry)


def _read(name: str, value: Any) -> Any:  # noqa: ANN401 - what JSON holds
    if value in ("inf", "-inf"):
        return float(value)
    if not isinstance(value, dict):
        return value
    if set(value) != set(_WAVEFORM):
        raise InputError(
            f"expected {name!r} in JSON with {listing(_WAVEFORM)}, got {listing(value)}"
        )
    return Waveform(**value)
