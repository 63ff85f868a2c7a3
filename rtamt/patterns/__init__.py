"""Common requirements, as functions that return their formulas.

The names come from Dwyer, Avrunin and Corbett, "Patterns in property specifications for
finite-state verification", ICSE 1999; Konrad and Cheng, "Real-time specification patterns", ICSE
2005; Boufaied, Jukss, Bianculli, Briand and Parache, "Signal-based properties of cyber-physical
systems: taxonomy and logic-based characterization", Journal of Systems and Software 174, 2021. The
results are ordinary formulas.

Operands are formulas, terms, or their texts: ``never("x > 3")``. Times are numbers in the unit of
the specification, by default seconds, or texts with a unit: ``"500ms"``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from rtamt.language.formula import Formula
from rtamt.patterns.formulas import (
    absence_between,
    in_order,
    minimum_duration,
    named_stages,
    never,
    overshoot,
    precedence,
    prefixes,
    rate_limit,
    recurrence,
    response,
    rise_time,
    settling_time,
    stages,
    success,
    within_limits,
)

__all__ = [
    "CATALOGUE",
    "Pattern",
    "absence_between",
    "in_order",
    "minimum_duration",
    "named_stages",
    "never",
    "overshoot",
    "precedence",
    "prefixes",
    "rate_limit",
    "recurrence",
    "response",
    "rise_time",
    "settling_time",
    "stages",
    "success",
    "within_limits",
]


ExampleColumns = Mapping[str, tuple[float, ...]]
"""The values of each signal, one second apart."""


@dataclass(frozen=True)
class Pattern:
    """A pattern with one example: its formula, a trace that satisfies it, and one that violates it.

    Attributes:
        name: The name of the pattern.
        wanted: The example in words.
        written: The example in Python, with the functions of `rtamt.patterns`.
        make: Returns the formula.
        satisfying: A trace that satisfies the formula, with samples one second apart.
        violating: A trace that violates it.
    """

    name: str
    wanted: str
    written: str
    make: Callable[[], Formula] = field(repr=False, compare=False)
    satisfying: ExampleColumns = field(hash=False)
    violating: ExampleColumns = field(hash=False)

    def __post_init__(self) -> None:
        """Make the traces read-only."""
        for name in ("satisfying", "violating"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @cached_property
    def formula(self) -> Formula:
        """The formula of the example, parsed when it is first read."""
        return self.make()


CATALOGUE = (
    Pattern(
        "never",
        "The speed is never above 3.",
        'never("speed > 3")',
        lambda: never("speed > 3"),
        {"speed": (0, 1, 2, 2.5, 3, 2, 1, 1, 0)},
        {"speed": (0, 1, 2, 3, 4, 2, 1, 1, 0)},
    ),
    Pattern(
        "always within limits",
        "The temperature stays between 18 and 24.",
        'within_limits("t", 18, 24)',
        lambda: within_limits("t", 18, 24),
        {"t": (19, 20, 22, 23, 24, 23, 21, 20, 19)},
        {"t": (19, 20, 22, 23, 25, 24, 21, 19, 17)},
    ),
    Pattern(
        "hold for T",
        "Whenever the heater is switched on it stays on for 3 s.",
        'minimum_duration("heater > 0", 3)',
        lambda: minimum_duration("heater > 0", 3),
        {"heater": (-1, 1, 1, 1, 1, -1, -1, -1, -1)},
        {"heater": (-1, 1, 1, 1, 1, -1, 1, -1, -1)},
    ),
    Pattern(
        "response within T",
        "Every request is granted within 2 s.",
        'response("req > 0", "gnt > 0", within=2)',
        lambda: response("req > 0", "gnt > 0", within=2),
        {"req": (-1, 1, -1, -1, -1, 1, -1, -1, -1), "gnt": (-1, -1, -1, 1, -1, -1, 1, -1, -1)},
        {"req": (-1, 1, -1, -1, -1, 1, -1, -1, -1), "gnt": (-1, -1, -1, 1, -1, -1, -1, -1, 1)},
    ),
    Pattern(
        "precedence",
        "The door is not opened before it is unlocked.",
        'precedence("unlocked > 0", "open > 0")',
        lambda: precedence("unlocked > 0", "open > 0"),
        {
            "unlocked": (-1, -1, 1, 1, 1, -1, -1, -1, -1),
            "open": (-1, -1, -1, -1, 1, 1, 1, -1, -1),
        },
        {
            "unlocked": (-1, -1, -1, -1, 1, 1, 1, -1, -1),
            "open": (-1, -1, 1, 1, 1, 1, 1, -1, -1),
        },
    ),
    Pattern(
        "in order",
        "The gripper comes near, then grasps, then lifts.",
        'in_order("near > 0", "grasped > 0", "lifted > 0")',
        lambda: in_order("near > 0", "grasped > 0", "lifted > 0"),
        {
            "near": (-1, 1, 1, 1, 1, 1, 1, 1, 1),
            "grasped": (-1, -1, -1, 1, 1, 1, 1, 1, 1),
            "lifted": (-1, -1, -1, -1, -1, -1, 1, 1, 1),
        },
        {
            "near": (-1, -1, -1, 1, 1, 1, 1, 1, 1),
            "grasped": (-1, -1, -1, -1, -1, 1, 1, 1, 1),
            "lifted": (-1, 1, 1, -1, -1, -1, -1, -1, -1),
        },
    ),
    Pattern(
        "absence between",
        "Between start and stop the door stays shut.",
        'absence_between("door > 0", "start > 0", "stop > 0")',
        lambda: absence_between("door > 0", "start > 0", "stop > 0"),
        {
            "start": (-1, 1, -1, -1, -1, -1, -1, -1, -1),
            "door": (1, -1, -1, -1, -1, -1, 1, 1, -1),
            "stop": (-1, -1, -1, -1, -1, 1, -1, -1, -1),
        },
        {
            "start": (-1, 1, -1, -1, -1, -1, -1, -1, -1),
            "door": (1, -1, -1, 1, 1, -1, -1, -1, -1),
            "stop": (-1, -1, -1, -1, -1, 1, -1, -1, -1),
        },
    ),
    Pattern(
        "settling time",
        "Within 4 s x is at most 0.1 from 1, and stays there.",
        'settling_time("x", 1, 0.1, within=4)',
        lambda: settling_time("x", 1, 0.1, within=4),
        {"x": (0, 0.6, 1.2, 0.95, 1.05, 1, 1, 1, 1)},
        {"x": (0, 0.6, 1.2, 0.8, 1.15, 0.85, 1.1, 1, 1)},
    ),
    Pattern(
        "overshoot",
        "x goes past 1 by at most 0.2.",
        'overshoot("x", 1, 0.2)',
        lambda: overshoot("x", 1, 0.2),
        {"x": (0, 0.5, 0.9, 1.15, 1.05, 1, 1, 1, 1)},
        {"x": (0, 0.5, 1.1, 1.4, 1.1, 0.95, 1, 1, 1)},
    ),
    Pattern(
        "rise time",
        "From 0.1 on x takes at most 3 s to reach 0.9.",
        'rise_time("x", 0.1, 0.9, within=3)',
        lambda: rise_time("x", 0.1, 0.9, within=3),
        {"x": (0, 0.2, 0.5, 0.8, 0.95, 1, 1, 1, 1)},
        {"x": (0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.95, 1, 1)},
    ),
    Pattern(
        "rate limit",
        "The steering moves no faster than 2.",
        'rate_limit("rate", 2)',
        lambda: rate_limit("rate", 2),
        {"rate": (0, 1, 2, 1, 0, -1, -2, -1, 0)},
        {"rate": (0, 1, 2, 1, 0, -1, -3, -1, 0)},
    ),
    Pattern(
        "recurrence",
        "The beat comes at least every 3 s.",
        'recurrence("beat > 0", 3)',
        lambda: recurrence("beat > 0", 3),
        {"beat": (-1, 1, -1, -1, 1, -1, 1, -1, -1)},
        {"beat": (-1, 1, -1, -1, -1, -1, 1, -1, -1)},
    ),
    Pattern(
        "success that holds",
        "The goal is reached, held for 2 s, and still so at the end.",
        'success("near > 0", hold=2, kept=True)',
        lambda: success("near > 0", hold=2, kept=True),
        {"near": (-1, -1, 1, 1, -1, 1, 1, 1, 1)},
        {"near": (-1, -1, 1, 1, 1, 1, -1, -1, 1)},
    ),
)
"""Every pattern, in the order of the page."""
