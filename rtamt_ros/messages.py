"""The classes of messages and services that are installed."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import Literal

from rtamt import InputError
from rtamt.errors import nearest

__all__ = ["installed"]


def installed(
    package: str,
    name: str,
    *,
    kind: Literal["message", "service"] = "message",
    generation: int,
    is_its_own: Callable[[type], bool],
    how: str,
) -> type:
    """The class ``package/name`` of a generation of ROS.

    Args:
        package: The package, ``geometry_msgs``.
        name: The name of the class, ``Twist``.
        kind: What it is a class of.
        generation: 1 or 2.
        is_its_own: Whether a class is one of this generation.
        how: How to install the package.

    Raises:
        InputError: If there is no such class.
    """
    try:
        module = import_module(f"{package}.{'msg' if kind == 'message' else 'srv'}")
    except ImportError as error:
        # All names end alike: what comes before tells them apart.
        others = [each.name[:-5] for each in iter_modules() if each.name.endswith("_msgs")]
        meant = nearest(package.removesuffix("_msgs"), others).replace("'?", "_msgs'? If not, ")
        raise InputError(
            f"the {kind}s of {package} are not installed{meant or ': '}{how}"
        ) from error
    found = getattr(module, name, None)
    if not isinstance(found, type):
        raise InputError(f"{package} has no {kind} {name}{nearest(name, vars(module))}")
    if not is_its_own(found):
        raise InputError(
            f"expected {package} of ROS {generation}, found {package} of ROS {3 - generation} in "
            f"{module.__file__}: start from a terminal where only ROS {generation} is set up"
        )
    return found
