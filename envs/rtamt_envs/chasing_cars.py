"""Five cars in a row (CC): each of the last four follows the car before it.

The positions y1 .. y5 run along one road. The cars drive towards smaller numbers, so that car 1
leads and the gaps y2 - y1 .. y5 - y4 are positive. Throttle and brake drive car 1:

    v' = -throttle - brake v,   y' = v,   y(0) = v(0) = 0

The others start at rest, 10 apart. Each has three modes, which depend on the gap to the car before
it:

    =======  ====  ====  =====================================================
    mode     v'    y'    ends
    =======  ====  ====  =====================================================
    Chasing   1     -v   in Keeping at gap <= 10
    Keeping   0      v   in Chasing at gap >= 15, in Braking at gap <= 5
    Braking  -v     -v   in Chasing at gap >= 20
    =======  ====  ====  =====================================================

They start in Chasing, which a gap of 10 ends at once. In the benchmark, too, a car in Keeping
drives backwards. Its positions have no unit; here they are metres.

**Solution.** There is no solver with steps: between two changes of mode, each follower has a closed
solution. Throttle and brake change linearly from the last action to the new one (the first step
holds its action), so the speed of car 1 is a power series in time. Its terms are added until the
remainder is below 1e-19 of the speed, at most 17 terms, because 0.05 s is short. A gap within a
period is therefore a polynomial, and the first time at which it reaches a guard is exact up to
rounding. A period may have several changes of mode: followers only slow down by braking, and late
in a run gaps swing between 10 and 15 faster than samples show. Rounding is the only error. Compared
with an independent solver of order 8 with event location (tolerances 1e-12), the positions of
random runs differ by less than 2e-11 over 100 s. At full throttle, where y1 falls to -5000, they
differ by 1.2e-10.

Forward Euler is too inaccurate: with steps of 0.05 s, 57 of 60 random inputs violate CC5, and in
truth one in forty does. With steps of 0.01 s, followers are still up to 6 m from their true
positions.

**Not validated:** the model solves the equations above, and was not compared with traces of the
Simulink model. There, the input of the first period changes linearly too, and guards take effect at
the steps of the solver.

Source: J. Hu, J. Lygeros, S. Sastry: Towards a theory of stochastic hybrid systems, HSCC 2000. The
requirements and inputs are from the competition ARCH-COMP (falsification). Instance 1, the default
search space, has 10 control points of each input over 100 s, joined by lines. Instance 2 has 20
pieces of 5 s: ``Signal("throttle", 0, 1, points=20)``, and the same for the brake. Actions are
joined by lines, so a change at 5 s lasts until 5.05 s.

    >>> import gymnasium as gym, rtamt_envs
    >>> cars = gym.make_vec("rtamt/ChasingCars-v0", num_envs=1)
    >>> observation, _ = cars.reset()
    >>> positions = cars.unwrapped.rollout([[[1.0, 0.0]]] * 2000)[-1, 0]  # full throttle, 100 s
    >>> print(*(f"{y:.2f}" for y in positions))
    -5000.00 -4678.77 -4367.54 -4066.32 -3775.09
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import EpisodeSoFar, Floats, Quantity, Scenario
from rtamt_gym.inputs.space import Parameter, Signal

if TYPE_CHECKING:  # it is optional
    from matplotlib.figure import Figure


_SHORTEST = 2.0**-30  # in such short intervals next to an extremum, only rounding differs


@compiled
def _value(polynomial: Floats, length: int, argument: float) -> tuple[float, float]:
    """Return the value of a polynomial and its slope."""
    value, slope = 0.0, 0.0
    for power in range(length - 1, -1, -1):
        slope = slope * argument + value
        value = value * argument + float(polynomial[power])
    return value, slope


@compiled
def _root(
    polynomial: Floats,
    length: int,
    level: float,
    low: float,
    at_low: float,
    high: float,
    at_high: float,
) -> float:
    """Return the argument at which a polynomial crosses a level, in a monotone interval."""
    rising = at_high > level
    estimate = low + (high - low) * (level - at_low) / (at_high - at_low)
    for _ in range(100):
        value, slope = _value(polynomial, length, estimate)
        if (value > level) == rising:
            high = estimate
        else:
            low = estimate
        better = estimate - (value - level) / slope if slope != 0.0 else estimate
        if better == estimate:
            break
        if not low < better < high:
            better = 0.5 * (low + high)
            if not low < better < high:
                break
        estimate = better
    return estimate


@compiled
def first_crossing(polynomial: Floats, length: int, level: float, sign: float) -> float:
    """Return the first argument from 0 to 1 at which a polynomial reaches a level.

    A bound of the curvature shows where a crossing is possible, so the search misses no crossing,
    not even a touch. Newton's method within a bracket then locates it up to rounding.

    Args:
        polynomial: The coefficients, lowest power first.
        length: The number of coefficients.
        level: The level.
        sign: 1 to reach the level from above, -1 from below.

    Returns:
        The argument; 0 if the polynomial starts there or beyond, 2 if it does not reach the level.
    """
    bend = 0.0  # the maximum curvature
    for power in range(2, length):
        bend += power * (power - 1) * abs(float(polynomial[power]))
    low, width = 0.0, 1.0
    at_low = float(polynomial[0])
    if sign * (at_low - level) <= 0.0:
        return 0.0
    while low < 1.0:
        high = min(low + width, 1.0)
        at_high, slope = _value(polynomial, length, high)
        if min(sign * (at_low - level), sign * (at_high - level)) > bend * width * width / 8.0:
            low, at_low = high, at_high  # the polynomial is that close to its chord
            width *= 2.0
        elif abs(slope) > bend * width:  # monotone
            if sign * (at_high - level) <= 0.0:
                return _root(polynomial, length, level, low, at_low, high, at_high)
            low, at_low = high, at_high
        elif width > _SHORTEST:
            width *= 0.5
        elif sign * (at_high - level) <= 0.0:
            return high
        else:
            low, at_low = high, at_high
    return 2.0


_PERIOD = 0.05  # seconds
_CARS = 5

# The indices of the state: positions, speeds, modes (0 for car 1), the last action, and whether
# there was an action.
_SPEED = _CARS
_MODE = 2 * _CARS
_THROTTLE = 3 * _CARS
_BRAKE = _THROTTLE + 1
_HAS_ACTION = _BRAKE + 1
_STATE = _HAS_ACTION + 1

# A mode ends when the gap is at most `_LOW` or at least `_HIGH`, in `_CLOSER` or `_FARTHER`.
_CHASING, _KEEPING, _BRAKING = 0.0, 1.0, 2.0
_LOW = (10.0, 5.0, -math.inf)
_HIGH = (math.inf, 15.0, 20.0)
_CLOSER = (_KEEPING, _BRAKING, _BRAKING)
_FARTHER = (_CHASING, _CHASING, _CHASING)

# A course is the position of a car or a gap over a time ahead: a polynomial in the share of that
# time, lowest power first.
_LENGTH = 18  # at most; the speed of car 1 needs no power above 16
_INVERSE = (0.0, *(1.0 / power for power in range(1, _LENGTH)))
_DECAY_POWERS = 10  # of exp(-t) for t <= 0.05: the next one is below 1e-21


@compiled
def _lead(
    time: float,
    throttle: float,
    throttle_change: float,
    brake: float,
    brake_change: float,
    speed: float,
    course: Floats,
) -> tuple[float, float, float, int]:
    """Fill the speed of car 1 over `time`, as a power series, for inputs that change linearly.

    Returns:
        The way, the change of speed, a bound of the distance during the time, and the length of
        the series.
    """
    small = 1e-19 * (abs(speed) + time * (abs(throttle) + abs(throttle_change)))
    earlier, term = 0.0, speed
    travel, change, far, length = 0.0, 0.0, 0.0, _LENGTH
    for power in range(1, _LENGTH):
        step = time * term * _INVERSE[power]
        course[power] = step
        travel += step
        far += abs(step)
        push = brake * term + brake_change * earlier
        if power == 1:
            push += throttle
        elif power == 2:
            push += throttle_change
        elif abs(earlier) + abs(term) <= small:
            length = power + 1
            break
        earlier, term = term, -time * push * _INVERSE[power]
        change += term
    return travel, change, far, length


@compiled
def _follow(sign: float, time: float, car: int, state: Floats, course: Floats) -> int:
    """Add the series of a follower in one mode, times the sign and without its position.

    Returns:
        The length of the series.
    """
    speed, mode = float(state[_SPEED + car]), state[_MODE + car]
    if mode == _CHASING:
        course[1] -= sign * speed * time
        course[2] -= sign * 0.5 * time * time
        return 3
    if mode == _KEEPING:
        course[1] += sign * speed * time
        return 2
    term = sign * speed
    for power in range(1, _DECAY_POWERS + 1):
        term *= -time * _INVERSE[power]
        course[power] += term
    return _DECAY_POWERS + 1


@compiled
def _advance(time: float, state: Floats) -> None:
    """Move the followers for `time`, without changes of mode."""
    for car in range(1, _CARS):
        speed, mode = float(state[_SPEED + car]), state[_MODE + car]
        if mode == _CHASING:
            state[car] -= (speed + 0.5 * time) * time
            state[_SPEED + car] = speed + time
        elif mode == _KEEPING:
            state[car] += speed * time
        else:
            change, term = 0.0, speed
            for power in range(1, _DECAY_POWERS + 1):
                term *= -time * _INVERSE[power]
                change += term
            state[car] += change  # y' = v' while braking
            state[_SPEED + car] = speed + change


@compiled
def _switch(state: Floats) -> None:
    """Change the modes whose guards hold now."""
    for car in range(1, _CARS):
        gap = state[car] - state[car - 1]
        changed = True
        while changed:
            mode = int(state[_MODE + car])
            changed = gap <= _LOW[mode] or gap >= _HIGH[mode]
            if gap <= _LOW[mode]:
                state[_MODE + car] = _CLOSER[mode]
            elif gap >= _HIGH[mode]:
                state[_MODE + car] = _FARTHER[mode]


@compiled
def _first_end(
    time: float, lead: Floats, lead_length: int, far: float, state: Floats, course: Floats
) -> tuple[float, int]:
    """Return the share of `time` after which the first mode ends, and the car; otherwise, 2.

    `far` is a bound of the way of car 1; `course` is overwritten.
    """
    share, first = 2.0, 0
    for car in range(1, _CARS):
        mode = int(state[_MODE + car])
        gap = float(state[car]) - float(state[car - 1])
        reach, far = far, time * (float(state[_SPEED + car]) + time)
        reach += far
        if gap - _LOW[mode] <= reach or _HIGH[mode] - gap <= reach:
            end = _end(time, car, lead, lead_length, reach, state, course)
            if end < share:
                share, first = end, car
    return share, first


@compiled
def _end(
    time: float,
    car: int,
    lead: Floats,
    lead_length: int,
    reach: float,
    state: Floats,
    course: Floats,
) -> float:
    """Return the share of `time` after which a follower's mode ends; 2 if it does not.

    `reach` is a bound of the change of its gap; `course` is overwritten.
    """
    mode = int(state[_MODE + car])
    gap = float(state[car]) - float(state[car - 1])
    course[:] = 0.0
    length = _follow(1.0, time, car, state, course)
    if car == 1:
        for power in range(1, lead_length):
            course[power] -= lead[power]
        length = max(length, lead_length)
    else:
        length = max(length, _follow(-1.0, time, car - 1, state, course))
    course[0] = gap
    end = 2.0
    if gap - _LOW[mode] <= reach:
        end = first_crossing(course, length, _LOW[mode], 1.0)
    if _HIGH[mode] - gap <= reach:
        end = min(end, first_crossing(course, length, _HIGH[mode], -1.0))
    return end


@compiled
def _start(parameters: Floats, noise: Floats, state: Floats, observation: Floats) -> None:  # noqa: ARG001 - as every scenario's
    state[:] = 0.0
    for car in range(_CARS):
        state[car] = car * parameters[0]
    _switch(state)
    observation[:] = state[:_CARS]


@compiled
def _step(
    action: Floats,
    parameters: Floats,  # noqa: ARG001 - as every scenario's
    noise: Floats,  # noqa: ARG001 - as every scenario's
    state: Floats,
    observation: Floats,
) -> None:
    throttle, brake = float(action[0]), float(action[1])
    throttle_change, brake_change = 0.0, 0.0
    if state[_HAS_ACTION] == 1.0:
        throttle_change = throttle - float(state[_THROTTLE])
        brake_change = brake - float(state[_BRAKE])
    lead, course = np.empty(_LENGTH), np.empty(_LENGTH)
    remainder = _PERIOD
    while remainder > 0.0:
        left = remainder / _PERIOD
        pedals = (
            throttle - throttle_change * left,
            throttle_change * left,
            brake - brake_change * left,
            brake_change * left,
        )
        speed = float(state[_SPEED])
        travel, change, far, length = _lead(remainder, *pedals, speed, lead)
        share, car = _first_end(remainder, lead, length, far, state, course)
        time = remainder
        if share < 1.0:
            time = share * remainder
            travel, change, far, length = _lead(
                time,
                pedals[0],
                share * pedals[1],
                pedals[2],
                share * pedals[3],
                speed,
                lead,
            )
        state[0] += travel
        state[_SPEED] = speed + change
        _advance(time, state)
        if car > 0:
            mode = int(state[_MODE + car])
            gap = state[car] - state[car - 1]
            near = gap - _LOW[mode] < _HIGH[mode] - gap
            state[_MODE + car] = _CLOSER[mode] if near else _FARTHER[mode]
            _switch(state)
        remainder = remainder - time if share < 1.0 else 0.0
    state[_THROTTLE], state[_BRAKE], state[_HAS_ACTION] = throttle, brake, 1.0
    observation[:] = state[:_CARS]


@compiled
def _baseline(time: float, observation: Floats, parameters: Floats, action: Floats) -> None:  # noqa: ARG001 - as every scenario's
    """Bring car 1 to a steady 0.5 m/s, which satisfies all requirements."""
    action[0] = 0.5
    action[1] = 1.0


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Plot the gaps with their guards, and the inputs below."""
    from rtamt_gym.drawing import OPEN, SIGNAL, tidy

    plots = figure.subplots(5, 1, sharex=True)
    gaps = np.diff(episode.observations, axis=1)
    for i in range(4):
        ax = plots[3 - i]
        tidy(ax, f"y{i + 2} - y{i + 1} [m]")
        ax.plot(episode.times, gaps[:, i], color=SIGNAL, linewidth=1.0)
        for guard in (5.0, 10.0, 15.0, 20.0):
            ax.axhline(guard, color=OPEN, linewidth=0.7, linestyle=(0, (4, 3)))
    tidy(plots[4], "input")
    for name, values, colour in zip(
        ("throttle", "brake"), episode.actions.T, (SIGNAL, "#D55E00"), strict=True
    ):
        plots[4].plot(episode.times[1:], values, color=colour, linewidth=1.2, label=name)
    plots[4].set_ylim(-0.05, 1.05)
    plots[4].legend(fontsize=8.5, frameon=False, ncols=2, loc="upper right")
    plots[4].set_xlabel("time [s]", fontsize=9.5)


