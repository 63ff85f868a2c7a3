"""The inputs of a system, each with the range that a search may choose from.

To add an interpolation of waveforms: its name in `WaveformInterpolation`, a row of `LEAST_POINTS`,
and a row of ``_PIECES`` in `rtamt_gym.inputs.waveform`. `Waveform.from_steps` alone decides which
value a step gets.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from numbers import Real
from typing import Any, Final, Literal, get_args

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.arguments import check_choice, check_number

__all__ = ["LEAST_POINTS", "Entry", "Parameter", "Signal", "WaveformInterpolation"]

WaveformInterpolation = Literal["hold", "linear", "pchip"]
"""How a waveform goes from one control point to the next: it keeps the value, or it runs along a
straight line, or along a cubic that is monotone between the points."""

LEAST_POINTS: Final[Mapping[str, int]] = {"hold": 1, "linear": 2, "pchip": 2}
"""The least number of control points of an interpolation."""


class Entry:
    """Ranges of inputs for a search: `Signal` and `Parameter`; a `Space` has several."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Signal(Entry):
    """An input over time: a waveform with control points, each anywhere between two values.

    The control points divide the duration evenly. With ``"hold"`` each begins a piece that keeps
    its value; with ``"linear"`` and ``"pchip"`` the first is at time 0 and the last at the end.

    Attributes:
        name: The name of the input: an action of an environment, an input of an FMU, ``ctrl[0]`` of
            a MuJoCo model, a keyword argument of a function.
        low: The least value.
        high: The greatest value.
        points: The number of control points.
        interpolation: ``"hold"``, ``"linear"``, or ``"pchip"``, a cubic that is monotone between
            the points, so that it stays between ``low`` and ``high``.
        duration: Seconds from the first control point to the end; afterwards the last value is
            held. None: the duration of the space that the signal is in.

    Raises:
        InputError: If ``low`` and ``high`` are not finite or in this order, or there are too few
            control points: ``"linear"`` and ``"pchip"`` need two.
        InputTypeError: If an argument is not of the types above.

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
    """A number that stays as it is over a simulation: a constant, an initial state, a fault time.

    Attributes:
        name: The name of the number: a parameter of a scenario or an FMU, ``qpos[0]`` of a MuJoCo
            model, an attribute ``env.gravity``, a keyword argument of a function.
        low: The minimum value; with ``values`` their minimum.
        high: The maximum value; with ``values`` their maximum.
        default: The value where none is chosen; it may lie outside of the range, such as a fault
            time of ``math.inf``, which means never. None: the system's own value.
        values: The values to choose from, in place of ``low`` and ``high``.
        log: Whether a search spreads the logarithm of the number evenly.
        unit: The unit, for tables and pictures.
        about: A description in a few words.

    Raises:
        InputError: If ``low`` and ``high`` are not finite or in this order, ``values`` are empty or
            repeat a value, both or neither are passed, or ``log`` comes with ``values`` or a
            ``low`` that is not above 0.
        InputTypeError: If an argument is not of the types above.

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
        given, ends = (self.low, self.high), (min(values), max(values))
        if not all(math.isnan(_real(phrase, "low and high", value)) for value in given) and (
            given != ends  # dataclasses.replace gives the ends that were computed before
        ):
            raise InputError(f"{phrase}: expected low and high, or values=, got both")
        _set(self, "values", values)
        _set(self, "low", ends[0])
        _set(self, "high", ends[1])

    @property
    def columns(self) -> tuple[str, ...]:
        """The name alone: one number describes a parameter."""
        return (self.name,)


def _check_points(what: str, points: object, interpolation: object) -> None:
    """Raise an error if the number of control points is not a whole number, or too small."""
    check_choice("interpolation", interpolation, get_args(WaveformInterpolation))
    least = LEAST_POINTS[str(interpolation)]
    if isinstance(points, bool) or not isinstance(points, int):
        raise InputTypeError(f"{what}: expected points= as a whole number, got {points!r}")
    if points < least:
        raise InputError(
            f"{what}: expected points={least} or more with interpolation={interpolation!r}, "
            f"got {points}"
        )


def _check_name(kind: str, name: object) -> None:
    if not isinstance(name, str) or not name:
        raise InputTypeError(f"expected the name of a {kind}, a text, got {name!r}")


def _set(of: object, field: str, value: object) -> None:
    object.__setattr__(of, field, value)  # it is frozen for everyone else


def _set_range(of: Signal | Parameter, what: str, low: object, high: object) -> None:
    """Turn low and high into floats; raise InputError if they are not a range."""
    least, most = _real(what, "low", low), _real(what, "high", high)
    for name, value in (("low", least), ("high", most)):
        if not math.isfinite(value):
            raise InputError(f"{what}: expected {name}= as a finite number, got {value!r}")
    if least > most:
        raise InputError(
            f"{what}: expected low= at most high=, got {least:g} and {most:g}; swap them"
        )
    if not math.isfinite(most - least):
        raise InputError(f"{what}: the range from {least:g} to {most:g} is too wide for a float")
    _set(of, "low", least)
    _set(of, "high", most)


def _real(what: str, name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputTypeError(f"{what}: expected {name}= as a number, got {value!r}")
    return float(value)


def _number(what: str, name: str, value: object) -> float:
    """A number that may be infinite."""
    number = _real(what, name, value)
    if math.isnan(number):
        raise InputError(f"{what}: expected {name}= as a number, got nan")
    return number


def _values(what: str, values: Any) -> tuple[float, ...]:  # noqa: ANN401 - checked here
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputTypeError(f"{what}: expected values= as several numbers, got {values!r}")
    numbers = tuple(_number(what, "values", value) for value in values)
    if not numbers:
        raise InputError(f"{what}: expected at least one value in values=, got none")
    for number in numbers:
        if numbers.count(number) > 1:
            raise InputError(f"{what}: expected different values=, got {number:g} twice")
    return numbers
