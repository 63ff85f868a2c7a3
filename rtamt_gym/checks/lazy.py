"""Packages that import names at their first use and may need an optional package."""

from collections.abc import Callable, Mapping

import rtamt.lazy
from rtamt_gym.checks.extras import naming_extra


def lazy_names(package: str, definitions: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package, with errors that name the missing extra.

    Args:
        package: The package, its ``__name__``.
        definitions: Public name to the full name of its definition.
    """
    load = rtamt.lazy.lazy_names(package, definitions)

    def load_or_name_extra(name: str) -> object:
        try:
            return load(name)
        except ModuleNotFoundError as error:
            raise naming_extra(error, f"{package}.{name}") from error

    return load_or_name_extra
