"""An independent implementation of one side of the aircraft elevator: Taylor series per 0.01 s.

The aircraft elevator control system of the RTAMT paper. Units: cm, kPa, seconds. An actuator has a
valve, a pressure and a piston. The outer one obeys a PID law, the inner one a direct link, both on
the error at the samples. Between samples the right side is a polynomial of second degree, so each
coefficient of the solution follows from the previous ones and the series is exact to rounding.
`solve_stiff` passes the same to SciPy's Radau.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

PERIOD = 0.01
KP, KI, KD, DIRECT = 0.0012, 5.7e-5, 2.4e-4, 0.000325
ORDER = 24
SERVO = {"isolated": 0.0, "off": 0.0, "passive": 0.0, "standby": 1.0, "active": 1.0}
SPOOL = {"isolated": 0.0, "off": 0.0, "passive": 0.0, "standby": 0.0, "active": 1.0}
HEALTHY = ("active", "standby")

State = tuple[Floats, Floats, Floats, Floats, Floats]
"""Valves and their speeds (n, 2), pressures (n, 2), elevator speed and position (n)."""
Flow = Callable[[State, Floats, Floats, Floats], State]


def square(frequency: float, amplitude: float, samples: int) -> Floats:
    """Return a wave between -amplitude and amplitude that starts high."""
    halves = np.floor(2 * frequency * PERIOD * np.arange(samples) + 1e-9)
    return np.where(halves % 2 == 0, amplitude, -amplitude)


def _series(state: State, drive: Floats, supply: Floats, spool: Floats) -> State:
    """Return the state a period later, by the Taylor series of its solution."""
    entries = state[3].shape
    s, ds, p = (np.zeros((ORDER + 1, *entries, 2)) for _ in range(3))
    v, x = (np.zeros((ORDER + 1, *entries)) for _ in range(2))
    s[0], ds[0], p[0], v[0], x[0] = state
    for k in range(ORDER):
        push = 200 * drive if k == 0 else 0.0
        flow = np.einsum("k...,k...->...", p[: k + 1], s[k::-1])
        s[k + 1] = ds[k] / (k + 1)
        ds[k + 1] = (push - 10 * ds[k] - 30 * s[k]) / (k + 1)
        p[k + 1] = 100 * (supply * s[k] - flow - v[k][..., None]) / (k + 1)
        v[k + 1] = (100 * (p[k] * spool).sum(-1) - 10 * v[k] - 1000 * x[k]) / (k + 1)
        x[k + 1] = v[k] / (k + 1)
    powers = PERIOD ** np.arange(ORDER + 1)
    s, ds, p, v, x = (np.tensordot(powers, c, 1) for c in (s, ds, p, v, x))
    return s, ds, p, v, x


def _radau(state: State, drive: Floats, supply: Floats, spool: Floats) -> State:
    def slope(_: float, y: Floats) -> Floats:
        s, ds, p, (v, x) = y[:2], y[2:4], y[4:6], y[6:]
        force = 100 * (p * spool).sum()
        return np.concatenate(
            [
                ds,
                200 * drive[0] - 10 * ds - 30 * s,
                100 * (supply - p) * s - 100 * v,
                [force - 10 * v - 1000 * x, v],
            ]
        )

    y = np.concatenate([part.ravel() for part in state])
    y = solve_ivp(slope, (0, PERIOD), y, method="Radau", rtol=1e-10, atol=1e-12).y[:, -1]
    return y[None, :2], y[None, 2:4], y[None, 4:6], y[6:7], y[7:8]


def solve(
    commands: Floats,
    *,
    modes: Sequence[tuple[str, str]] = (),
    supply: Sequence[Sequence[float]] = (),
    flow: Flow = _series,
) -> Floats:
    """Return positions (n, samples + 1) under commands (n, samples), held between samples.

    ``modes`` and ``supply`` hold the values of the outer and the inner actuator in the period after
    each sample; empty ones mean no faults. The law's integral is the sum of past errors; its
    difference uses an error of 0 before time 0.
    """
    entries, samples = commands.shape
    pair, one = np.zeros((entries, 2)), np.zeros(entries)
    state: State = (pair, pair, pair, one, one)
    total, before = np.zeros(entries), np.zeros(entries)
    positions = np.zeros((entries, samples + 1))
    for k in range(samples):
        error = commands[:, k] - state[4]
        law = KP * error + KI * total + KD * (error - before) / PERIOD
        total, before = total + error * PERIOD, error
        names = modes[k] if modes else HEALTHY
        servo = np.array([SERVO[name] for name in names])
        spool = np.array([SPOOL[name] for name in names])
        drive = np.stack([law, DIRECT * error], -1) * servo
        state = flow(state, drive, np.array(supply[k] if supply else (1000.0, 1000.0)), spool)
        positions[:, k + 1] = state[4]
    return positions


def solve_stiff(commands: Floats) -> Floats:
    """Return positions of one entry without faults by SciPy's Radau at 1e-10."""
    return solve(commands, flow=_radau)
