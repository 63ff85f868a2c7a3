"""Values that are known only within bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError
from rtamt.inputs.arrays import Floats, array_of_numbers, number

NO_BOUNDS: Final = (
    "EpisodeMonitor, VectorEpisodeMonitor and judge give bounds; a nan of others means 'not yet'"
)
"""Why other monitors refuse uncertain values."""


class UncertainValue:
    """A value that is known only to lie between two numbers, both included.

    It can replace a number in a sample of `EpisodeMonitor` or, with arrays, a column of `judge`.
    ``UncertainValue(-math.inf, math.inf)`` is completely unknown; with equal ends the value is
    known. -0.0 is smaller than 0.0. The robustness of all possible values lies between ``lower``
    and ``upper`` of the monitor.

    Args:
        lower: The smallest possible value, or an array with one per sample.
        upper: The largest possible value, or an array of the same shape.

    Attributes:
        lower: The smallest possible value, or a read-only array of doubles.
        upper: The largest possible value, or a read-only array of doubles.

    Raises:
        InputError: If a ``lower`` is above its ``upper``, an end is nan, or the shapes differ.
        InputTypeError: If an end is not a real number.

    Example:
        >>> from rtamt import EpisodeMonitor, UncertainValue, judge
        >>> e = EpisodeMonitor("always(x > 1)")
        >>> e.update(x=UncertainValue(3, 5)), e.lower, e.upper, e.verdict.name
        (2.0, -inf, 4.0, 'UNDECIDED')
        >>> e.finish(), e.lower, e.upper, e.verdict.name
        (2.0, 2.0, 4.0, 'SATISFIED')
        >>> judge(
        ...     "always(x > 1)", {"x": UncertainValue([3, 0], [5, 4])}, end="complete"
        ... ).verdict.name
        'UNDECIDED'
    """

    __slots__ = ("lower", "upper")

    lower: float | Floats
    upper: float | Floats

    def __init__(self, lower: float | ArrayLike, upper: float | ArrayLike) -> None:
        low: float | Floats | None = None if hasattr(lower, "__len__") else number(lower)
        high: float | Floats | None = None if hasattr(upper, "__len__") else number(upper)
        if low is None or high is None:
            low, high = _arrays(lower, upper)
            _require_order(low, high)
        elif not low < high:  # the most frequent ends need no array
            _require_order(np.array(low), np.array(high))
        object.__setattr__(self, "lower", low)
        object.__setattr__(self, "upper", high)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to change a value."""
        raise AttributeError(f"an interval does not change, and '{name}' cannot be set")

    def __reduce__(self) -> tuple[type[UncertainValue], tuple[object, object]]:
        return UncertainValue, (self.lower, self.upper)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, UncertainValue):
            return NotImplemented
        return np.array_equal(self.lower, other.lower) and np.array_equal(self.upper, other.upper)

    def __hash__(self) -> int:
        return hash((np.asarray(self.lower).tobytes(), np.asarray(self.upper).tobytes()))

    def __repr__(self) -> str:
        return f"UncertainValue({_text(self.lower)}, {_text(self.upper)})"


UNKNOWN: Final = UncertainValue(-math.inf, math.inf)
"""A completely unknown value."""


def halves(named: Mapping[str, object]) -> list[Mapping[str, object]]:
    """Return columns with the smallest and the largest values; one mapping if all are known."""
    if not any(isinstance(values, UncertainValue) for values in named.values()):
        return [named]
    return [
        {n: getattr(v, end) if isinstance(v, UncertainValue) else v for n, v in named.items()}
        for end in ("lower", "upper")
    ]


def identical(lower: Floats, upper: Floats) -> bool:
    """Return whether two arrays are the same to the bit, so that all values are known."""
    return bool(np.array_equal(lower.view(np.int64), upper.view(np.int64)))


def out_of_order(lower: Floats, upper: Floats) -> NDArray[np.bool_]:
    """Return where a lower end is above the upper one, with -0.0 below 0.0, or an end is nan."""
    zeros = (lower == upper) & ~np.signbit(lower) & np.signbit(upper)
    wrong: NDArray[np.bool_] = ~(lower <= upper) | zeros
    return wrong


def _arrays(lower: object, upper: object) -> tuple[Floats, Floats]:
    """Return the ends as read-only arrays of one shape."""
    low, high = (array_of_numbers(end, "an end of UncertainValue") for end in (lower, upper))
    if low.ndim and high.ndim and low.shape != high.shape:
        raise InputError(
            f"expected two ends of UncertainValue of one shape, got {low.shape} and {high.shape}"
        )
    low, high = (np.array(end) for end in np.broadcast_arrays(low, high))
    low.flags.writeable = high.flags.writeable = False
    return low, high


def _require_order(lower: Floats, upper: Floats) -> None:
    wrong = np.atleast_1d(out_of_order(lower, upper))
    if not wrong.any():
        return
    index = int(wrong.ravel().argmax())
    least, greatest = (float(end.ravel()[index]) for end in (lower, upper))
    where = "" if lower.ndim == 0 else f" at {', '.join(map(str, np.argwhere(wrong)[0]))}"
    expected = (
        "numbers as ends of UncertainValue, and "
        "UncertainValue(-math.inf, math.inf) of what is not known"
    )
    if least == least and greatest == greatest:  # noqa: PLR0124 - neither is nan
        expected = "a lower end of UncertainValue that is not above the upper one"
    raise InputError(f"expected {expected}, got {least!r} and {greatest!r}{where}")


def _text(end: float | Floats) -> str:
    return repr(end.tolist() if isinstance(end, np.ndarray) else end)
