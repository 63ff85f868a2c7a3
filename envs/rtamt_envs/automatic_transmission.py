"""A car with an automatic transmission: from throttle and brake to speed, engine speed and gear.

The field has used this benchmark since 2014; it is based on a demonstration model of Simulink.
Torques are in lb ft, engine and wheel in rpm, inertias in lb ft s/rpm, and speeds in mph; the wheel
has a radius of one foot.

- Engine: ``rpm' = (torque(throttle, rpm) - load) / 0.02199``, 1000 at the start, from 600 to 6000.
- Converter: ``load = (rpm / K(r))^2``, turbine torque ``load TR(r)``, r = turbine speed / rpm.
- Vehicle: ``wheel' = (3.23 gear_ratio turbine_torque - friction) / inertia``, at rest at the start,
  with ``friction = sign(speed) (brake + rolling + drag speed^2)``.
- Shifts: every 0.04 s the speed is compared with thresholds that depend on gear and throttle. The
  gear changes after three comparisons in a row (0.08 s) with the speed beyond the threshold.

Torque, K and TR are tables, linear between their points and beyond their ends. Both actions are
constant over a step. The solver is that of the original: Dormand and Prince's method of order five,
in fixed steps of 0.01 s. As in the original, a comparison at time t uses the throttle after t: it
happens at the start of the step from t, and a shift shows in the observation at t + 0.01 s. At a
control point of an input, the comparison therefore uses the new throttle.

Validated: at full throttle without the brake (three shifts up), the speed at 20 s and the maximum
rpm equal the results of Simulink to 1e-10. For shifts down, throttles between the rows of the
tables, the engine at its minimum of 600 rpm, and the brake, there are no results of Simulink; an
independent second model agrees to 1e-10 with the same steps. The model is not a real car: a
standing car with the brake on trembles between -0.01 and 0.02 mph, because friction jumps with the
sign of the speed. With half the step it trembles half as much.

The requirements are from the ARCH-COMP competition in falsification. `SCENARIO.inputs` are its
instance 2: pieces of 5 s, here seven of each input. Episodes last 35 s, because AT51 to AT54 need
32.6 s. The other requirements belong to instance 1, any piecewise continuous input: pass your own
``Signal("throttle", 0, 100, points=...)`` to a search.

    >>> import gymnasium as gym, rtamt_envs
    >>> car = gym.make_vec("rtamt/AutomaticTransmission-v0", num_envs=1)
    >>> observation, _ = car.reset()
    >>> samples = car.unwrapped.rollout([[[100.0, 0.0]]] * 2000)
    >>> print(f"{samples[-1, 0, 0]:.4f} mph at 20 s, at most {samples[:, 0, 1].max():.4f} rpm")
    120.2133 mph at 20 s, at most 4768.2772 rpm
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import EpisodeSoFar, Floats, Quantity, Scenario
from rtamt_gym.inputs.space import Parameter, Signal

if TYPE_CHECKING:  # it is optional
    from matplotlib.figure import Figure


_PERIOD: Final = 0.01
_STEPS_PER_COMPARISON: Final = 4.0
_COMPARISONS_PER_SHIFT: Final = 2.0  # after the first comparison beyond the threshold

# The indices of the state.
_RPM, _WHEEL, _GEAR, _SHIFT, _COMPARED, _STEPS = range(6)

_MPH: Final = 2.0 * math.pi * 60.0 / 5280.0  # per rpm of the wheel
_IDLE: Final = 600.0
_MAXIMUM: Final = 6000.0
_AGILITY: Final = 1.0 / 0.0219914882835559  # rpm/s of the engine per lb ft
_FINAL_DRIVE: Final = 3.23
_GEARS: Final = np.array([2.393, 1.450, 1.0, 0.677])

# fmt: off
# Torque of the engine: a row for each throttle, a column for each rpm.
_THROTTLES = np.array([0, *range(20, 101, 10)], float)
_SPEEDS = np.arange(800.0, 4801.0, 400.0)
_TORQUES = np.array([
    [-40, -44, -49, -53, -57, -61, -65, -70, -74, -78, -82],
    [215, 117, 85, 66, 44, 29, 10, -2, -13, -22, -32],
    [245, 208, 178, 148, 122, 104, 85, 66, 48, 33, 18],
    [264, 260, 241, 219, 193, 167, 152, 133, 119, 96, 85],
    [264, 279, 282, 275, 260, 238, 223, 208, 189, 171, 152],
    [267, 290, 293, 297, 290, 275, 260, 256, 234, 212, 193],
    [267, 297, 305, 305, 305, 301, 293, 282, 267, 249, 226],
    [267, 301, 308, 312, 319, 323, 319, 316, 297, 279, 253],
    [267, 301, 312, 319, 327, 327, 327, 327, 312, 293, 267],
    [267, 301, 312, 319, 327, 334, 334, 334, 319, 305, 275],
], float)

# The converter: K in rpm / sqrt(lb ft) and the ratio of torques, over the ratio of speeds.
_RATIOS = np.array([*range(0, 80, 10), *range(80, 91), 92, 94]) / 100.0
_CAPACITIES = np.array([
    137.4652089938063, 137.06501915685197, 135.86444964598905, 135.6643547275119,
    137.56525645304487, 140.3665853117251, 145.2689108144154, 152.87251771654735,
    162.97731109964374, 164.2779280697452, 166.17882979527823, 167.97968406157264,
    170.08068070558275, 172.78196210502438, 175.3831960452274, 179.58518933324765,
    183.58708770279083, 189.8900776348212, 197.69377945543027, 215.90241703685155,
    244.51599037908485,
])
_TORQUE_RATIOS = np.array([
    2.232, 2.075, 1.975, 1.846, 1.72, 1.564, 1.409, 1.254, 1.096, 1.08, 1.061,
    1.043, 1.028, 1.012, 1.002, 1.002, 1.001, 0.998, 0.999, 1.001, 1.002,
])

# Speeds above which a gear shifts up, and below which it shifts down: a row for each throttle, a
# column for each gear.
_UP_THROTTLES: Final = np.array([0.0, 25.0, 35.0, 50.0, 90.0, 100.0])
_UP: Final = np.array([
    [10, 30, 50, 1e6], [10, 30, 50, 1e6], [15, 30, 50, 1e6],
    [23, 41, 60, 1e6], [40, 70, 100, 1e6], [40, 70, 100, 1e6],
])
_DOWN_THROTTLES: Final = np.array([0.0, 5.0, 40.0, 50.0, 90.0, 100.0])
_DOWN: Final = np.array([
    [0, 5, 20, 35], [0, 5, 20, 35], [0, 5, 25, 40],
    [0, 5, 30, 50], [0, 30, 50, 80], [0, 30, 50, 80],
], float)
# fmt: on


def _planes() -> Floats:
    """Return the torque in each cell of its table: c0 + c1 throttle + (c2 + c3 throttle) rpm."""
    y, x = _THROTTLES[:-1, None], _SPEEDS[:-1]
    height, width = np.diff(_THROTTLES)[:, None], np.diff(_SPEEDS)
    along_y = np.diff(_TORQUES, axis=0)[:, :-1] / height
    along_x = np.diff(_TORQUES, axis=1)[:-1] / width
    twist = np.diff(np.diff(_TORQUES, axis=0), axis=1) / height / width
    constant = _TORQUES[:-1, :-1] - along_y * y - along_x * x + twist * x * y
    return np.stack([constant, along_y - twist * x, along_x - twist * y, twist], axis=-1)


def _lines() -> Floats:
    """Return K and TR in each hundredth of the ratio: c0 + c1 r and c2 + c3 r."""
    piece = np.searchsorted(_RATIOS, np.arange(94) / 100.0, side="right") - 1
    slopes = np.diff([_CAPACITIES, _TORQUE_RATIOS]) / np.diff(_RATIOS)
    constants = np.array([_CAPACITIES, _TORQUE_RATIOS])[:, :-1] - slopes * _RATIOS[:-1]
    return np.stack([constants[0], slopes[0], constants[1], slopes[1]], axis=-1)[piece]


_PLANES: Final = _planes()
_LINES: Final = _lines()


@compiled
def _cell(position: float, last: int) -> int:
    """Return the cell of a position in a table; the cells at its ends extend beyond them."""
    if position >= last:
        return last
    return int(position) if position > 0.0 else 0


@compiled
def _rates(
    rpm: float,
    wheel: float,
    throttle: float,
    row: int,
    braking: float,
    drag: float,
    ratio: float,
    agility: float,
) -> tuple[float, float]:
    """Return the derivatives of the speeds of engine and wheel."""
    rpm = min(max(rpm, _IDLE), _MAXIMUM)
    plane = _PLANES[row, _cell((rpm - 800.0) * 0.0025, 9)]
    torque = plane[0] + plane[1] * throttle + (plane[2] + plane[3] * throttle) * rpm
    slip = ratio * wheel / rpm
    line = _LINES[_cell(slip * 100.0, 93)]
    root = rpm / (line[0] + line[1] * slip)
    load = root * root
    acceleration = (torque - load) * _AGILITY
    if (rpm <= _IDLE and acceleration < 0.0) or (rpm >= _MAXIMUM and acceleration > 0.0):
        acceleration = 0.0
    speed = _MPH * wheel
    friction = braking + drag * speed * speed
    if wheel < 0.0:
        friction = -friction
    elif wheel == 0.0:
        friction = 0.0
    return acceleration, (ratio * load * (line[2] + line[3] * slip) - friction) * agility


@compiled
def _advance(
    h: float,
    action: Floats,
    gear: float,
    parameters: Floats,
    rpm: float,
    wheel: float,
) -> tuple[float, float]:
    """Return the speeds of engine and wheel h seconds later: a step of Dormand and Prince."""
    throttle = action[0]
    row = _cell(throttle * 0.1 - 1.0, 8)
    braking = action[1] + parameters[1]
    drag = parameters[2]
    ratio = _FINAL_DRIVE * _GEARS[int(gear) - 1]
    agility = 1.0 / parameters[0]
    a1, b1 = _rates(rpm, wheel, throttle, row, braking, drag, ratio, agility)
    x = rpm + h * (a1 / 5.0)
    y = wheel + h * (b1 / 5.0)
    a2, b2 = _rates(x, y, throttle, row, braking, drag, ratio, agility)
    x = rpm + h * (3.0 / 40.0 * a1 + 9.0 / 40.0 * a2)
    y = wheel + h * (3.0 / 40.0 * b1 + 9.0 / 40.0 * b2)
    a3, b3 = _rates(x, y, throttle, row, braking, drag, ratio, agility)
    x = rpm + h * (44.0 / 45.0 * a1 - 56.0 / 15.0 * a2 + 32.0 / 9.0 * a3)
    y = wheel + h * (44.0 / 45.0 * b1 - 56.0 / 15.0 * b2 + 32.0 / 9.0 * b3)
    a4, b4 = _rates(x, y, throttle, row, braking, drag, ratio, agility)
    c1, c2, c3, c4 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
    x = rpm + h * (c1 * a1 + c2 * a2 + c3 * a3 + c4 * a4)
    y = wheel + h * (c1 * b1 + c2 * b2 + c3 * b3 + c4 * b4)
    a5, b5 = _rates(x, y, throttle, row, braking, drag, ratio, agility)
    c1, c2, c3, c4 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0
    c5 = -5103.0 / 18656.0
    x = rpm + h * (c1 * a1 + c2 * a2 + c3 * a3 + c4 * a4 + c5 * a5)
    y = wheel + h * (c1 * b1 + c2 * b2 + c3 * b3 + c4 * b4 + c5 * b5)
    a6, b6 = _rates(x, y, throttle, row, braking, drag, ratio, agility)
    c1, c3, c4, c5 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0
    c6 = 11.0 / 84.0
    x = rpm + h * (c1 * a1 + c3 * a3 + c4 * a4 + c5 * a5 + c6 * a6)
    y = wheel + h * (c1 * b1 + c3 * b3 + c4 * b4 + c5 * b5 + c6 * b6)
    return min(max(x, _IDLE), _MAXIMUM), y


@compiled
def _threshold(throttle: float, throttles: Floats, speeds: Floats) -> float:
    """Return the speed at a throttle between the rows of a table."""
    piece = 0
    while piece < len(throttles) - 2 and throttle >= throttles[piece + 1]:
        piece += 1
    share = (throttle - throttles[piece]) / (throttles[piece + 1] - throttles[piece])
    return float(speeds[piece] + share * (speeds[piece + 1] - speeds[piece]))


@compiled
def _compare(throttle: float, state: Floats) -> None:
    """Compare the speed with the thresholds of the gear, and shift if necessary."""
    speed = _MPH * state[_WHEEL]
    column = int(state[_GEAR]) - 1
    shift = 0.0
    if speed > _threshold(throttle, _UP_THROTTLES, _UP[:, column]):
        shift = 1.0
    elif speed < _threshold(throttle, _DOWN_THROTTLES, _DOWN[:, column]):
        shift = -1.0
    if state[_SHIFT] == 0.0:
        state[_SHIFT] = shift
        state[_COMPARED] = 0.0
    elif shift != state[_SHIFT]:
        state[_SHIFT] = 0.0
    else:
        state[_COMPARED] += 1.0
        if state[_COMPARED] == _COMPARISONS_PER_SHIFT:
            state[_GEAR] = min(max(state[_GEAR] + shift, 1.0), 4.0)
            state[_SHIFT] = 0.0


@compiled
def _observe(state: Floats, observation: Floats) -> None:
    observation[0] = _MPH * state[_WHEEL]
    observation[1] = state[_RPM]
    observation[2] = state[_GEAR]


@compiled
def _start(parameters: Floats, noise: Floats, state: Floats, observation: Floats) -> None:  # noqa: ARG001 - as every scenario's
    state[:] = 0.0
    state[_RPM] = 1000.0
    state[_GEAR] = 1.0
    _observe(state, observation)


@compiled
def _step(
    action: Floats,
    parameters: Floats,
    noise: Floats,  # noqa: ARG001 - as every scenario's
    state: Floats,
    observation: Floats,
) -> None:
    if state[_STEPS] == 0.0:
        _compare(action[0], state)
    state[_RPM], state[_WHEEL] = _advance(
        _PERIOD, action, state[_GEAR], parameters, state[_RPM], state[_WHEEL]
    )
    state[_STEPS] = state[_STEPS] + 1.0 if state[_STEPS] < _STEPS_PER_COMPARISON - 1.0 else 0.0
    _observe(state, observation)


@compiled
def _baseline(time: float, observation: Floats, parameters: Floats, action: Floats) -> None:  # noqa: ARG001 - as every scenario's
    """Accelerate at half throttle."""
    action[0] = 50.0
    action[1] = 0.0


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Plot speed, engine speed, gear and the two actions, one below the other."""
    from rtamt_gym.drawing import SIGNAL, tidy

    plots = figure.subplots(5, 1, sharex=True, height_ratios=[1.6, 1.6, 1.1, 1.1, 1.1])
    columns = [*episode.observations.T, *episode.actions.T]
    names = ["speed [mph]", "rpm", "gear", "throttle [%]", "brake [lb ft]"]
    for ax, name, values in zip(plots, names, columns, strict=True):
        tidy(ax, name)
        if len(values) == len(episode.times):
            ax.plot(episode.times, values, color=SIGNAL, linewidth=1.2)
        else:  # a value of a step, which ends at the next sample
            ax.stairs(values, episode.times, baseline=None, color=SIGNAL, linewidth=1.2)
    plots[2].set_ylim(0.5, 4.5)
    plots[2].set_yticks([1, 2, 3, 4])
    plots[3].set_ylim(-5, 105)
    plots[4].set_ylim(-16, 341)
    plots[-1].set_xlabel("time [s]", fontsize=9.5)


