"""Checks of arguments."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from numbers import Integral, Real
from typing import TypeGuard

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing


def check_choice(name: str, value: object, choices: Sequence[object]) -> None:
    """Raise InputError if a value is not among the choices."""
    if value not in choices:
        first, *others = choices
        middle = "".join(f", {choice!r}" for choice in others[:-1])
        last = f" or {others[-1]!r}" if others else ""
        near = nearest(value, choices)
        raise InputError("expected ", Argument(name, first), f"{middle}{last}, got {value!r}{near}")


def check_number(name: str, value: object, high: float = math.inf) -> float:
    """Return a number above 0, at most ``high`` and finite, as a float; otherwise InputError."""
    if _is_number(value) and 0.0 < float(value) <= high and float(value) < math.inf:
        return float(value)
    most = "" if high == math.inf else f" and at most {high:g}"
    raise InputError(
        "expected ", Argument(name), f" as a finite number above 0{most}, got {value!r}"
    )


def check_amount(name: str, value: object) -> float:
    """Return a finite number, 0 or more, as a float; otherwise InputError."""
    if _is_number(value) and 0.0 <= float(value) < math.inf:
        return float(value)
    raise InputError("expected ", Argument(name), f" as a finite number, 0 or more, got {value!r}")


def _is_number(value: object) -> TypeGuard[Real]:
    """Return whether a value is a real number; a boolean is not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def check_count(argument: object, count: object) -> int:
    """Return a whole number above 0 as an int; otherwise InputError or InputTypeError."""
    if isinstance(count, bool) or not isinstance(count, Integral):
        raise InputTypeError("expected ", argument, f" as a whole number, got {count!r}")
    if count < 1:
        raise InputError("expected ", argument, f" as 1 or more, got {count}")
    return int(count)


def check_whole(argument: object, number: object) -> int:
    """Return a whole number of 0 or more as an int; otherwise InputError."""
    if isinstance(number, bool) or not isinstance(number, Integral) or number < 0:
        raise InputError("expected ", argument, f" as a whole number, 0 or more, got {number!r}")
    return int(number)


def check_known(name: str, keys: Iterable[str], known: Collection[str]) -> None:
    """Raise InputError if a key is not a specification."""
    for key in keys:
        if key not in known:
            raise InputError(
                f"{name}= names an unknown specification {key!r}; the specifications are "
                f"{listing(known)}{nearest(key, known) or '; leave it out'}"
            )
