"""Success that holds: formulas for when a task counts as done.

The ``info`` of a benchmark has a flag at every step: whether the task is done. Its rate of success
is the share of episodes with a true flag at any step, even if a block only slid across its goal.
The functions here return stricter requirements on the flag, or on the quantity that sets it.

A state holds at an instant:

| state | it holds where |
|---|---|
| `flag` | the environment's own flag is true |
| `within` | a quantity is near its target, on either side: a puck on its mark |
| `one_sided` | a quantity has reached its target or passed it: a door, a button, a drawer |
| `hysteresis` | a quantity has come near and not yet gone far: a noisy flag without flicker |
| `at_rest` | a speed is small |
| `released` | the gripper is away from the object |

``&`` joins states. A reading makes a requirement on an episode of a state:

| reading | it is satisfied if the state |
|---|---|
| ``"any"`` | held at some sample |
| ``"last"`` | holds at the last sample |
| ``"held"`` | held for a time without a gap, at some time |
| ``"kept"`` | has held for that time without a gap when the episode ends |

Windows look back, so that no end of an episode cuts them: ``at_termination`` and ``at_truncation``
do not change the verdict, unless they are ``"open"`` or ``"failure"``. `rtamt.patterns.success`
returns the formulas.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction
from numbers import Real
from types import MappingProxyType
from typing import Final, Literal, get_args

import rtamt
from rtamt import Formula, InputError, InputTypeError
from rtamt.patterns import success
from rtamt_gym.checks.arguments import check_choice

__all__ = [
    "READINGS",
    "SuccessReading",
    "at_rest",
    "flag",
    "hysteresis",
    "one_sided",
    "reading",
    "readings",
    "released",
    "within",
]

SuccessReading = Literal["any", "last", "held", "kept"]
"""The readings of a state; the last is the strictest."""

READINGS: Final = get_args(SuccessReading)
"""The names of the readings."""

Hold = int | float | str | Decimal | Fraction
"""A time: a number of seconds, or text with a unit such as ``"500ms"``."""


def flag(name: str = "success") -> Formula:
    """Return a state that holds where a flag (0 or 1) is at least 0.5.

    Args:
        name: The variable that reads it, as in ``signals={"success": ("info['success']", 0.0)}``.

    Example:
        >>> str(flag())
        'success >= 0.5'
    """
    return rtamt.variable(name) >= 0.5


def within(quantity: str, target: float, tolerance: float) -> Formula:
    """Return a state that holds where a quantity is within a tolerance of its target.

    Args:
        quantity: The variable, in any unit.
        target: The target, in the same unit.
        tolerance: The maximum distance from the target, in the same unit.

    Raises:
        InputError: If the tolerance is not positive.

    Example:
        >>> str(within("height", 0.2, 0.02))
        'abs(height - 0.2) <= 0.02'
    """
    away = abs(rtamt.variable(quantity) - _number("target", target))
    return away <= _positive("tolerance", tolerance)


def one_sided(
    quantity: str, *, at_least: float | None = None, at_most: float | None = None
) -> Formula:
    """Return a state that holds where a quantity has reached or passed its target.

    Args:
        quantity: The variable, in any unit.
        at_least: The target of a quantity that rises, such as the angle of a door.
        at_most: The target of a quantity that falls, such as the height of a button.

    Raises:
        InputError: If both targets or neither are passed.

    Example:
        >>> str(one_sided("angle", at_least=1.2)), str(one_sided("height", at_most=0.02))
        ('angle >= 1.2', 'height <= 0.02')
    """
    if (at_least is None) == (at_most is None):
        raise InputError(
            "expected one side, at_least= or at_most=, got "
            f"{'none' if at_least is None else 'both'}; a band is within()"
        )
    value = rtamt.variable(quantity)
    if at_most is not None:
        return value <= _number("at_most", at_most)
    return value >= _number("at_least", at_least)


def hysteresis(quantity: str, *, enter: float, leave: float) -> Formula:
    """Return a state that holds from one threshold until the quantity is back past another.

    If ``enter`` is below ``leave``, the quantity should be small, such as a distance; if it is
    above, the quantity should be large.

    Args:
        quantity: The variable, in any unit.
        enter: The threshold that starts the state.
        leave: The threshold beyond which the state ends; at this number it still holds.

    Raises:
        InputError: If both are the same number: use `one_sided`.

    Example:
        >>> str(hysteresis("distance", enter=0.05, leave=0.07))
        'distance <= 0.07 since distance <= 0.05'
    """
    if enter == leave:
        raise InputError(
            f"expected two numbers as enter= and leave=, got {enter!r} twice; "
            "one_sided() has no gap"
        )
    value = rtamt.variable(quantity)
    if _number("enter", enter) < _number("leave", leave):
        return (value <= leave).since(value <= enter)
    return (value >= leave).since(value >= enter)


def at_rest(speed: str, *, below: float) -> Formula:
    """Return a state that holds where the magnitude of a speed is small.

    Args:
        speed: The variable, in any unit.
        below: The speed limit, in the same unit.

    Raises:
        InputError: If the limit is not positive.

    Example:
        >>> str(at_rest("speed", below=0.01))
        'abs(speed) < 0.01'
    """
    return abs(rtamt.variable(speed)) < _positive("below", below)


def released(distance: str, *, at_least: float) -> Formula:
    """Return a state that holds where the gripper is away from the object.

    Args:
        distance: The variable, the distance of gripper and object in any unit.
        at_least: The minimum distance, in the same unit.

    Raises:
        InputError: If the minimum is not positive.

    Example:
        >>> str(within("height", 0.2, 0.02) & released("reach", at_least=0.05))
        'abs(height - 0.2) <= 0.02 and reach >= 0.05'
    """
    return rtamt.variable(distance) >= _positive("at_least", at_least)


def reading(name: SuccessReading, state: Formula | str = "success", hold: Hold = 0.5) -> Formula:
    """Return the requirement of a reading on a state.

    ``"kept"`` implies ``"held"`` and ``"last"``, and each of these implies ``"any"``. An episode
    shorter than ``hold`` satisfies neither ``"held"`` nor ``"kept"``. The time includes the samples
    at both ends: 0.5 s of samples every 0.1 s are six samples.

    Args:
        name: The reading.
        state: The state, or the name of a `flag`.
        hold: The time of ``"held"`` and ``"kept"``, in seconds or as text with a unit.

    Raises:
        InputError: If the name is not a reading.
        SpecificationError: If ``hold`` is not positive.
        InputTypeError: If the state is neither a formula nor a name.

    Example:
        >>> for name in READINGS:
        ...     print(reading(name, "ok", "500ms"))
        eventually(ok >= 0.5)
        eventually always(ok >= 0.5)
        eventually(ok >= 0.5 since[500:500ms] ok >= 0.5)
        eventually always(ok >= 0.5 since[500:500ms] ok >= 0.5)
        >>> monitor = rtamt.EpisodeMonitor(reading("kept", "ok", 2), period=1)
        >>> for ok in (0, 1, 1, 1):
        ...     _ = monitor.update(ok)
        >>> monitor.finish(), monitor.verdict.name
        (0.5, 'SATISFIED')
    """
    check_choice("name", name, READINGS)
    if isinstance(state, str):
        state = flag(state)
    if not isinstance(state, Formula):
        raise InputTypeError(
            "expected a state, such as one_sided('angle', at_least=1.2), or the name of a flag, "
            f"got {state!r}"
        )
    length = hold if name in {"held", "kept"} else None
    return success(state, length, kept=name in {"last", "kept"})


def readings(state: Formula | str = "success", hold: Hold = 0.5) -> Mapping[str, Formula]:
    """Return all readings of a state by name, as specifications for `rtamt_gym.StlMonitor`.

    Args:
        state: As for `reading`.
        hold: As for `reading`.

    Raises:
        InputError: As `reading` does.
        SpecificationError: As `reading` does.
        InputTypeError: As `reading` does.

    Example:
        >>> list(readings("ok"))
        ['any', 'last', 'held', 'kept']
    """
    names: tuple[SuccessReading, ...] = READINGS
    return MappingProxyType({name: reading(name, state, hold) for name in names})


def _positive(name: str, value: float) -> float:
    if not _number(name, value) > 0:
        raise InputError(f"expected {name}= as more than 0, got {value!r}")
    return value


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, Real) or math.isnan(value):
        raise InputTypeError(f"expected a number as {name}=, got {value!r}")
    return float(value)