SCENARIO = Scenario(
    name="ChasingCars",
    title="Five cars that follow one another",
    source="J. Hu, J. Lygeros, S. Sastry: Towards a theory of stochastic hybrid systems, HSCC 2000",
    period=_PERIOD,
    duration=100.0,
    actions=(Quantity("throttle", "", 0.0, 1.0), Quantity("brake", "", 0.0, 1.0)),
    observations=tuple(Quantity(f"y{car + 1}", "m") for car in range(_CARS)),
    parameters=(
        Parameter("gap", 6.0, 14.0, default=10.0, unit="m", about="between two cars at the start"),
    ),
    inputs=(
        Signal("throttle", 0.0, 1.0, points=10, interpolation="linear"),
        Signal("brake", 0.0, 1.0, points=10, interpolation="linear"),
    ),
    requirements="""
CC1 = always[0:100](y5 - y4 <= 40)
CC2 = always[0:70](eventually[0:30](y5 - y4 >= 15))
CC3 = always[0:80](always[0:20](y2 - y1 <= 20) or eventually[0:20](y5 - y4 >= 40))
CC4 = always[0:65](eventually[0:30](always[0:5](y5 - y4 >= 8)))
CC5 = always[0:72](eventually[0:8](always[0:5](y2 - y1 >= 9) implies always[5:20](y5 - y4 >= 9)))
CCx = (
    always[0:50](y2 - y1 > 7.5)
    and always[0:50](y3 - y2 > 7.5)
    and always[0:50](y4 - y3 > 7.5)
    and always[0:50](y5 - y4 > 7.5)
)
""",
    state=_STATE,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)
