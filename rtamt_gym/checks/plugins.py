"""Additions of other packages to the tables of this one, by the entry points of distributions.

To add a table that other packages may extend: a function that reads the table with `plugins`, a
contract in `rtamt_gym.testing` and a section of ``docs/extending.md``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Any

from rtamt import InputError


@cache
def plugins(group: str) -> Mapping[str, Any]:
    """Return the objects that installed packages add to a table, by name.

    Args:
        group: The table, as in ``[project.entry-points."rtamt.optimizers"]``.

    Raises:
        InputError: If an entry cannot be loaded, or two have one name; the error names the package.
    """
    result: dict[str, Any] = {}
    for entry in entry_points(group=group):
        package = entry.dist.name if entry.dist else "a package"
        if entry.name in result:
            raise InputError(
                f"expected one {entry.name!r} among the entry points {group}, got a second from "
                f"{package}; uninstall one package"
            )
        try:
            result[entry.name] = entry.load()
        except Exception as error:  # a package may raise anything while it is imported
            raise InputError(
                f"cannot load {entry.value}, which {package} adds to {group} as {entry.name!r}: "
                f"{type(error).__name__}: {error}"
            ) from error
    return result
