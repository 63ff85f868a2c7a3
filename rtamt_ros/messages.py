"""The installed classes of messages and services, and their fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal

from rtamt import InputError, Specification
from rtamt.errors import nearest
from rtamt.language import SubscribedField


def find_class(
    package: str,
    name: str,
    *,
    kind: Literal["message", "service"] = "message",
    generation: int,
    belongs: Callable[[type], bool],
    install_hint: str,
) -> type:
    """Return the class ``package/name`` of a generation of ROS.

    Args:
        package: The package, ``geometry_msgs``.
        name: The name of the class, ``Twist``.
        kind: "message" or "service".
        generation: 1 or 2.
        belongs: Returns whether a class belongs to the generation.
        install_hint: How to install the package.

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
            f"the {kind}s of {package} are not installed{meant or ': '}{install_hint}"
        ) from error
    cls = getattr(module, name, None)
    if not isinstance(cls, type):
        raise InputError(f"{package} has no {kind} {name}{nearest(name, vars(module))}")
    if not belongs(cls):
        raise InputError(
            f"expected {package} of ROS {generation}, found {package} of ROS {3 - generation} in "
            f"{module.__file__}: start from a terminal where only ROS {generation} is set up"
        )
    return cls


def check_input(
    spec: Specification, field: SubscribedField, message: type, class_name: str
) -> None:
    """Raise SpecificationError if a message class has no number at the path of a variable.

    Elements of lists cannot be checked.
    """
    value = _follow(spec, field.variable, field.path, message(), class_name)
    if value is not None and not _is_number(value):
        reason = (
            f"expected a number as '{field.variable}', got a value of type {type(value).__name__}"
        )
        raise spec.name_error(field.variable, reason, _fields(value), part=-1)


def check_output(
    spec: Specification, formula: str, path: tuple[str, ...], message: type, class_name: str
) -> None:
    """Raise SpecificationError if a message class has no float at the path of a formula."""
    value = _follow(spec, formula, path, message(), class_name)
    if not isinstance(value, float):
        reason = (
            f"expected a floating-point field for a robustness, got {class_name}.{'.'.join(path)} "
            f"of type {type(value).__name__}"
        )
        raise spec.name_error(formula, reason, part=-1)


def _follow(
    spec: Specification,
    name: str,
    path: Sequence[str | int],
    message: Any,  # noqa: ANN401 - the classes of ROS have no types
    class_name: str,
) -> object:
    """Return the value at a path of a new message; None from an element of a list on."""
    value, kind = message, class_name
    for index, step in enumerate(path):
        if isinstance(step, int):
            if not hasattr(value, "__len__") or isinstance(value, str):
                reason = f"{kind} is not a list and has no element [{step}]"
                raise spec.name_error(name, reason, part=index - len(path))
            return None
        if not hasattr(value, step):
            hint = nearest(step, _names(value)).removeprefix("; ") or _fields(value)
            reason = f"{kind} has no field '{step}'"
            raise spec.name_error(name, reason, hint, part=index - len(path))
        value, kind = getattr(value, step), f"{kind}.{step}"
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
    return f"its fields are {', '.join(names)}" if names else ""
