"""Numbers and arrays of a caller, of any library, as doubles."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, InputTypeError, brief

__all__ = ["Floats", "array_of_numbers", "kind_of", "line_of_numbers", "number"]

Floats = NDArray[np.float64]


def array_of_numbers(values: object, what: str) -> Floats:
    """The values as an array of doubles, not copied if they are one; a masked value is nan.

    Raises:
        InputTypeError: On values that are not real numbers.
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        array = _array(values)
    except ValueError as ragged:
        raise InputTypeError(
            f"expected an array of numbers for {what}, got {kind_of(values)}"
        ) from ragged
    if array.dtype.kind not in "biuf" and array.size:
        kind = array.dtype if isinstance(values, np.ndarray | list | tuple) else kind_of(values)
        raise InputTypeError(f"expected an array of numbers for {what}, got {kind}")
    return array.astype(np.float64, copy=False)


def _array(values: object) -> NDArray[Any]:
    """The values as an array; a missing number of pandas is nan, as it is of polars and Arrow."""
    if hasattr(values, "to_numpy") and hasattr(getattr(values, "dtype", None), "na_value"):
        series = cast("Any", values)
        if series.dtype.kind in "biuf":
            return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan))
    return np.asarray(values)


def line_of_numbers(values: object, what: str) -> Floats:
    """The values as a contiguous 1-D array of doubles.

    Raises:
        InputError: On another shape.
        InputTypeError: On values that are not real numbers.
    """
    line = array_of_numbers(values, what)
    if line.ndim != 1:
        raise InputError(f"expected a 1-D array for {what}, got shape {line.shape}")
    return np.ascontiguousarray(line)


def number(value: object) -> float | None:
    """The value as a double; None if it is not a real number."""
    if type(value) is float:
        return value
    if isinstance(value, str | bytes | complex | np.complexfloating):
        return None
    try:
        return float(value) if hasattr(value, "__float__") else None
    except (TypeError, ValueError, OverflowError):  # such as an array of several values
        return None


def kind_of(value: object) -> str:
    """Type and beginning of a value in one line, for errors."""
    return f"{type(value).__name__} {brief(value, 40)}"
