"""Numbers and arrays of callers, of any library, as doubles."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, InputTypeError, brief

Floats = NDArray[np.float64]


def array_of_numbers(values: object, what: str) -> Floats:
    """Return the values as an array of doubles, copied only if needed; a masked value is nan."""
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
    """Return the values as an array; a missing number of pandas is nan, as elsewhere."""
    if hasattr(values, "to_numpy") and hasattr(getattr(values, "dtype", None), "na_value"):
        series = cast("Any", values)
        if series.dtype.kind in "biuf":
            return np.asarray(series.to_numpy(dtype=np.float64, na_value=np.nan))
    return np.asarray(values)


def line_of_numbers(values: object, what: str) -> Floats:
    """Return the values as a contiguous 1-D array of doubles."""
    line = array_of_numbers(values, what)
    if line.ndim != 1:
        raise InputError(f"expected a 1-D array for {what}, got shape {line.shape}")
    return np.ascontiguousarray(line)


def number(value: object) -> float | None:
    """Return the value as a double; None if it is not a real number."""
    if type(value) is float:
        return value
    if isinstance(value, str | bytes | complex | np.complexfloating):
        return None
    try:
        return float(value) if hasattr(value, "__float__") else None
    except (TypeError, ValueError, OverflowError):  # such as an array of several values
        return None


def kind_of(value: object) -> str:
    """Return the type and start of a value in one line, for errors."""
    return f"{type(value).__name__} {brief(value, 40)}"
