"""Whether a formula holds, read from the sign bit of its robustness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.arrays import array_of_numbers, kind_of

__all__ = ["holds", "zero_text"]


@overload
def holds(robustness: float) -> bool: ...
@overload
def holds(robustness: NDArray[Any] | Sequence[Any]) -> NDArray[np.bool_]: ...
def holds(robustness: object) -> object:
    """Whether the formula holds, from its robustness: at 0 the sign bit says it.

    Robustness is positive where a formula holds and negative where it does not. At 0 both are
    possible: it is +0.0 where the formula holds (``x >= 3`` at 3) and -0.0 where it does not
    (``x > 3`` at 3), and no comparison tells one from the other.

    A robustness that was written down and read again must have kept its sign: ``-0.0`` in a text
    does, ``0`` in a column of integers does not. Under interface-aware semantics a predicate of no
    concern counts 0 and neither holds nor fails: there the bounds of an `EpisodeMonitor` tell.

    Args:
        robustness: A number, or an array of any shape.

    Returns:
        A bool, or an array of booleans of the same shape.

    Raises:
        InputError: On nan, which is no robustness.
        InputTypeError: On what is not a real number or an array of them.

    Example:
        >>> from rtamt import evaluate
        >>> trace = {"x": [2, 3, 4]}
        >>> evaluate("x >= 3", trace).tolist(), holds(evaluate("x >= 3", trace)).tolist()
        ([-1.0, 0.0, 1.0], [False, True, True])
        >>> evaluate("x > 3", trace).tolist(), holds(evaluate("x > 3", trace)).tolist()
        ([-1.0, -0.0, 1.0], [False, False, True])
        >>> holds(0.0), holds(-0.0)
        (True, False)
    """
    values = array_of_numbers(robustness, "the robustness")
    if np.asarray(robustness).dtype.kind == "b":
        raise InputTypeError(f"expected a robustness, got {kind_of(robustness)}")
    missing = np.isnan(values)
    if missing.any():
        where = ""
        if values.ndim:
            place = np.argwhere(missing)[0].tolist()
            where = f" at index {place[0] if len(place) == 1 else tuple(place)}"
        raise InputError(
            f"nan{where} is no robustness; a monitor gives it as long as the value is unknown: for "
            "the first `latency` samples, or before the first"
        )
    held = ~np.signbit(values)
    return held if values.ndim else bool(held)


def zero_text(*, held: bool) -> str:
    """A robustness of 0 with what its sign says."""
    return "0, holds" if held else "0, violated"
