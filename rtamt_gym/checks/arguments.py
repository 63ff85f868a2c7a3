"""Checks of arguments."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.names import listing, nearest

__all__ = ["check_choice", "check_known", "check_length", "check_mask", "check_number"]


def check_choice(name: str, value: object, choices: Sequence[object]) -> None:
    """Refuses what is none of the choices."""
    if value not in choices:
        options = " or ".join(repr(choice) for choice in choices)
        raise InputError(f"expected {name}={options}, got {value!r}")


def check_number(name: str, value: object, high: float = math.inf) -> float:
    """The number as a float: above 0, finite, and at most ``high``."""
    if isinstance(value, Real) and 0.0 < float(value) <= high and float(value) < math.inf:
        return float(value)
    most = "" if high == math.inf else f" and at most {high:g}"
    raise InputError(f"expected {name}= as a finite number above 0{most}, got {value!r}")


def check_length(name: str, value: object) -> int:
    """Refuses a length that is not an integer of 0 or more."""
    if isinstance(value, int) and value >= 0:
        return value
    raise InputError(f"expected {name}= as an integer, 0 or more, got {value!r}")


def check_known(name: str, given: Iterable[str], known: Collection[str]) -> None:
    """Refuses a key that names no specification."""
    for key in given:
        if key not in known:
            raise InputError(
                f"{name}= names {key!r}, which is no specification; the specifications are "
                f"{listing(known)}{nearest(key, known) or '; leave it out'}"
            )


def check_mask(mask: object, num: int) -> NDArray[np.bool_]:
    """Refuses an ``options["reset_mask"]`` that is not what Gymnasium asks for."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise InputTypeError(
            f"expected options['reset_mask'] as an array of booleans, got {mask!r}"
        )
    if mask.shape != (num,) or not mask.any():
        raise InputError(
            f"expected options['reset_mask'] of shape ({num},), true for one environment or more, "
            f"got {mask!r}"
        )
    return mask
