"""Optional packages: the extras that install them, and their additions to tables of this one.

`rtamt_gym` imports this module first, because it raises an error if the released library, which is
also named `rtamt`, was installed over this one.

To add a table that other packages may extend: a function that reads the table with `plugins`, a
contract in `rtamt_gym.testing` and a section of ``docs/extending.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final

import rtamt
import rtamt.lazy

if "BACKEND" not in dir(rtamt):  # not hasattr, which would import the machines
    raise ImportError(
        "expected the packages of rtamt-stl, got the released rtamt, which was installed over it: "
        "pip uninstall rtamt rtamt-stl, then install rtamt-stl again"
    )

_GYM: Final = (
    "gym",
    "cases",
    "fmi",
    "minari",
    "video",
    "search",
    "report",
    "optuna",
    "taliro",
)
_SEARCH: Final = ("search", "report", "optuna", "taliro")

EXTRAS: Final[Mapping[str, tuple[str, ...]]] = {
    "gymnasium": _GYM,
    "mujoco": _GYM,
    "PIL": _GYM,
    "numba": ("cases",),
    "moviepy": ("video",),
    "highway_env": ("highway",),
    "matplotlib": ("plot",),
    "pyarrow": ("files", *_SEARCH),
    "scipy": ("files", *_SEARCH),
    "asammdf": ("mdf",),
    "pyulog": ("ulog",),
    "h5py": ("hdf",),
    "rosbags": ("bags",),
    "pandas": ("pandas", *_SEARCH),
    "fmpy": ("fmi",),
    "SALib": _SEARCH,
    "cma": _SEARCH,
    "optuna": ("optuna",),
    "joblib": _SEARCH,
    "staliro": ("taliro",),
    "jinja2": ("report",),
    "plotly": ("report",),
    "minari": ("minari",),
    "z3": ("check",),
    "rich": ("watch",),
    "rerun": ("rerun",),
    "distributed": ("dask",),
    "ray": ("ray",),
    "fsspec": ("urls",),
}
"""The extras that install each optional package, the smallest first."""

ALONE: Final[Mapping[str, str]] = {"staliro": "psy-taliro"}
"""Distributions that require the released rtamt: the extra installs their other requirements."""


_INSTALL: Final = "from the checkout: pip install '."


def missing(error: ModuleNotFoundError) -> str | None:
    """Return the optional package that an import did not find; None for other packages."""
    package = (error.name or "").partition(".")[0]
    return package if package in EXTRAS else None


def advice(package: str, wanted: str = "") -> str:
    """Return how to install an optional package.

    Args:
        package: The package.
        wanted: The extra of the caller, which may install further packages.

    Example:
        >>> advice("scipy", "search")
        "from the checkout: pip install '.[search]'"
        >>> advice("staliro")
        "from the checkout: pip install '.[taliro]' && pip install --no-deps psy-taliro"
    """
    extra = wanted if wanted in EXTRAS[package] else EXTRAS[package][0]
    alone = f" && pip install --no-deps {ALONE[package]}" if package in ALONE else ""
    return f"{_INSTALL}[{extra}]'{alone}"


def names_extra(message: str) -> bool:
    """Return whether the message of an error names the extra of a missing package."""
    return f"is not installed; {_INSTALL}" in message


def naming_extra(error: ModuleNotFoundError, caller: str, extra: str = "") -> ModuleNotFoundError:
    """Return an error that names the extra; for other packages, the error itself.

    ``extra`` installs all packages of the caller, if it needs more than one.
    """
    package = missing(error)
    if package is None:
        return error
    message = f"{caller} needs {package}, which is not installed; {advice(package, extra)}"
    return ModuleNotFoundError(message, name=error.name)


def lazy_names(package: str, definitions: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package, with errors that name the missing extra."""
    load = rtamt.lazy.lazy_names(package, definitions)

    def load_or_name_extra(name: str) -> object:
        try:
            return load(name)
        except ModuleNotFoundError as error:
            raise naming_extra(error, f"{package}.{name}") from error

    return load_or_name_extra


@cache
def plugins(group: str) -> Mapping[str, Any]:
    """Return the objects that installed packages add to a table, by name.

    Raises:
        InputError: If an entry cannot be loaded, or two have one name; the error names the package.
    """
    from importlib.metadata import entry_points  # slow to import, and rarely needed

    result: dict[str, Any] = {}
    for entry in entry_points(group=group):
        package = entry.dist.name if entry.dist else "a package"
        if entry.name in result:
            raise rtamt.InputError(
                f"expected one {entry.name!r} among the entry points {group}, got a second from "
                f"{package}; uninstall one package"
            )
        try:
            result[entry.name] = entry.load()
        except Exception as error:  # a package may raise anything while it is imported
            raise rtamt.InputError(
                f"cannot load {entry.value}, which {package} adds to {group} as {entry.name!r}: "
                f"{type(error).__name__}: {error}"
            ) from error
    return result
