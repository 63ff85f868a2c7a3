"""An independent implementation of the chasing cars: SciPy's DOP853 with located events.

Hu, Lygeros, Sastry: Towards a theory of stochastic hybrid systems, HSCC 2000, as the falsification
competition (ARCH-COMP) runs it. The leader obeys throttle and brake, which are linear between
knots. Each follower is in one of three modes, which depend on the gap to the car before it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
CHASING, KEEPING, BRAKING = "chasing", "keeping", "braking"


class Guard(NamedTuple):
    """A mode change of a follower when the gap to the car before it passes a threshold."""

    follower: int
    rising: bool
    threshold: float
    becomes: str

    def value(self, positions: Floats) -> float:
        """Return a number that is positive until the follower changes its mode."""
        gap = float(positions[self.follower] - positions[self.follower - 1])
        return self.threshold - gap if self.rising else gap - self.threshold


_GUARDS = {
    CHASING: ((False, 10.0, KEEPING),),
    KEEPING: ((True, 15.0, CHASING), (False, 5.0, BRAKING)),
    BRAKING: ((True, 20.0, CHASING),),
}


def _guards(modes: list[str]) -> list[Guard]:
    return [Guard(i, *row) for i in range(1, 5) for row in _GUARDS[modes[i - 1]]]


def solve(knots: Floats, throttle: Floats, brake: Floats, times: Floats) -> Floats:
    """Return positions y1 .. y5, a row for each time; inputs are linear between the knots."""
    state = np.array([0, 10, 20, 30, 40, 0, 0, 0, 0, 0.0])  # positions, then speeds
    modes = [CHASING] * 4
    rows = np.empty((len(times), 5))
    for k in range(len(knots) - 1):
        inputs = [
            (u[k], (u[k + 1] - u[k]) / (knots[k + 1] - knots[k]), knots[k])
            for u in (throttle, brake)
        ]
        time = float(knots[k])
        while time < knots[k + 1]:
            _switch(modes, state)
            run = solve_ivp(
                _slope(modes, inputs),
                (time, knots[k + 1]),
                state,
                method="DOP853",
                rtol=1e-12,
                atol=1e-12,
                max_step=0.5,
                dense_output=True,
                events=_event(_guards(modes)),
            )
            inside = (times >= time) & (times <= run.t[-1])
            if inside.any():
                rows[inside] = run.sol(times[inside])[:5].T
            time, state = float(run.t[-1]), run.y[:, -1]
            if run.status == 1:
                first = min(_guards(modes), key=lambda guard: abs(guard.value(state[:5])))
                modes[first.follower - 1] = first.becomes
    return rows


def _switch(modes: list[str], state: Floats) -> None:
    """Change the modes of the followers whose guard already holds."""
    for guard in _guards(modes):
        if guard.value(state[:5]) <= 0:
            modes[guard.follower - 1] = guard.becomes


def _event(guards: list[Guard]) -> Callable[[float, Floats], float]:
    """Return the minimum of the guards, which crosses 0 when the first one holds."""
    behind = np.array([guard.follower for guard in guards])
    signs = np.array([-1.0 if guard.rising else 1.0 for guard in guards])
    thresholds = np.array([guard.threshold for guard in guards])

    def value(_: float, state: Floats) -> float:
        gaps = state[behind] - state[behind - 1]
        return float((signs * (gaps - thresholds)).min())

    value.terminal = True  # type: ignore[attr-defined] # what solve_ivp reads
    value.direction = -1  # type: ignore[attr-defined] # what solve_ivp reads
    return value


def _slope(
    modes: list[str], inputs: list[tuple[float, float, float]]
) -> Callable[[float, Floats], Floats]:
    heads = np.array([1.0 if mode == KEEPING else -1.0 for mode in modes])
    pushes = np.array([1.0 if mode == CHASING else 0.0 for mode in modes])
    drags = np.array([1.0 if mode == BRAKING else 0.0 for mode in modes])

    def slope(t: float, state: Floats) -> Floats:
        throttle, brake = (value + rate * (t - begin) for value, rate, begin in inputs)
        v = state[5:]
        return np.concatenate(
            [[v[0]], heads * v[1:], [-throttle - brake * v[0]], pushes - drags * v[1:]]
        )

    return slope
