"""The exact motion of a unicycle: the integral of its velocity, a complex number."""

from __future__ import annotations

import cmath

import numpy as np

Pose = tuple[float, float, float]


def move(pose: Pose, speed: float, turn: float, dt: float) -> Pose:
    """Return the pose after dt seconds; m/s and rad/s, heading unwrapped."""
    x, y, heading = pose
    # The integral of speed exp(i (heading + turn t)) over dt.
    rate = 1j * turn
    seconds = complex(np.expm1(rate * dt)) / rate if turn else dt
    there = complex(x, y) + speed * cmath.exp(1j * heading) * seconds
    return there.real, there.imag, heading + turn * dt
