"""`compiled`: compiles the functions of a model where numba is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar, cast

_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """Compiles a function with numba when it is first called; keeps the code beside its file.

    Without numba (the extra ``cases``), or with ``NUMBA_DISABLE_JIT=1``, the function is left as it
    is: the same numbers, bit for bit, some hundred times as slowly. A division by zero gives inf or
    nan, as of numbers of NumPy: an exception would be lost where loops call the function.
    """
    try:
        from numba import njit
    except ModuleNotFoundError:
        return function
    return cast("_F", njit(cache=True, error_model="numpy")(function))


def in_loops(function: _F, kind: Literal["start", "step", "baseline"]) -> _F:
    """A function of a scenario as an argument of compiled loops, which call it by its address.

    The loops are so compiled once for all scenarios.
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
