"""The installed classes of messages and services, and their fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal

from rtamt import InputError, SpecificationError
from rtamt.errors import nearest


def installed(
    package: str,
    name: str,
    *,
    kind: Literal["message", "service"] = "message",
    generation: int,
    is_its_own: Callable[[type], bool],
    how: str,
) -> type:
    """Return the class ``package/name`` of a generation of ROS.

    Args:
        package: The package, ``geometry_msgs``.
        name: The name of the class, ``Twist``.
        kind: "message" or "service".
        generation: 1 or 2.
        is_its_own: Returns whether a class belongs to this generation.
        how: How to install the package.

    Raises:
        InputError: If the class does not exist.
    """
    try:
        module = import_module(f"{package}.{'msg' if kind == 'message' else 'srv'}")
    except ImportError as error:
        # All names end alike, so only their starts are compared.
        others = [
            module_info.name[:-5]
            for module_info in iter_modules()
            if module_info.name.endswith("_msgs")
        ]
        meant = nearest(package.removesuffix("_msgs"), others).replace("'?", "_msgs'? If not, ")
        raise InputError(
            f"the {kind}s of {package} are not installed{meant or ': '}{how}"
        ) from error
    cls = getattr(module, name, None)
    if not isinstance(cls, type):
        raise InputError(f"{package} has no {kind} {name}{nearest(name, vars(module))}")
    if not is_its_own(cls):
        raise InputError(
            f"expected {package} of ROS {generation}, found {package} of ROS {3 - generation} in "
            f"{module.__file__}: start from a terminal where only ROS {generation} is set up"
        )
    return cls


def check_input(message: type, class_name: str, variable: str, path: Iterable[str | int]) -> None:
    """Raise SpecificationError if a message class has no number at the path of a variable.

    Elements of lists cannot be checked.
    """
    try:
        value = _follow(message(), class_name, path)
    except SpecificationError as error:
        raise SpecificationError(f"{variable}: {error}") from None
    if value is not None and not _is_number(value):
        raise SpecificationError(
            f"expected a number as '{variable}', got a value of type "
            f"{type(value).__name__}{_fields(value)}"
        )


def check_output(message: type, class_name: str, path: Iterable[str]) -> None:
    """Raise SpecificationError if a message class has no float at a path."""
    path = tuple(path)
    value = _follow(message(), class_name, path)
    if not isinstance(value, float):
        raise SpecificationError(
            f"expected a floating-point field for a robustness, got {class_name}.{'.'.join(path)} "
            f"of type {type(value).__name__}"
        )


def _follow(message: Any, class_name: str, path: Iterable[str | int]) -> object:  # noqa: ANN401
    """Return the value at a path of a new message; None from an element of a list on."""
    value, name = message, class_name
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
    # Arrays of NumPy, which ROS 2 uses for lists of fixed length, have `__float__` too.
    return hasattr(value, "__float__") and not hasattr(value, "__len__")


def _names(message: object) -> list[str]:
    """Return the fields of a message; ROS 2 adds an underscore to their slots."""
    slots: Iterable[str] = getattr(type(message), "__slots__", ())
    return [name.lstrip("_") for name in slots if not name.startswith("_check")]


def _fields(message: object) -> str:
    names = _names(message)
    return f"; its fields are {', '.join(names)}" if names else ""