SCENARIO = Scenario(
    name="AutomaticTransmission",
    title="Automatic transmission of a car",
    source="B. Hoxha, H. Abbas, G. Fainekos: Benchmarks for temporal logic requirements for "
    "automotive systems, ARCH 2014; instances and requirements of ARCH-COMP",
    period=_PERIOD,
    duration=35.0,
    actions=(Quantity("throttle", "%", 0.0, 100.0), Quantity("brake", "lb ft", 0.0, 325.0)),
    observations=(
        Quantity("speed", "mph", -10.0, 250.0),
        Quantity("rpm", "rpm", _IDLE, _MAXIMUM),
        Quantity("gear", "", 1.0, 4.0),
    ),
    parameters=(
        Parameter(
            "inertia",
            8.0,
            20.0,
            default=12.09414785731247,
            unit="lb ft s/rpm",
            about="inertia of the vehicle at the wheel",
        ),
        Parameter("rolling", 20.0, 80.0, default=40.0, unit="lb ft", about="friction at any speed"),
        Parameter(
            "drag",
            0.0,
            0.05,
            default=0.02,
            unit="lb ft/mph^2",
            about="friction per speed squared",
        ),
    ),
    inputs=(Signal("throttle", 0.0, 100.0, points=7), Signal("brake", 0.0, 325.0, points=7)),
    requirements="""
first = gear >= 0.5 and gear <= 1.5
second = gear >= 1.5 and gear <= 2.5
third = gear >= 2.5 and gear <= 3.5
fourth = gear >= 3.5 and gear <= 4.5
slow_engine = always[0:30](rpm < 3000)

AT1 = always[0:20](speed < 120)
AT2 = always[0:10](rpm < 4750)

// After a shift, the gear stays for 2.5 s.
AT51 = always[0:30](not first and eventually[0.01:0.1] first
    implies eventually[0.01:0.1] always[0:2.5] first)
AT52 = always[0:30](not second and eventually[0.01:0.1] second
    implies eventually[0.01:0.1] always[0:2.5] second)
AT53 = always[0:30](not third and eventually[0.01:0.1] third
    implies eventually[0.01:0.1] always[0:2.5] third)
AT54 = always[0:30](not fourth and eventually[0.01:0.1] fourth
    implies eventually[0.01:0.1] always[0:2.5] fourth)

// A slow engine means a slow car.
AT6a = slow_engine implies always[0:4](speed < 35)
AT6b = slow_engine implies always[0:8](speed < 50)
AT6c = slow_engine implies always[0:20](speed < 65)
AT6abc = slow_engine implies
    always[0:4](speed < 35) and always[0:8](speed < 50) and always[0:20](speed < 65)
""",
    state=6,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)
