"""The entries of a case, as what a system takes: numbers that are set, waveforms that drive."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral
from typing import NoReturn

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.waveform import Waveform

__all__ = ["as_number", "as_waveform", "like", "refuse_unknown"]


def as_number(name: str, entry: float | Waveform, drivable: str = "") -> float:
    """The number of an entry.

    Args:
        name: The name of the entry.
        entry: The entry.
        drivable: What waveforms drive, for the message.

    Raises:
        InputError: If it is a waveform.
    """
    if isinstance(entry, Waveform):
        raise InputError(
            f"expected {name!r} of the case as a number, which does not change during a run, got a "
            f"waveform{drivable and f'; waveforms drive {drivable}'}"
        )
    return entry


def as_waveform(name: str, entry: float | Waveform) -> Waveform:
    """The waveform of an entry; a number is one that stays.

    Raises:
        InputError: If it is an infinite number.
    """
    if isinstance(entry, Waveform):
        return entry
    if not math.isfinite(entry):
        raise InputError(
            f"expected {name!r} of the case as a waveform or a finite number, got {entry!r}"
        )
    return Waveform([0.0], [entry])


def refuse_unknown(
    system: str, name: str, known: Iterable[str], more: str = "", meant: Iterable[str] = ()
) -> NoReturn:
    """Refuses an entry that a system has nothing of, and names the nearest.

    Args:
        system: The name of the system.
        name: The name of the entry.
        known: The names that it takes.
        more: What else it takes, for the message.
        meant: What the name stands for most likely, if that is known.
    """
    names = list(known)
    takes = " and ".join(filter(None, [listing(names) if names else "", more])) or "none"
    meaning = "".join(f"; did you mean {each!r}?" for each in meant) or nearest(name, names)
    raise InputError(f"{system} takes no {name!r} of a case; it takes {takes}{meaning}")


def like(present: object, name: str, number: float) -> float:
    """A number in the type of the present value: a whole number or a truth value where that is one.

    Raises:
        InputError: If it is no such number.
    """
    if not isinstance(present, bool | Integral):
        return number
    if not number.is_integer():
        raise InputError(
            f"expected {name!r} of the case as a whole number, as {present!r}, got {number!r}"
        )
    if isinstance(present, bool):
        return bool(number)
    return int(number)
