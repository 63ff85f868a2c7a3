"""Requirements by the names that a system gives them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import rtamt
from rtamt import InputError
from rtamt.errors import MissingFileError, nearest
from rtamt_gym.checks.names import listing

__all__ = ["load_file", "named_in", "requirement_named"]

_V = TypeVar("_V")


def requirement_named(
    text: object, own: Mapping[str, rtamt.Specification]
) -> rtamt.Specification | None:
    """The requirement that a text names; None if it is no name of one, but a specification.

    Args:
        text: What was given as a specification.
        own: The requirements that the system has of its own, by name.

    Raises:
        InputError: If it is nearly the name of a requirement, and no variable has this name.

    Example:
        >>> own = rtamt.parse("near = always(gap > 1); slow = always(v < 5)").requirements
        >>> requirement_named("slow", own).formula, requirement_named("gap", own)
        (<Formula always(v < 5)>, None)
    """
    if not isinstance(text, str):
        return None
    if text in own or not text.isidentifier():
        return own.get(text)
    if any(text in spec.variables for spec in own.values()):
        return None
    if meant := nearest(text, own):
        raise InputError(f"there is no requirement {text!r}; there are {listing(own)}{meant}")
    return None


def named_in(text: str, constants: Mapping[str, _V]) -> dict[str, _V]:
    """The constants that a text names."""
    return {n: value for n, value in constants.items() if re.search(rf"\b{re.escape(n)}\b", text)}


def load_file(
    path: str | Path, constants: Mapping[str, float | str | Fraction]
) -> rtamt.Specification:
    """Return the specification in a file, with those constants that its text names.

    Raises:
        MissingFileError: If there is no such file.
    """
    if not constants:
        return rtamt.load(path)
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        raise MissingFileError(path) from None
    return rtamt.load(path, constants=named_in(text, constants))
