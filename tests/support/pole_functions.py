"""Functions that are signals, importable for pickle and for other processes."""

from __future__ import annotations

from typing import Any

import numpy as np

from rtamt_gym import Step
from rtamt_gym.wrappers import batched


def sideways(step: Step) -> float:
    """A function of one environment, as on the page."""
    return float(step.obs[0] - step.obs[2])


def drift(step: Step) -> float:
    """A function of action and reward, which are None at a reset."""
    if step.action is None or step.reward is None:
        return 0.0
    return float(step.obs[1]) + float(step.action) - 0.5 * float(step.reward)


def _energy(step: Step) -> Any:  # noqa: ANN401 - an array
    return np.square(step.obs[:, 1]) + np.square(step.obs[:, 3])


energy = batched(_energy)


@batched
def energies(step: Step) -> Any:  # noqa: ANN401 - an array
    return np.square(step.obs[:, 1])
