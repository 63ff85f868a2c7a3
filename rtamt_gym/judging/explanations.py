"""Explanations of one specification of several: which one, and by what name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from rtamt import Explanation, InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing

__all__ = ["chosen", "titled"]


def chosen(name: str | None, robustness: Mapping[str, float], violated_by: str | None) -> str:
    """The specification to explain.

    Args:
        name: The one that was asked for; None: the one that was violated first, else the one with
            the least robustness, of equal ones the first.
        robustness: The robustness of each specification.
        violated_by: The one that was violated first, or None.

    Raises:
        InputError: If there is no such specification.

    Example:
        >>> chosen(None, {"near": 0.5, "slow": 0.0, "upright": -0.0}, None)
        'upright'
    """
    if name is None:
        if violated_by is not None:
            return violated_by
        return min(robustness, key=lambda n: (robustness[n], math.copysign(1.0, robustness[n])))
    if name not in list(robustness):  # what has no hash is compared too
        raise InputError(
            f"expected the name of a specification, got {name!r}; the specifications are "
            f"{listing(robustness)}{nearest(name, robustness)}"
        )
    return name


def titled(explanation: Explanation, name: str, formula: object) -> Explanation:
    """The explanation in which a formula without a name has this one."""
    steps = (
        replace(step, name=name) if step.formula is formula and step.name is None else step
        for step in explanation.steps
    )
    return replace(explanation, steps=tuple(steps))
