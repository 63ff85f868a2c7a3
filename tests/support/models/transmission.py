"""An independent implementation of the automatic transmission, as in Simulink and with SciPy.

Hoxha, Abbas, Fainekos: Benchmarks for temporal logic requirements for automotive systems, ARCH
2014. Units: rpm, mph, lb ft, seconds. `fixed_step` is Dormand and Prince's formula of fifth order
at a fixed step. `solve` is SciPy's DOP853 between the instants at which the right side jumps:
shifts, new inputs, an engine at a limit of its speed, a car that stops.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45
from scipy.optimize import brentq

Floats = NDArray[np.float64]

ENGINE_INERTIA = 0.0219914882835559
VEHICLE_INERTIA = 12.09414785731247
FINAL_DRIVE = 3.23
GEARS = (2.393, 1.450, 1.000, 0.677)
MPH = 2 * math.pi * 60 / 5280
SLOWEST, FASTEST = 600.0, 6000.0


def _numbers(text: str) -> Floats:
    return np.array([float(word) for word in text.split()])


_THROTTLES = np.array([0, 20, 30, 40, 50, 60, 70, 80, 90, 100.0])
_RPMS = np.arange(800.0, 4801.0, 400.0)
_TORQUES = np.array(
    [
        [-40, -44, -49, -53, -57, -61, -65, -70, -74, -78, -82],
        [215, 117, 85, 66, 44, 29, 10, -2, -13, -22, -32],
        [245, 208, 178, 148, 122, 104, 85, 66, 48, 33, 18],
        [264, 260, 241, 219, 193, 167, 152, 133, 119, 96, 85],
        [264, 279, 282, 275, 260, 238, 223, 208, 189, 171, 152],
        [267, 290, 293, 297, 290, 275, 260, 256, 234, 212, 193],
        [267, 297, 305, 305, 305, 301, 293, 282, 267, 249, 226],
        [267, 301, 308, 312, 319, 323, 319, 316, 297, 279, 253],
        [267, 301, 312, 319, 327, 327, 327, 327, 312, 293, 267],
        [267, 301, 312, 319, 327, 334, 334, 334, 319, 305, 275.0],
    ]
)
_RATIOS = np.concatenate([np.arange(9) / 10, np.arange(81, 91) / 100, [0.92, 0.94]])
_CAPACITIES = _numbers(
    """137.4652089938063 137.06501915685197 135.86444964598905 135.6643547275119
    137.56525645304487 140.3665853117251 145.2689108144154 152.87251771654735 162.97731109964374
    164.2779280697452 166.17882979527823 167.97968406157264 170.08068070558275 172.78196210502438
    175.3831960452274 179.58518933324765 183.58708770279083 189.8900776348212 197.69377945543027
    215.90241703685155 244.51599037908485"""
)
_TORQUE_RATIOS = _numbers(
    """2.232 2.075 1.975 1.846 1.72 1.564 1.409 1.254 1.096 1.08 1.061 1.043 1.028 1.012 1.002
    1.002 1.001 .998 .999 1.001 1.002"""
)
_UP_THROTTLES = np.array([0, 25, 35, 50, 90, 100.0])
_UP = np.array(
    [
        [10, 30, 50, 1e6],
        [10, 30, 50, 1e6],
        [15, 30, 50, 1e6],
        [23, 41, 60, 1e6],
        [40, 70, 100, 1e6],
        [40, 70, 100, 1e6],
    ]
)
_DOWN_THROTTLES = np.array([0, 5, 40, 50, 90, 100.0])
_DOWN = np.array(
    [
        [0, 5, 20, 35],
        [0, 5, 20, 35],
        [0, 5, 25, 40],
        [0, 5, 30, 50],
        [0, 30, 50, 80],
        [0, 30, 50, 80.0],
    ]
)


def _cell(grid: Floats, at: float) -> tuple[int, float]:
    """Return the cell of a table and the position of `at` in it; extrapolate outside."""
    i = min(max(int(np.searchsorted(grid, at, side="right")) - 1, 0), len(grid) - 2)
    return i, (at - float(grid[i])) / float(grid[i + 1] - grid[i])


def _line(grid: Floats, values: Floats, at: float) -> float:
    i, share = _cell(grid, at)
    return float(values[i]) + share * float(values[i + 1] - values[i])


def engine_torque(throttle: float, rpm: float) -> float:
    i, a = _cell(_THROTTLES, throttle)
    j, b = _cell(_RPMS, rpm)
    low = (1 - b) * _TORQUES[i, j] + b * _TORQUES[i, j + 1]
    high = (1 - b) * _TORQUES[i + 1, j] + b * _TORQUES[i + 1, j + 1]
    return float((1 - a) * low + a * high)


def torques(throttle: float, gear: int, rpm: float, wheel: float) -> tuple[float, float]:
    """Return the torque that accelerates the engine, and the torque that drives the wheels."""
    ratio = FINAL_DRIVE * wheel * GEARS[gear - 1] / rpm
    impeller = (rpm / _line(_RATIOS, _CAPACITIES, ratio)) ** 2
    turbine = impeller * _line(_RATIOS, _TORQUE_RATIOS, ratio)
    return engine_torque(throttle, rpm) - impeller, FINAL_DRIVE * turbine * GEARS[gear - 1]


def resistance(brake: float, wheel: float) -> float:
    return brake + 40 + 0.02 * (MPH * wheel) ** 2


@dataclass
class ShiftLogic:
    """The chart of shifts, called every 0.04 s; `direction` is its pending shift."""

    gear: int = 1
    direction: int = 0
    ticks: int = 0

    def tick(self, throttle: float, speed: float) -> None:
        up = _line(_UP_THROTTLES, _UP[:, self.gear - 1], throttle)
        down = _line(_DOWN_THROTTLES, _DOWN[:, self.gear - 1], throttle)
        match self.direction:
            case 0 if speed > up:
                self.direction, self.ticks = 1, 0
            case 0 if speed < down:
                self.direction, self.ticks = -1, 0
            case 0:
                pass
            case 1 if speed < up:
                self.direction = 0
            case -1 if speed > down:
                self.direction = 0
            case direction:
                self.ticks += 1
                if self.ticks == 2:
                    self.gear, self.direction = self.gear + direction, 0


_A = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
)
_B = (35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)


def _slope(throttle: float, brake: float, gear: int, y: Floats) -> Floats:
    rpm = min(max(float(y[0]), SLOWEST), FASTEST)
    wheel = float(y[1])
    engine, drive = torques(throttle, gear, rpm, wheel)
    if (y[0] <= SLOWEST and engine < 0) or (y[0] >= FASTEST and engine > 0):
        engine = 0.0
    load = math.copysign(resistance(brake, wheel), wheel) if wheel else 0.0
    return np.array([engine / ENGINE_INERTIA, (drive - load) / VEHICLE_INERTIA])


def fixed_step(throttle: Floats, brake: Floats, *, halvings: int = 0) -> Floats:
    """Return rows (speed, rpm, gear) at 0, 0.01, ... s; inputs are held over 0.01 s.

    The chart runs at 0, 0.04, ... s on the input that starts there, and its gear is in the row of
    that time, as Simulink logs it. The last row uses the last input.
    """
    y = np.array([1000.0, 0.0])
    logic = ShiftLogic()
    rows = []
    h = 0.01 / 2**halvings
    for i in range(len(throttle) + 1):
        k = min(i, len(throttle) - 1)
        if i % 4 == 0 and i > 0:
            logic.tick(throttle[k], MPH * float(y[1]))
        rows.append((MPH * float(y[1]), float(y[0]), logic.gear))
        for _ in range(2**halvings):
            slopes: list[Floats] = []
            for weights in _A:
                inner = y + h * sum((a * s for a, s in zip(weights, slopes, strict=True)), 0 * y)
                slopes.append(_slope(throttle[k], brake[k], logic.gear, inner))
            y = y + h * sum((b * s for b, s in zip(_B, slopes, strict=True)), 0 * y)
            y[0] = min(max(y[0], SLOWEST), FASTEST)
    return np.array(rows)


@dataclass
class _Drive:
    """A phase of constant inputs, with the modes that make its right side smooth."""

    throttle: float
    brake: float
    gear: int
    limit: float | None = field(init=False, default=None)
    stands: bool = field(init=False, default=False)

    def enter(self, y: Floats) -> None:
        """Set the modes of the right side at y, and move y to the limit that holds it."""
        engine, drive = torques(self.throttle, self.gear, float(y[0]), float(y[1]))
        self.limit = None
        for limit, outward in ((SLOWEST, -1), (FASTEST, 1)):
            if (y[0] - limit) * outward > -1e-9 and engine * outward >= 0:
                self.limit = limit
                y[0] = limit
        self.stands = y[1] < 1e-12 and drive <= resistance(self.brake, 0.0)
        if self.stands:
            y[1] = 0.0

    def slope(self, _: float, y: Floats) -> Floats:
        engine, drive = torques(self.throttle, self.gear, float(y[0]), float(y[1]))
        return np.array(
            [
                0.0 if self.limit is not None else engine / ENGINE_INERTIA,
                0.0
                if self.stands
                else (drive - resistance(self.brake, float(y[1]))) / VEHICLE_INERTIA,
            ]
        )

    def guards(self) -> list[Callable[[Floats], float]]:
        """Return functions of the state that are positive as long as the modes last."""

        def net(y: Floats) -> tuple[float, float]:
            return torques(self.throttle, self.gear, float(y[0]), float(y[1]))

        found: list[Callable[[Floats], float]] = []
        if self.limit is None:
            found += [lambda y: float(y[0]) - SLOWEST, lambda y: FASTEST - float(y[0])]
        else:
            outward = -1 if self.limit == SLOWEST else 1
            found.append(lambda y: outward * net(y)[0])
        if self.stands:
            found.append(lambda y: resistance(self.brake, 0.0) - net(y)[1])
        else:
            found.append(lambda y: float(y[1]))
        return found


def solve(
    throttle: Floats,
    brake: Floats,
    *,
    method: type[DOP853 | RK45] = DOP853,
    rtol: float = 1e-11,
) -> Floats:
    """Return the rows of `fixed_step` without its step: SciPy's solver at a tight tolerance."""
    n = len(throttle)
    y = np.array([1000.0, 0.0])
    logic = ShiftLogic()
    rows = np.empty((n + 1, 3))
    rows[0] = 0.0, 1000.0, 1
    changes = 1 + np.flatnonzero((np.diff(throttle) != 0) | (np.diff(brake) != 0))
    at = 0  # the number of samples in rows
    for begin, end in zip([0, *changes], [*changes, n], strict=True):
        time = begin / 100
        while at < end:
            drive = _Drive(float(throttle[begin]), float(brake[begin]), logic.gear)
            drive.enter(y)
            solver = method(drive.slope, time, y, end / 100, rtol=rtol, atol=1e-9, max_step=0.1)
            time, y, at = _follow(solver, drive, logic, rows, at, (end, throttle))
    return rows


