"""How the episodes of an evaluation were read and judged: kept with it, compared with another's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from rtamt import InputError
from rtamt_gym.signals.signals import ParsedSignal, own_signals
from rtamt_gym.signals.sources import SOURCES

if TYPE_CHECKING:
    from rtamt_gym.play.episodes import Episodes
    from rtamt_gym.play.vector import VectorEpisodes

__all__ = ["check_read_alike", "reading_of"]


def reading_of(runner: Episodes | VectorEpisodes) -> dict[str, Any]:
    """How a runner reads and judges episodes, as JSON can write it.

    It has a signal for each variable of the requirements, wherever it comes from; None stands for a
    function, of which nobody knows what it reads.
    """
    found = runner.reading.written()
    monitor = runner.monitor
    signals = {
        **own_signals(runner.system),
        **((monitor.judging.signals or {}) if monitor is not None else {}),
        **(runner.signals or {}),
    }
    variables = {name for spec in runner.requirements.values() for name in spec.variables}
    found["signals"] = {
        name: _text(ParsedSignal.parse(name, signals[name], SOURCES))
        for name in sorted(variables)
        if name in signals
    }
    return found


def check_read_alike(a: Mapping[str, Any], b: Mapping[str, Any]) -> None:
    """Refuses evaluations whose episodes were read differently, as far as that is known."""
    differences = [f"{name} is {one!r} of A and {two!r} of B" for name, one, two in _pairs(a, b)]
    if differences:
        raise InputError(
            "cannot compare, for the episodes were read differently: "
            f"{', '.join(differences)}; evaluate both with the same"
        )


def _pairs(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """What differs, with the values of both."""
    for name in a:
        if name != "signals" and name in b and a[name] != b[name]:
            yield f"{name}=", a[name], b[name]
    one, two = a.get("signals", {}), b.get("signals", {})
    for name in one:
        if None not in (one[name], two.get(name)) and one[name] != two[name]:
            yield f"the signal {name}", one[name], two[name]


def _text(signal: ParsedSignal) -> str | None:
    """What a signal reads, and its value at reset if it was given one."""
    if signal.source is None:
        return None
    if signal.default is None:
        return str(signal)
    value = "unknown" if math.isnan(signal.default) else repr(signal.default)
    return f"{signal}, {value} at reset"
