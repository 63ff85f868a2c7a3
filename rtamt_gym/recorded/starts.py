"""The values that variables have without a recording of them: the defaults of specifications."""

from __future__ import annotations

from collections.abc import Mapping

import rtamt
from rtamt import InputError
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.tables import number

__all__ = ["default_note", "starts_of"]


def starts_of(specs: Mapping[str, rtamt.Specification], columns: Columns) -> dict[str, float]:
    """The value of each variable before its first record, where it has one.

    Raises:
        InputError: If two specifications declare different ones.
    """
    found: dict[str, float] = {}
    for spec in specs.values():
        for name, start in spec.defaults.items():
            if found.setdefault(name, start) != start:
                raise InputError(
                    f"expected one default for '{name}', which two specifications read, got "
                    f"{number(found[name])} and {number(start)}; give one of them another name, or "
                    "judge them one at a time"
                )
    read = {name for spec in specs.values() for name in spec.variables}
    return found | {name: start for name, start in columns.starts.items() if name in read}


def default_note(name: str, start: float, why: str, of: str = "") -> str:
    """Says that a variable has its default, and why."""
    return f"'{name}'{of} is {number(start)}, its default: {why}"
