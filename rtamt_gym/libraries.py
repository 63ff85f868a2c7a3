"""The library that an array is of: NumPy, JAX or torch."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

__all__ = ["library_of"]


def library_of(array: Any) -> Any:  # noqa: ANN401 - of any library
    """The functions of the library that an array is of, which is loaded: `numpy` or one like it."""
    if isinstance(array, np.ndarray):
        return np
    names = getattr(array, "__array_namespace__", None)  # torch lacks it
    return sys.modules["torch"] if names is None else names()
