"""The exact motion of a unicycle: the exponential of its twist, as SciPy's matrix function."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

Pose = tuple[float, float, float]


def move(pose: Pose, speed: float, turn: float, dt: float) -> Pose:
    """The pose after dt seconds at a speed in m/s and a turn rate in rad/s; heading unwrapped."""
    x, y, heading = pose
    here = np.array(
        [
            [math.cos(heading), -math.sin(heading), x],
            [math.sin(heading), math.cos(heading), y],
            [0, 0, 1],
        ]
    )
    there = here @ expm(np.array([[0, -turn, speed], [turn, 0, 0], [0, 0, 0]]) * dt)
    return float(there[0, 2]), float(there[1, 2]), heading + turn * dt
