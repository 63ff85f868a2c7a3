"""The inputs of a system with their ranges, and the space of cases that a search chooses from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from numbers import Real
from typing import Any, Union, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import LEAST_POINTS, Case, Waveform, WaveformInterpolation


class Entry:
    """The range of an input for a search: a `Signal` or a `Parameter`."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Signal(Entry):
    """An input over time: a waveform with control points between two values.

    The control points divide the duration evenly. With ``"hold"``, each starts a piece of constant
    value; with ``"linear"`` and ``"pchip"``, the first is at time 0 and the last at the end.

    Attributes:
        name: The name of the input: an action of an environment, an input of an FMU, ``ctrl[0]`` of
            a MuJoCo model, a keyword argument of a function.
        low: The minimum value.
        high: The maximum value.
        points: The number of control points.
        interpolation: ``"hold"`` (default), ``"linear"``, or ``"pchip"``, a cubic that is monotone
            between the points, so that it stays between ``low`` and ``high``.
        duration: Seconds from the first control point to the end; then the last value holds. None:
            the duration of the space of the signal.

    Raises:
        InputError: If ``low`` or ``high`` is not finite, ``low`` is above ``high``, or there are
            too few control points: ``"linear"`` and ``"pchip"`` need two.
        InputTypeError: If an argument has a wrong type.

    Example:
        >>> Signal("throttle", 0, 100, points=7).columns
        ('throttle[0]', 'throttle[1]', 'throttle[2]', 'throttle[3]', 'throttle[4]', 'throttle[5]', \
'throttle[6]')
    """

    name: str
    low: float
    high: float
    _: KW_ONLY
    points: int
    interpolation: WaveformInterpolation = "hold"
    duration: float | None = None

    def __post_init__(self) -> None:
        _check_name("signal", self.name)
        phrase = f"signal {self.name!r}"
        _set_range(self, phrase, self.low, self.high)
        _check_points(phrase, self.points, self.interpolation)
        if self.duration is not None:
            _set(self, "duration", check_number("duration", self.duration))

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the control points."""
        return tuple(f"{self.name}[{i}]" for i in range(self.points))


@dataclass(frozen=True, slots=True)
class Parameter(Entry):
    """A number that is constant in a simulation: a constant, an initial state, a fault time.

    Attributes:
        name: The name of the number: a parameter of a scenario or an FMU, ``qpos[0]`` of a MuJoCo
            model, an attribute ``env.gravity``, a keyword argument of a function.
        low: The minimum value; with ``values`` their minimum.
        high: The maximum value; with ``values`` their maximum.
        default: The value without a choice; it may be outside the range, such as a fault time of
            ``math.inf``, which means never. None: the system's own value.
        values: The values to choose from, in place of ``low`` and ``high``.
        log: Whether a search spreads the logarithm of the number evenly.
        unit: The unit, for tables and pictures.
        about: A description in a few words.

    Raises:
        InputError: If ``low`` or ``high`` is not finite, ``low`` is above ``high``, ``values`` is
            empty or repeats a value, both or neither are passed, or ``log`` is used with ``values``
            or a ``low`` that is not above 0.
        InputTypeError: If an argument has a wrong type.

    Example:
        >>> Parameter("mass", 1, 2).columns
        ('mass',)
        >>> Parameter("gear", values=(1, 2, 3)).high
        3.0
    """

    name: str
    low: float = math.nan
    high: float = math.nan
    _: KW_ONLY
    default: float | None = None
    values: Sequence[float] | None = None
    log: bool = False
    unit: str = ""
    about: str = ""

    def __post_init__(self) -> None:
        _check_name("parameter", self.name)
        phrase = f"parameter {self.name!r}"
        if self.default is not None:
            _set(self, "default", _number(phrase, "default", self.default))
        if self.values is None:
            if math.isnan(_real(phrase, "low", self.low)) and math.isnan(
                _real(phrase, "high", self.high)
            ):
                raise InputError(
                    f"{phrase}: expected low and high, or values=, got neither; "
                    f"write Parameter({self.name!r}, 0, 1)"
                )
            _set_range(self, phrase, self.low, self.high)
            if self.log and self.low <= 0:
                raise InputError(f"{phrase}: expected low= above 0 with log=True, got {self.low:g}")
            return
        if self.log:
            raise InputError(f"{phrase}: log=True is for low and high, got values= as well")
        values = _values(phrase, self.values)
        passed, ends = (self.low, self.high), (min(values), max(values))
        if not all(math.isnan(_real(phrase, "low and high", value)) for value in passed) and (
            passed != ends  # dataclasses.replace passes the ends that were computed before
        ):
            raise InputError(f"{phrase}: expected low and high, or values=, got both")
        _set(self, "values", values)
        _set(self, "low", ends[0])
        _set(self, "high", ends[1])

    @property
    def columns(self) -> tuple[str, ...]:
        """The name, because one number describes a parameter."""
        return (self.name,)


def _check_points(owner: str, points: object, interpolation: object) -> None:
    """Raise an error if the number of control points is not a whole number, or too small."""
    check_choice("interpolation", interpolation, get_args(WaveformInterpolation))
    least = LEAST_POINTS[str(interpolation)]
    if isinstance(points, bool) or not isinstance(points, int):
        raise InputTypeError(f"{owner}: expected points= as a whole number, got {points!r}")
    if points < least:
        raise InputError(
            f"{owner}: expected points={least} or more with interpolation={interpolation!r}, "
            f"got {points}"
        )


def _check_name(kind: str, name: object) -> None:
    if not isinstance(name, str) or not name:
        raise InputTypeError(f"expected the name of a {kind}, a text, got {name!r}")


def _set(entry: object, field: str, value: object) -> None:
    object.__setattr__(entry, field, value)  # the class is frozen


def _set_range(entry: Signal | Parameter, owner: str, low: object, high: object) -> None:
    """Turn low and high into floats; raise InputError if they are not a range."""
    least, most = _real(owner, "low", low), _real(owner, "high", high)
    for name, value in (("low", least), ("high", most)):
        if not math.isfinite(value):
            raise InputError(f"{owner}: expected {name}= as a finite number, got {value!r}")
    if least > most:
        raise InputError(
            f"{owner}: expected low= at most high=, got {least:g} and {most:g}; swap them"
        )
    if not math.isfinite(most - least):
        raise InputError(f"{owner}: the range from {least:g} to {most:g} is too wide for a float")
    _set(entry, "low", least)
    _set(entry, "high", most)


def _real(owner: str, name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputTypeError(f"{owner}: expected {name}= as a number, got {value!r}")
    return float(value)


def _number(owner: str, name: str, value: object) -> float:
    """Return a number that may be infinite."""
    number = _real(owner, name, value)
    if math.isnan(number):
        raise InputError(f"{owner}: expected {name}= as a number, got nan")
    return number


def _values(owner: str, values: Any) -> tuple[float, ...]:  # noqa: ANN401 - checked here
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputTypeError(f"{owner}: expected values= as several numbers, got {values!r}")
    numbers = tuple(_number(owner, "values", value) for value in values)
    if not numbers:
        raise InputError(f"{owner}: expected at least one value in values=, got none")
    for number in numbers:
        if numbers.count(number) > 1:
            raise InputError(f"{owner}: expected different values=, got {number:g} twice")
    return numbers


SpaceLike = Union["Space", Mapping[str, Entry], Sequence[Entry]]
"""A `Space`, or its signals and parameters in a sequence or by name."""


class Space:
    """The cases that a search chooses from: one for each point of a unit cube.

    Each control point of a signal and each parameter is a coordinate. From 0 to 1, it runs evenly
    from low to high, or over the logarithms for a parameter with ``log``. Each of several values
    has an interval of the same length.

    Args:
        entries: The signals and parameters, or a mapping from their names to them.
        duration: The duration of signals without their own, in seconds.

    Attributes:
        entries: The signals and parameters, by name.
        duration: The duration of signals without their own, or None.
        columns: The names of the coordinates, in order.

    Raises:
        InputError: If two entries have the same name, or a mapping gives an entry another name.
        InputTypeError: If an entry is neither a `Signal` nor a `Parameter`.

    Example:
        >>> space = Space(
        ...     [Signal("throttle", 0, 100, points=2), Parameter("mass", 1, 2)], duration=10
        ... )
        >>> space.dimension, space.columns
        (3, ('throttle[0]', 'throttle[1]', 'mass'))
        >>> case = space.case([1, 0.25, 0.5])
        >>> case.columns()
        {'throttle[0]': 100.0, 'throttle[1]': 25.0, 'mass': 1.5}
        >>> case["throttle"].times
        (0.0, 5.0)
        >>> space.point(case)
        array([1.  , 0.25, 0.5 ])
    """

    def __init__(self, entries: SpaceLike, *, duration: float | None = None) -> None:
        self.duration = None if duration is None else check_number("duration", duration)
        self.entries: Mapping[str, Signal | Parameter] = _by_name(entries)
        self.columns = tuple(column for entry in self.entries.values() for column in entry.columns)
        for column in self.columns:
            if self.columns.count(column) > 1:
                raise InputError(f"expected columns of different names, got {column!r} twice")

    def __iter__(self) -> Iterator[Signal | Parameter]:
        return iter(self.entries.values())

    def __len__(self) -> int:
        return len(self.entries)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Space):
            return NotImplemented
        return (list(self), self.duration) == (list(other), other.duration)

    def __hash__(self) -> int:
        return hash((tuple(self), self.duration))

    def __repr__(self) -> str:
        duration = "" if self.duration is None else f", duration={self.duration!r}"
        return f"Space({list(self)!r}{duration})"

    @property
    def dimension(self) -> int:
        """The number of coordinates."""
        return len(self.columns)

    def case(self, point: ArrayLike) -> Case:
        """Return the case of a point of the unit cube, an array of shape (dimension,).

        Raises:
            InputError: If the point is outside the unit cube, or a signal has no duration.
            InputTypeError: If the point does not consist of numbers.
        """
        left = iter(self._checked(point).tolist())
        case: dict[str, float | Waveform] = {}
        for entry in self.entries.values():
            if isinstance(entry, Signal):
                values = [_between(entry, next(left)) for _ in range(entry.points)]
                case[entry.name] = Waveform(self._times(entry), values, entry.interpolation)
            else:
                case[entry.name] = _number_at(entry, next(left))
        return Case(case)

    def point(self, case: Mapping[str, float | Waveform]) -> NDArray[np.float64]:
        """Return the point of a case, up to rounding; of several values, an interval middle.

        Raises:
            InputError: If the case has other names than the space, a number out of its range, or a
                waveform with other control points.
        """
        for name in [*self.entries, *case]:
            if name not in case or name not in self.entries:
                raise InputError(f"expected a case of {listing(self.entries)}, got {listing(case)}")
        point = [
            coordinate
            for entry in self.entries.values()
            for coordinate in self._coordinates(entry, case[entry.name])
        ]
        return np.array(point)

    def _checked(self, point: ArrayLike) -> NDArray[np.float64]:
        try:
            numbers = np.asarray(point, np.float64)
        except (TypeError, ValueError):
            raise InputTypeError(
                f"expected a point as {self.dimension} numbers, got {point!r}"
            ) from None
        if numbers.shape != (self.dimension,):
            raise InputError(
                f"expected a point of shape ({self.dimension},), got shape {numbers.shape}"
            )
        for column, number in zip(self.columns, numbers, strict=True):
            if not 0 <= number <= 1:
                raise InputError(f"expected {column!r} of a point from 0 to 1, got {number:g}")
        return numbers

    def _coordinates(self, entry: Signal | Parameter, value: float | Waveform) -> list[float]:
        if not isinstance(entry, Signal):
            if isinstance(value, Waveform):
                raise InputError(f"expected {entry.name!r} of a case as a number, got {value!r}")
            return [_coordinate(entry, value)]
        times = self._times(entry)
        if not isinstance(value, Waveform) or (
            (value.times, value.interpolation) != (times, entry.interpolation)
        ):
            raise InputError(
                f"expected {entry.name!r} of a case as a waveform of interpolation "
                f"{entry.interpolation!r} and times {times}, got {value!r}"
            )
        return [_share(entry, number) for number in value.values]

    def _times(self, signal: Signal) -> tuple[float, ...]:
        """Return the times of the control points of a signal."""
        duration = signal.duration or self.duration
        if duration is None:
            raise InputError(
                f"signal {signal.name!r} has no duration; ",
                Argument(
                    "duration",
                    words=f"write Signal({signal.name!r}, ..., duration=30) or "
                    "Space(..., duration=30), in seconds",
                ),
            )
        parts = signal.points if signal.interpolation == "hold" else signal.points - 1
        return _evenly(duration, parts, signal.points)


@lru_cache(maxsize=32)
def _evenly(duration: float, parts: int, points: int) -> tuple[float, ...]:
    """Return the first times of a duration in parts; all cases of a signal share them."""
    return tuple(float(exact(duration) * i / parts) for i in range(points))


def _by_name(entries: Any) -> dict[str, Signal | Parameter]:  # noqa: ANN401 - checked here
    if isinstance(entries, Signal | Parameter) or not isinstance(entries, Iterable):
        raise InputTypeError(
            f"expected several signals and parameters, such as [Parameter('mass', 1, 2)], got "
            f"{entries!r}"
        )
    named = (
        entries.items() if isinstance(entries, Mapping) else [(None, entry) for entry in entries]
    )
    result: dict[str, Signal | Parameter] = {}
    for name, entry in named:
        if not isinstance(entry, Signal | Parameter):
            raise InputTypeError(
                f"expected signals and parameters, got {entry!r} among them; write "
                "Signal('throttle', 0, 100, points=7) or Parameter('mass', 1, 2)"
            )
        if name is not None and name != entry.name:
            raise InputError(f"expected {entry.name!r} by its own name, got it as {name!r}")
        if entry.name in result:
            raise InputError(f"expected entries of different names, got {entry.name!r} twice")
        result[entry.name] = entry
    if not result:
        raise InputError("expected at least one signal or parameter, got none")
    return result


def _between(entry: Signal | Parameter, share: float) -> float:
    """Return the number at a share of the way from low to high."""
    return min(entry.low + share * (entry.high - entry.low), entry.high)


def _share(entry: Signal | Parameter, number: float) -> float:
    """Return the position of a number between low and high, from 0 to 1."""
    low, high = entry.low, entry.high
    if not low <= number <= high:
        raise InputError(
            f"expected {entry.name!r} of a case from {low:g} to {high:g}, got {number:g}"
        )
    return (number - low) / (high - low) if low < high else 0.0


def _number_at(entry: Parameter, share: float) -> float:
    """Return the number of a parameter at a coordinate."""
    if entry.values is not None:
        count = len(entry.values)
        return entry.values[min(int(share * count), count - 1)]
    if not entry.log or share in {0.0, 1.0}:  # the logarithm would round the ends
        return _between(entry, share)
    return min(max(entry.low * math.pow(entry.high / entry.low, share), entry.low), entry.high)


def _coordinate(entry: Parameter, number: float) -> float:
    """Return the coordinate of a number of a parameter."""
    if entry.values is not None:
        if number not in entry.values:
            raise InputError(
                f"expected {entry.name!r} of a case among {listing(entry.values)}, got {number:g}"
            )
        return (entry.values.index(number) + 0.5) / len(entry.values)
    share = _share(entry, number)
    if entry.log and entry.low < number < entry.high:
        return math.log(number / entry.low) / math.log(entry.high / entry.low)
    return share
