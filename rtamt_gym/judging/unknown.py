"""How samples are judged whose first values are not known: of signals with None at reset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.options.evaluation import Reading
from rtamt_gym.signals.signals import unknown_at_reset

__all__ = ["with_unknown_start"]


def with_unknown_start(
    reading: Reading, signals: Mapping[str, Any], *asked: Argument
) -> tuple[Reading, bool]:
    """The reading of monitors whose first sample may be unknown.

    A nan is unknown to these monitors. Where the reading refuses nan, what reads the signals has to
    refuse it then.

    Args:
        reading: How samples are judged.
        signals: The signals that are read; None at reset, as in ``("action[0]", None)``, makes the
            value there unknown.
        *asked: What else is asked for that needs the robustness of every instant.

    Returns:
        The reading, and whether what reads the signals has to refuse nan.

    Raises:
        InputError: If something is asked for that an unknown sample does not allow.
    """
    names = unknown_at_reset(signals)
    if not names or reading.nan == "unknown":
        return reading, False
    if reading.nan == "hold":
        asked = (Argument("nan", "hold"),)
        needs = "needs a first value to keep"
    else:
        asked += (Argument("view", "step"),) * (reading.view == "step")
        needs = "needs the robustness of every instant"
    if asked:
        raise InputError(
            f"signal {names[0]!r}: None at reset leaves its first sample unknown, and ",
            asked[0],
            f" {needs}; expected a number in the place of None",
        )
    return reading.having(nan="unknown"), True
