"""Selectors checked against the spaces of an environment: one number, and in range."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NoReturn, cast

from gymnasium import spaces

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.signals.signals import ParsedSignal

__all__ = ["described", "fit"]

AnySpace = spaces.Space[Any]


def fit(signal: ParsedSignal, space: AnySpace, what: str) -> tuple[Any, ...]:
    """Turns the path of a selector into the indices of one number in the values of a space.

    Args:
        signal: Has the selector.
        space: What the values are elements of.
        what: The space's name, for messages.

    Raises:
        InputError: If there is no such number.
    """
    refuse = partial(_refuse, signal, space, what)
    fitted: list[Any] = []
    path = list(signal.path)
    while path and isinstance(space, spaces.Dict | spaces.Tuple):
        part = path.pop(0)
        fitted.append(part)
        if isinstance(space, spaces.Tuple):
            _check_range(part, len(space.spaces), refuse)
        elif part not in space.spaces:
            refuse(f"has no key {part!r}", nearest(part, space.spaces))
        space = cast("Any", space.spaces)[part]
    if not isinstance(
        space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    ):
        refuse("has no number there")
    shape = space.shape or ()
    if len(path) != len(shape):
        refuse(f"needs {_count(len(shape), 'index')} there")
    for part, size in zip(path, shape, strict=True):
        _check_range(part, size, refuse)
    if path:
        fitted.append(path[0] if len(path) == 1 else tuple(path))
    return tuple(fitted)


def _check_range(part: int | str, size: int, refuse: Callable[[str], NoReturn]) -> None:
    if isinstance(part, str):
        refuse(f"has no key {part!r}")
    if not -size <= part < size:
        refuse(f"has {_count(size, 'element')} there, 0 to {size - 1}")


def _refuse(
    signal: ParsedSignal, space: AnySpace, what: str, reason: str, way_out: str = ""
) -> NoReturn:
    raise InputError(
        f"signal {signal.name!r}: {signal} does not fit: {what} {reason}; it is "
        f"{described(space)}{way_out}"
    )


def _count(number: int, noun: str) -> str:
    plural = {"index": "indices", "element": "elements"}[noun]
    return f"{number or 'no'} {noun if number == 1 else plural}"


def described(space: AnySpace) -> str:
    """Describes a space without its bounds, which fill a page for a robot."""
    match space:
        case spaces.Dict():
            inner = ", ".join(f"{key!r}: {described(part)}" for key, part in space.spaces.items())
            return f"Dict({inner})"
        case spaces.Tuple():
            return f"Tuple({', '.join(described(part) for part in space.spaces)})"
        case spaces.Box():
            return f"Box(shape={space.shape}, dtype={space.dtype})"
        case _:
            return str(space)
