"""What is judged and how, before monitors are made of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import rtamt
from rtamt_gym.judging.reading import Reading
from rtamt_gym.signals.signals import SignalLike

__all__ = ["Judging"]


class Judging(NamedTuple):
    """What is judged and how.

    Attributes:
        specs: The specifications by name.
        signals: What their variables read, as far as it was given.
        reading: How samples are judged.
    """

    specs: Mapping[str, rtamt.Specification]
    signals: Mapping[str, SignalLike] | None
    reading: Reading
