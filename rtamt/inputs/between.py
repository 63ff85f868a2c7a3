"""Inputs that are not known, or not exactly."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError
from rtamt.inputs.arrays import Floats, array_of_numbers, number

__all__ = ["NO_BOUNDS", "UNKNOWN", "UncertainValue", "identical", "out_of_order"]

NO_BOUNDS: Final = (
    "EpisodeMonitor, VectorEpisodeMonitor and judge give bounds; a nan of others means 'not yet'"
)
"""Why the others take no input that is not known."""


class UncertainValue:
    """A value that is known only to lie between two numbers, the ends included.

    It stands where a number stands: in a sample of `EpisodeMonitor`, or, with arrays, in a column
    of `judge`. ``UncertainValue(-math.inf, math.inf)`` is a value of which nothing is known; a
    value whose ends are the same is known. -0.0 lies below 0.0.

    The robustness is then known only to lie between ``lower`` and ``upper``: whatever the values
    are inside their intervals, theirs lies inside these bounds.

    Args:
        lower: The least value, or an array of them, one for each sample.
        upper: The greatest value, or an array of the same length.

    Attributes:
        lower: The least value, or a read-only array of doubles.
        upper: The greatest value, or a read-only array of doubles.

    Raises:
        InputError: If ``lower`` is above ``upper`` somewhere, or an end is nan; on arrays of
            different shapes.
        InputTypeError: On ends that are not real numbers.

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
        least: float | Floats | None = None if hasattr(lower, "__len__") else number(lower)
        greatest: float | Floats | None = None if hasattr(upper, "__len__") else number(upper)
        if least is None or greatest is None:
            least, greatest = _arrays(lower, upper)
            _require_order(least, greatest)
        elif not least < greatest:  # the most frequent ends need no array
            _require_order(np.array(least), np.array(greatest))
        object.__setattr__(self, "lower", least)
        object.__setattr__(self, "upper", greatest)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to change an interval."""
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


Between = UncertainValue
"""The name that the C++ code imports."""

UNKNOWN: Final = UncertainValue(-math.inf, math.inf)
"""A value of which nothing is known."""


def identical(lower: Floats, upper: Floats) -> bool:
    """Whether two arrays of ends are the same to the bit, so that all values are known."""
    return bool(np.array_equal(lower.view(np.int64), upper.view(np.int64)))


def out_of_order(lower: Floats, upper: Floats) -> NDArray[np.bool_]:
    """Where a lower end is above the upper one, -0.0 below 0.0, or an end is nan."""
    zeros = (lower == upper) & ~np.signbit(lower) & np.signbit(upper)
    wrong: NDArray[np.bool_] = ~(lower <= upper) | zeros
    return wrong


def _arrays(lower: object, upper: object) -> tuple[Floats, Floats]:
    """The ends as arrays of one shape, which nobody can write to."""
    low, high = (array_of_numbers(end, "an end of Between") for end in (lower, upper))
    if low.ndim and high.ndim and low.shape != high.shape:
        raise InputError(
            f"expected two ends of Between of one shape, got {low.shape} and {high.shape}"
        )
    low, high = (np.array(end) for end in np.broadcast_arrays(low, high))
    low.flags.writeable = high.flags.writeable = False
    return low, high


def _require_order(lower: Floats, upper: Floats) -> None:
    wrong = np.atleast_1d(out_of_order(lower, upper))
    if not wrong.any():
        return
    place = int(wrong.ravel().argmax())
    least, greatest = (float(end.ravel()[place]) for end in (lower, upper))
    where = "" if lower.ndim == 0 else f" at {', '.join(map(str, np.argwhere(wrong)[0]))}"
    expected = (
        "numbers as ends of Between, and UncertainValue(-math.inf, math.inf) of what is not known"
    )
    if least == least and greatest == greatest:  # noqa: PLR0124 - neither is nan
        expected = "a lower end of Between that is not above the upper one"
    raise InputError(f"expected {expected}, got {least!r} and {greatest!r}{where}")


def _text(end: float | Floats) -> str:
    return repr(end.tolist() if isinstance(end, np.ndarray) else end)
