"""Parameters of scenarios that nodes simulate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from rtamt_envs.scenario import Scenario

from rtamt import InputError

__all__ = ["checked_row"]


def checked_row(
    scenario: Scenario, parameters: Mapping[str, float], seed: int
) -> NDArray[np.float64]:
    """The parameters of a scenario, within their ranges; others have their defaults.

    Raises:
        InputError: If a parameter has no such name, or a value or the seed is not in its range.
    """
    row = scenario.parameter_row(parameters, scenario.defaults)
    for each in scenario.parameters:
        if each.name in parameters and not each.low <= parameters[each.name] <= each.high:
            raise InputError(
                f"expected {each.name} from {each.low:g} to {each.high:g}, "
                f"got {parameters[each.name]:g}"
            )
    if seed < 0:
        raise InputError(f"expected a seed of at least 0, got {seed}")
    return row
