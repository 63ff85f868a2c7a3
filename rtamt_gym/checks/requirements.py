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
    """Return the requirement that a text names; None if the text is a specification.

    Args:
        text: The specification as passed.
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
        raise InputError(
            f"unknown requirement {text!r}; the requirements are {listing(own)}{meant}"
        )
    return None


def named_in(text: str, constants: Mapping[str, _V]) -> dict[str, _V]:
    """The constants that a text names."""
    return {n: value for n, value in constants.items() if re.search(rf"\b{re.escape(n)}\b", text)}


def load_file(
    path: str | Path, constants: Mapping[str, float | str | Fraction]
) -> rtamt.Specification:
    """Return the specification in a file, with those constants that its text names.

    Raises:
        MissingFileError: If the file does not exist.
    """
    if not constants:
        return rtamt.load(path)
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        raise MissingFileError(path) from None
    return rtamt.load(path, constants=named_in(text, constants))
