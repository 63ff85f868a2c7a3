"""An elevator of the aircraft with two hydraulic actuators: the plant of `AircraftElevator`.

The state of a side has 10 numbers: position [cm] and velocity [cm/s] of the elevator; for the outer
actuator the pressure [kPa] across its piston, and position and velocity of its valve; the same
three for the inner actuator; integral and last value of the error of the outer actuator's control
law.

A valve is linear and its command is held over a period, so its motion is exact. Elevator and
pressures use substeps of the classical Runge-Kutta method: elevator and oil oscillate at 105 rad/s,
with little damping.
"""

import math

import numpy as np

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import Floats

SIDE = 10  # numbers in the state of a side
PERIOD = 0.01  # seconds from one sample of the control laws to the next

# By mode (Isolated, Off, Passive, Standby, Active): whether the servo valve follows its command,
# and whether the spool valve lets the piston push.
_SERVO = (0.0, 0.0, 0.0, 1.0, 1.0)
_SPOOL = (0.0, 0.0, 0.0, 0.0, 1.0)


def stepping(substeps: int) -> Floats:
    """Return the number of substeps in a period, and the matrix of a valve for half a substep.

    The valve s'' = 200 u - 10 s' - 30 s rests at 200 u / 30 and has the eigenvalues -5 +- i sqrt 5.
    The matrix, by rows, acts on its distance from there and its velocity.
    """
    half = PERIOD / substeps / 2
    cosine = math.exp(-5 * half) * math.cos(math.sqrt(5) * half)
    sine = math.exp(-5 * half) * math.sin(math.sqrt(5) * half) / math.sqrt(5)
    return np.array([substeps, cosine + 5 * sine, sine, -30 * sine, cosine - 5 * sine])


@compiled
def _slopes(
    position: float,
    velocity: float,
    outer: float,
    inner: float,
    valves: tuple[float, float],
    supplies: tuple[float, float],
    spools: tuple[float, float],
) -> tuple[float, float, float, float]:
    """Return the derivatives of position, velocity, and the outer and the inner pressure."""
    force = 100.0 * (outer * spools[0] + inner * spools[1])
    return (
        velocity,
        force - 10.0 * velocity - 1000.0 * position,
        100.0 * (supplies[0] - outer) * valves[0] - 100.0 * velocity,
        100.0 * (supplies[1] - inner) * valves[1] - 100.0 * velocity,
    )


@compiled
def advance(
    side: Floats,
    command: float,
    modes: tuple[float, float],
    supplies: tuple[float, float],
    stepping: Floats,
) -> None:
    """Advance a side by one period.

    Args:
        side: The state of the side, in and out.
        command: The position that the pilot commands over the period, in cm.
        modes: The modes of the outer and the inner actuator, from 0 to 4.
        supplies: The supply pressures of the outer and the inner actuator, in kPa.
        stepping: The result of the function of this name.
    """
    x, v, outer, inner = side[0], side[1], side[2], side[5]
    error = command - x
    pid = 0.0012 * error + 5.7e-5 * side[8] + 2.4e-4 * (error - side[9]) / PERIOD
    side[8] += PERIOD * error
    side[9] = error
    outer_mode, inner_mode = int(modes[0]), int(modes[1])
    spools = (_SPOOL[outer_mode], _SPOOL[inner_mode])
    outer_rest = 200.0 * pid * _SERVO[outer_mode] / 30.0
    inner_rest = 200.0 * 0.000325 * error * _SERVO[inner_mode] / 30.0
    s, sv = side[3] - outer_rest, side[4]
    r, rv = side[6] - inner_rest, side[7]
    substeps, ss, sd, ds, dd = stepping
    h = PERIOD / substeps
    half = 0.5 * h
    for _ in range(int(substeps)):
        begin = (outer_rest + s, inner_rest + r)
        s, sv = ss * s + sd * sv, ds * s + dd * sv
        r, rv = ss * r + sd * rv, ds * r + dd * rv
        middle = (outer_rest + s, inner_rest + r)
        s, sv = ss * s + sd * sv, ds * s + dd * sv
        r, rv = ss * r + sd * rv, ds * r + dd * rv
        end = (outer_rest + s, inner_rest + r)
        ax, av, ao, ai = _slopes(x, v, outer, inner, begin, supplies, spools)
        bx, bv, bo, bi = _slopes(
            x + half * ax, v + half * av, outer + half * ao, inner + half * ai,
            middle, supplies, spools,
        )  # fmt: skip
        cx, cv, co, ci = _slopes(
            x + half * bx, v + half * bv, outer + half * bo, inner + half * bi,
            middle, supplies, spools,
        )  # fmt: skip
        dx, dv, do, di = _slopes(
            x + h * cx, v + h * cv, outer + h * co, inner + h * ci,
            end, supplies, spools,
        )  # fmt: skip
        x += h / 6.0 * (ax + 2.0 * bx + 2.0 * cx + dx)
        v += h / 6.0 * (av + 2.0 * bv + 2.0 * cv + dv)
        outer += h / 6.0 * (ao + 2.0 * bo + 2.0 * co + do)
        inner += h / 6.0 * (ai + 2.0 * bi + 2.0 * ci + di)
    side[0], side[1] = x, v
    side[2], side[3], side[4] = outer, outer_rest + s, sv
    side[5], side[6], side[7] = inner, inner_rest + r, rv
