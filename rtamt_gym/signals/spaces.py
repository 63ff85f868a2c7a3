"""Checks that a selector reads one number in the spaces of an environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn, cast

from gymnasium import spaces

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.signals.signals import ParsedSignal

AnySpace = spaces.Space[Any]


def fit(signal: ParsedSignal, space: AnySpace, name: str) -> tuple[Any, ...]:
    """Return the indices of the selector's number in the values of a space.

    Args:
        signal: A signal with a selector.
        space: The space of the values.
        name: The name of the space, for messages.

    Raises:
        InputError: If the selector does not read a number of the space.
    """

    def refuse(reason: str, hint: str = "") -> NoReturn:
        raise InputError(
            f"signal {signal.name!r}: {signal} does not fit: {name} {reason}; it is "
            f"{described(space)}{hint}"
        )

    inner, fitted, path = space, list[Any](), list(signal.path)
    while path and isinstance(inner, spaces.Dict | spaces.Tuple):
        part = path.pop(0)
        fitted.append(part)
        if isinstance(inner, spaces.Tuple):
            _check_range(part, len(inner.spaces), refuse)
        elif part not in inner.spaces:
            refuse(f"has no key {part!r}", nearest(part, inner.spaces))
        inner = cast("Any", inner.spaces)[part]
    numeric = spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    if not isinstance(inner, numeric):
        refuse("has no number there")
    shape = inner.shape or ()
    if len(path) != len(shape):
        refuse(f"needs {len(shape) or 'no'} {'index' if len(shape) == 1 else 'indices'} there")
    for part, size in zip(path, shape, strict=True):
        _check_range(part, size, refuse)
    if path:
        fitted.append(path[0] if len(path) == 1 else tuple(path))
    return tuple(fitted)


def _check_range(part: int | str, size: int, refuse: Callable[[str], NoReturn]) -> None:
    if isinstance(part, str):
        refuse(f"has no key {part!r}")
    if not -size <= part < size:
        count = f"{size or 'no'} element{'' if size == 1 else 's'}"
        refuse(f"has {count} there, 0 to {size - 1}")


def described(space: AnySpace) -> str:
    """Describe a space without its bounds, which would fill a page for a robot."""
    match space:
        case spaces.Dict():
            inner = ", ".join(f"{key!r}: {described(part)}" for key, part in space.spaces.items())
            return f"Dict({inner})"
        case spaces.Tuple():
            return f"Tuple({', '.join(described(part) for part in space.spaces)})"
        case spaces.Box():
            return f"Box(shape={space.shape}, dtype={space.dtype})"
    return str(space)
