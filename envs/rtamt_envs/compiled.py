"""Compilation of the functions of a model, if numba is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar, cast

_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """Compile a function with numba at its first call; store the code next to its file.

    Without numba (the extra ``cases``), or with ``NUMBA_DISABLE_JIT=1``, the function is unchanged:
    it returns the same numbers to the last bit, some hundred times slower. A division by zero
    returns inf or nan, as in NumPy, because compiled loops would lose an exception.
    """
    try:
        from numba import njit
    except ModuleNotFoundError:
        return function
    return cast("_F", njit(cache=True, error_model="numpy")(function))


def in_loops(function: _F, kind: Literal["start", "step", "baseline"]) -> _F:
    """Return a function of a scenario as an argument of compiled loops.

    Loops call it by address, so they are compiled once for all scenarios.
    """
    if not hasattr(function, "py_func"):
        return function
    from numba import cfunc, types

    vector = types.float64[::1]
    arguments = {
        "start": (vector,) * 4,
        "step": (vector,) * 5,
        "baseline": (types.float64, *(vector,) * 3),
    }
    make = cfunc(types.void(*arguments[kind]), cache=True, error_model="numpy")
    return cast("_F", make(function.py_func))
