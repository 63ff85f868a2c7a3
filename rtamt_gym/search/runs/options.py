"""What a runner is given: the options of its runs, and its system."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, TypedDict, get_args

from gymnasium.vector import VectorEnv

import rtamt
from rtamt import InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.ends import AtTermination, AtTruncation
from rtamt_gym.judging.interface import Names, Semantics
from rtamt_gym.judging.specs import Align, Nan, View
from rtamt_gym.simulation.systems import Environment, System

__all__ = ["Options", "check_options", "check_system", "duration_of"]


class Options(TypedDict, total=False):
    """How runs are judged: options of `rtamt_gym.simulate`, which describes them."""

    view: View
    nan: Nan
    align: Align | None
    semantics: Semantics
    inputs: Names | None
    outputs: Names | None
    at_termination: AtTermination | None
    at_truncation: AtTruncation


def check_options(options: Mapping[str, Any]) -> None:
    """Refuses options that `simulate` does not have, or that have no such value."""
    known = Options.__annotations__
    for name in options:
        if name not in known:
            raise InputTypeError(
                f"expected options that simulate has, one of {listing(known)}, got {name}="
                f"{nearest(name, known)}"
            )
    choices: dict[str, tuple[str | None, ...]] = {
        "view": get_args(View),
        "nan": get_args(Nan),
        "at_termination": (None, *get_args(AtTermination)),
        "at_truncation": get_args(AtTruncation),
    }
    for name, values in choices.items():
        if name in options:
            check_choice(name, options[name], values)


def check_system(system: object) -> None:
    """Refuses a system that is not the same a second time, or that is many."""
    if isinstance(system, Iterator) or type(system).__name__ == "StepMonitor":
        raise InputTypeError(
            "expected a system that starts anew for each case, such as the id of an environment, "
            f"a pair (model, data) or a function, got {system!r}"
        )
    if isinstance(system, VectorEnv):
        raise InputTypeError(
            f"expected one environment, or its id, got {system}; lanes are made of it where it has "
            "them"
        )
    if isinstance(system, str) and system.endswith(".fmu"):
        raise InputTypeError(
            f"expected a system to run, got the name of a file; write Fmus({system!r})"
        )


def duration_of(ran: System, duration: float | None, period: float | str | None) -> float | None:
    """The longest duration of a run: that which is given, or the time limit of an environment."""
    if duration is not None:
        return None if duration == math.inf else duration
    if not isinstance(ran, Environment) or ran.limit is None:
        return None
    step = rtamt.Monitor("true", period=ran.period if period is None else period).period
    return None if step is None else float(step * ran.limit)
