"""Public names of packages that are imported when they are first used."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module

__all__ = ["lazy_names"]


def lazy_names(package: str, definitions: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package.

    Args:
        package: The package, its ``__name__``.
        definitions: Public name to the full name of its definition.
    """

    def getattribute(name: str) -> object:
        if name not in definitions:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, _, own = definitions[name].rpartition(".")
        value = getattr(import_module(module), own)
        setattr(sys.modules[package], name, value)
        return value

    return getattribute
