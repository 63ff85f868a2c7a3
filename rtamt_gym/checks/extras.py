"""The packages that extras install, and the error that names the extra of one that is missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

__all__ = ["EXTRAS", "missing", "naming_extra"]

EXTRAS: Final[Mapping[str, str]] = {
    "gymnasium": "gym",
    "mujoco": "gym",
    "PIL": "gym",
    "moviepy": "video",
    "highway_env": "highway",
    "matplotlib": "plot",
    "pyarrow": "files",
    "scipy": "files",
    "asammdf": "mdf",
    "rosbags": "bags",
    "pandas": "pandas",
    "fmpy": "fmi",
    "SALib": "search",
    "cma": "search",
    "optuna": "optuna",
    "joblib": "search",
    "staliro": "taliro",
    "jinja2": "report",
    "plotly": "report",
    "minari": "minari",
    "z3": "check",
}
"""The extra that installs each optional package."""


def missing(error: ModuleNotFoundError) -> str | None:
    """The optional package that an import has not found; None if it is no optional package."""
    package = (error.name or "").partition(".")[0]
    return package if package in EXTRAS else None


def naming_extra(error: ModuleNotFoundError, what: str) -> ModuleNotFoundError:
    """The same error in words that name the extra; an error of another package stays as it is.

    Args:
        error: Why an import has failed.
        what: What needs the package.
    """
    package = missing(error)
    if package is None:
        return error
    return ModuleNotFoundError(
        f"{what} needs {package}, which is not installed; "
        f"from the checkout: pip install '.[{EXTRAS[package]}]'",
        name=error.name,
    )
