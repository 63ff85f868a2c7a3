"""`SimulatedTrace`: the samples of one simulation, as the requirements read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

__all__ = ["SimulatedTrace"]


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTrace:
    """The samples of one simulation.

    Attributes:
        signals: The values of every variable, by name.
        period: Seconds between samples, or None.
    """

    signals: Mapping[str, NDArray[np.float64]]
    period: Fraction | None

    @property
    def samples(self) -> int | None:
        """The number of samples; None of no variables."""
        return next((len(values) for values in self.signals.values()), None)
