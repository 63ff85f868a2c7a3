"""The values that variables have without a recording of them: the defaults of specifications."""

from __future__ import annotations

from collections.abc import Mapping

import rtamt
from rtamt import InputError
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.tables import number

__all__ = ["starts_of", "take_default"]


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


def take_default(source: str, name: str, columns: Columns, why: str, of: str = "") -> str:
    """Says that a variable has its default, and why.

    Args:
        source: Name of the file, for messages.
        name: The variable.
        columns: The values that variables have without a record, and whether they may.
        why: Why it has its default.
        of: What it is of, such as the topic of a bag.

    Raises:
        InputError: If the defaults of columns are refused, this one too.
    """
    value = number(columns.starts[name])
    if columns.no_defaults and name not in columns.defaults:
        raise InputError(
            f"{source}: expected records of '{name}'{of}, as --no-defaults says, got its default "
            f"{value}: {why}; give --signal {name}=COLUMN, or --default {name} to take it"
        )
    return f"'{name}'{of} is {value}, its default: {why}"
