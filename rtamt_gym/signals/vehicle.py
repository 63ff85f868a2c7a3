"""Selectors of highway-env: ``vehicle.speed``, an attribute of the vehicle that is driven."""

from __future__ import annotations

from typing import Any

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.signals.selectors import Selector
from rtamt_gym.signals.signals import Env, Number, ParsedSignal

__all__ = ["bind_vehicle"]


def bind_vehicle(signal: ParsedSignal, env: Env) -> Number:
    """Makes the function that reads a signal from ``env.unwrapped.vehicle``, and tries it.

    Raises:
        InputError: If there is no such attribute, with the nearest; also when it is read later.
        InputTypeError: If the attribute is no number.
    """
    simulation: Any = env.unwrapped
    selector: Selector = signal.reads  # type: ignore[assignment]  # only selectors have a row

    # Every reset makes a new vehicle.
    def read(*_: object) -> float:
        try:
            value = getattr(simulation.vehicle, selector.field)
            for part in selector.path:
                value = value[part]
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            vehicle = getattr(simulation, "vehicle", None)
            known = hasattr(vehicle, selector.field)
            raise InputError(
                f"signal {signal.name!r}: cannot read {signal} of {type(simulation).__name__}: "
                f"{error}{'' if known else nearest(selector.field, dir(vehicle))}"
            ) from None
        return signal.number(value)

    read()
    return read
