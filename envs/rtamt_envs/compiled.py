"""`compiled`: compiles the functions of a model where numba is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

__all__ = ["compiled"]

_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """Compiles a function with numba, and keeps the machine code beside its file.

    Without numba (the extra ``cases``), or with ``NUMBA_DISABLE_JIT=1``, the function is left as it
    is: the same numbers, bit for bit, some hundred times as slowly.
    """
    try:
        from numba import njit
    except ModuleNotFoundError:
        return function
    return cast("_F", njit(cache=True)(function))
