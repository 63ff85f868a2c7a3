"""Whether the classes of messages have the fields that specifications name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rtamt import SpecificationError
from rtamt.errors import nearest

__all__ = ["check_input", "check_output"]


def check_input(message: type, of: str, variable: str, path: Iterable[str | int]) -> None:
    """Refuse a variable that a message of a class cannot have.

    What a list holds shows in messages only.

    Args:
        message: The class.
        of: Its name.
        variable: The name of the variable.
        path: Where it is in the message.

    Raises:
        SpecificationError: If a field is missing, or is no number.
    """
    try:
        value = _follow(message(), of, path)
    except SpecificationError as error:
        raise SpecificationError(f"{variable}: {error}") from None
    if value is not None and not _is_number(value):
        raise SpecificationError(
            f"expected a number as '{variable}', got a value of type "
            f"{type(value).__name__}{_fields(value)}"
        )


def check_output(message: type, of: str, path: Iterable[str]) -> None:
    """Refuse a field that cannot hold a robustness; arguments and errors as for `check_input`."""
    path = tuple(path)
    value = _follow(message(), of, path)
    if not isinstance(value, float):
        raise SpecificationError(
            f"expected a floating-point field for a robustness, got {of}.{'.'.join(path)} "
            f"of type {type(value).__name__}"
        )


def _follow(message: Any, of: str, path: Iterable[str | int]) -> object:  # noqa: ANN401
    """The value at a path of a fresh message; None from an element of a list on."""
    value, name = message, of
    for step in path:
        if isinstance(step, int):
            if not hasattr(value, "__len__") or isinstance(value, str):
                raise SpecificationError(f"{name} is no list and has no element [{step}]")
            return None
        if not hasattr(value, step):
            raise SpecificationError(
                f"{name} has no field '{step}'{nearest(step, _names(value)) or _fields(value)}"
            )
        value, name = getattr(value, step), f"{name}.{step}"
    return value


def _is_number(value: object) -> bool:
    # An array of NumPy, as ROS 2 has for lists of fixed length, has `__float__` too.
    return hasattr(value, "__float__") and not hasattr(value, "__len__")


def _names(message: object) -> list[str]:
    """The fields of a message; ROS 2 writes an underscore before their slots."""
    slots: Iterable[str] = getattr(type(message), "__slots__", ())
    return [name.lstrip("_") for name in slots if not name.startswith("_check")]


def _fields(message: object) -> str:
    names = _names(message)
    return f"; its fields are {', '.join(names)}" if names else ""
