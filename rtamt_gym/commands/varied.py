"""What a search varies, as arguments: ``--vary`` and ``--set``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import read_floats

if TYPE_CHECKING:
    from rtamt_gym.inputs.ranges import Parameter, Signal

_EXAMPLE = "mass=1:2, gear=1|2|3 or throttle=0:100,points=7"


def read_varied(
    vary: Sequence[str],
    fixed: Sequence[str],
    scenario: Any,  # noqa: ANN401 - None where there is none
) -> tuple[list[Signal | Parameter] | None, dict[str, float]]:
    """Reads ``--vary`` and ``--set``: the entries of a space, None for the default, and numbers.

    Raises:
        InputError: If an argument is not of its form, or a name alone is not of the scenario.
    """
    numbers: dict[str, float] = {}
    for argument in fixed:
        name, _, text = (part.strip() for part in argument.partition("="))
        value = read_floats([text]) if name and text else None
        if value is None:
            raise InputError(f"--set: expected NAME=NUMBER, such as mass=1.5, got {argument!r}")
        if name in numbers:
            raise InputError(f"--set: expected one {name!r}, got two")
        (numbers[name],) = value
    known = {} if scenario is None else _known(scenario)
    return [_entry(argument, known) for argument in vary] or None, numbers


def _known(scenario: Any) -> Mapping[str, Signal | Parameter]:  # noqa: ANN401
    each: Iterable[Signal | Parameter] = [*scenario.parameters, *scenario.inputs]
    return {entry.name: entry for entry in each}


def _entry(argument: str, known: Mapping[str, Signal | Parameter]) -> Signal | Parameter:
    from rtamt_gym.inputs.ranges import Parameter, Signal

    name, equals, text = (part.strip() for part in argument.partition("="))
    if not equals:
        if name not in known:
            has = f"the scenario has {listing(known)}" if known else "the system says no ranges"
            raise InputError(f"--vary {name}: expected {_EXAMPLE}; {has}{nearest(name, known)}")
        return known[name]
    span, *options = (part.strip() for part in text.split(","))
    words = {option.partition("=")[0]: option.partition("=")[2] for option in options}
    if not name:
        raise _refused(argument)
    if "|" in span or ":" not in span:
        values = read_floats(span.split("|"))
        if values is None or words:
            raise _refused(argument)
        return Parameter(name, values=values)
    ends = read_floats(span.split(":"))
    if ends is None or len(ends) != 2:
        raise _refused(argument)
    if "points" not in words:
        if words not in ({}, {"log": ""}):
            raise _refused(argument)
        return Parameter(name, *ends, log="log" in words)
    points = words.pop("points")
    rest: Any = [*words] or ["hold"]
    if not points.isdecimal() or any(words.values()) or len(rest) != 1:
        raise _refused(argument)
    return Signal(name, *ends, points=int(points), interpolation=rest[0])


def _refused(argument: str) -> InputError:
    return InputError(f"--vary: expected {_EXAMPLE}, got {argument!r}")