def _follow(
    solver: DOP853 | RK45,
    drive: _Drive,
    logic: ShiftLogic,
    rows: Floats,
    at: int,
    until: tuple[int, Floats],
) -> tuple[float, Floats, int]:
    """Fill rows until a mode or the gear changes or the phase ends: time, state, last row."""
    end, throttle = until
    guards = drive.guards()
    while at < end:
        solver.step()
        curve = solver.dense_output()
        last = solver.t_old
        stops = [i / 100 for i in range(at + 1, end + 1) if i / 100 <= solver.t + 1e-12]
        for stop in [*stops, solver.t]:
            here = curve(min(stop, solver.t))
            broken = [g for g in guards if g(here) < 0]
            if broken:
                times = [_zero(g, curve, last, min(stop, solver.t)) for g in broken]
                return min(times), curve(min(times)), at
            last = min(stop, solver.t)
            if stop not in stops or at == round(100 * stop):
                continue
            at += 1
            gear = logic.gear
            if at % 4 == 0:
                logic.tick(throttle[min(at, len(throttle) - 1)], MPH * float(here[1]))
            rows[at] = MPH * here[1], here[0], logic.gear
            if logic.gear != gear:
                return at / 100, here, at
    return end / 100, solver.y.copy(), at


def _zero(
    guard: Callable[[Floats], float], curve: Callable[[float], Floats], low: float, high: float
) -> float:
    if guard(curve(low)) <= 0:
        return low
    return float(brentq(lambda t: guard(curve(t)), low, high, xtol=1e-14))
