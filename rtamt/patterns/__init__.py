"""Requirements that are often wanted, as functions that give their formulas.

The names are the catalogues': Dwyer, Avrunin and Corbett, "Patterns in property specifications for
finite-state verification", ICSE 1999; Konrad and Cheng, "Real-time specification patterns", ICSE
2005; Boufaied, Jukss, Bianculli, Briand and Parache, "Signal-based properties of cyber-physical
systems: taxonomy and logic-based characterization", Journal of Systems and Software 174, 2021. A
result is an ordinary formula: it prints as text, reads back as itself, and joins with others.

Operands are formulas, terms, or their texts: ``never("x > 3")``. Times are numbers in the unit of
the specification, which is seconds unless it says another, or texts with their unit: ``"500ms"``.
"""

from rtamt.patterns.catalogue import CATALOGUE, Pattern
from rtamt.patterns.control import overshoot, rate_limit, rise_time, settling_time
from rtamt.patterns.occurrence import (
    minimum_duration,
    never,
    recurrence,
    success,
    within_limits,
)
from rtamt.patterns.order import absence_between, in_order, precedence, response
from rtamt.patterns.stages import named_stages, prefixes, stages

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
