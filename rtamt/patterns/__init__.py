"""Common requirements, as functions that return their formulas.

The names come from Dwyer, Avrunin and Corbett, "Patterns in property specifications for
finite-state verification", ICSE 1999; Konrad and Cheng, "Real-time specification patterns", ICSE
2005; Boufaied, Jukss, Bianculli, Briand and Parache, "Signal-based properties of cyber-physical
systems: taxonomy and logic-based characterization", Journal of Systems and Software 174, 2021. The
results are ordinary formulas.

Operands are formulas, terms, or their texts: ``never("x > 3")``. Times are numbers in the unit of
the specification, by default seconds, or texts with a unit: ``"500ms"``.
"""

from rtamt.patterns.catalogue import CATALOGUE, Pattern
from rtamt.patterns.formulas import (
    absence_between,
    in_order,
    minimum_duration,
    never,
    overshoot,
    precedence,
    rate_limit,
    recurrence,
    response,
    rise_time,
    settling_time,
    success,
    within_limits,
)
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
