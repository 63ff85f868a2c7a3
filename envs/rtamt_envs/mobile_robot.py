"""A robot on two wheels that follows velocity commands through two rooms.

The robot is a disc. Every 0.1 s its twist, a forward speed and a turn rate, follows the command: at
once, or with a first-order ``lag`` in seconds. Gaussian ``noise`` has this fraction of the twist as
its standard deviation. The pose is integrated exactly for a constant twist over the step: the robot
drives an arc of a circle. If a step would end in a wall, the pose stays, and the twist still
follows the command. Odometry is the pose and the twist at the end of the step. Wheels, inertia and
range sensors are not modelled.

The simulator STDR moves a robot like this. The paper requires ``follows`` of its first robot, which
a person drives: it follows its commands within 0.5 m/s. The lag, the rooms, the other requirements
and the baseline, which drives through the door to a desk and then to a dock, are inventions of this
model. It was not compared with a robot or with runs of STDR. Its noise is the usual velocity model
(S. Thrun, W. Burgard, D. Fox: Probabilistic Robotics, 2005) without cross terms.

:func:`unicycle`, :func:`clearance`, :func:`next_point` and :func:`drive` are the functions of the
model and the baseline; `rtamt_ros.simulator` runs both as nodes of ROS.

Sources: D. Nickovic, T. Yamaguchi: RTAMT: Online Robustness Monitors from STL, ATVA 2020; the
motion controller of the STDR simulator, 0.3.2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import EpisodeSoFar, Quantity, Scenario
from rtamt_gym.inputs.space import Parameter, Signal

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


PERIOD = 0.1
RADIUS = 0.2
"""Radius of the robot, in metres."""
WIDTH, HEIGHT = 10.0, 7.0
"""The outer walls are at 0 and WIDTH, 0 and HEIGHT, in metres."""
OBSTACLES = np.array(
    [
        [4.9, 0.0, 5.1, 2.6],  # the wall between the rooms, with a door of 1.8 m
        [4.9, 4.4, 5.1, 7.0],
        [0.0, 6.2, 3.2, 7.0],  # shelf
        [1.4, 3.6, 2.4, 4.4],  # table
        [6.4, 2.2, 7.8, 3.2],  # table
        [9.2, 0.0, 10.0, 1.6],  # cupboard
    ]
)
"""Obstacles: rectangles (minimum x, minimum y, maximum x, maximum y), in metres."""
ROUTE = np.array([[4.2, 3.5], [5.8, 3.6], [8.8, 5.6], [8.8, 2.6], [7.6, 1.2], [6.2, 1.0]])
"""The points of the baseline, in order."""
DESK, DOCK = ROUTE[2], ROUTE[5]
REACHED = 0.2
"""A point is reached at this distance, in metres."""

COMMAND, GOAL = "#D55E00", "#009E73"
"""Colours of the picture."""

LAG, NOISE, START_X, START_Y, START_HEADING = range(5)
X, Y, TURNED, SPEED, TURN, POINT = range(6)  # of the state; speed and turn are without noise


@compiled
def unicycle(
    x: float, y: float, heading: float, v: float, w: float, seconds: float
) -> tuple[float, float, float]:
    """Return the exact pose after an arc of a circle, with a constant twist.

    Args:
        x: Metres.
        y: Metres.
        heading: Radians, 0 towards x, counter-clockwise.
        v: Forward speed, in m/s.
        w: Turn rate, in rad/s.
        seconds: The duration.

    Returns:
        x, y, and the heading, which stays in (-pi, pi] if the robot turns less than once.
    """
    half = 0.5 * w * seconds
    # The chord of the arc; the series is exact to the last bit for such a small angle.
    chord = v * seconds * (math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0)
    turned = heading + w * seconds
    if turned > math.pi:
        turned -= 2.0 * math.pi
    elif turned <= -math.pi:
        turned += 2.0 * math.pi
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), turned


@compiled
def clearance(x: float, y: float) -> float:
    """Return the distance to the nearest obstacle in metres; at most 0 on contact."""
    nearest = x
    for gap in (WIDTH - x, y, HEIGHT - y):
        nearest = min(nearest, gap)
    for i in range(OBSTACLES.shape[0]):
        across = max(OBSTACLES[i, 0] - x, x - OBSTACLES[i, 2], 0.0)
        along = max(OBSTACLES[i, 1] - y, y - OBSTACLES[i, 3], 0.0)
        gap = math.sqrt(across * across + along * along)
        nearest = min(nearest, gap)
    return nearest - RADIUS


@compiled
def next_point(x: float, y: float, point: int) -> int:
    """Return the index of the next point of `ROUTE`, one higher if this point is reached."""
    ahead, left = ROUTE[point, 0] - x, ROUTE[point, 1] - y
    reached = ahead * ahead + left * left <= REACHED * REACHED
    return point + 1 if reached and point < ROUTE.shape[0] - 1 else point


@compiled
def _observe(v: float, w: float, state: Array, observation: Array) -> None:
    """Fill odometry, clearance and the next point."""
    observation[0] = state[X]
    observation[1] = state[Y]
    observation[2] = state[TURNED]
    observation[3] = v
    observation[4] = w
    observation[7] = clearance(state[X], state[Y])
    point = int(state[POINT])
    observation[8] = ROUTE[point, 0]
    observation[9] = ROUTE[point, 1]


@compiled
def _start(parameters: Array, noise: Array, state: Array, observation: Array) -> None:  # noqa: ARG001 - a robot at rest has no noise
    """Start at rest, without a command."""
    state[X] = parameters[START_X]
    state[Y] = parameters[START_Y]
    state[TURNED] = parameters[START_HEADING]
    state[SPEED] = 0.0
    state[TURN] = 0.0
    state[POINT] = 0.0
    observation[5] = 0.0
    observation[6] = 0.0
    _observe(0.0, 0.0, state, observation)


@compiled
def _step(action: Array, parameters: Array, noise: Array, state: Array, observation: Array) -> None:
    """Update the twist, and move unless a wall is in the way."""
    fade = math.exp(-PERIOD / parameters[LAG]) if parameters[LAG] > 0.0 else 0.0
    state[SPEED] = action[0] + fade * (state[SPEED] - action[0])
    state[TURN] = action[1] + fade * (state[TURN] - action[1])
    v = state[SPEED] * (1.0 + parameters[NOISE] * noise[0])
    w = state[TURN] * (1.0 + parameters[NOISE] * noise[1])
    x, y, heading = unicycle(state[X], state[Y], state[TURNED], v, w, PERIOD)
    if clearance(x, y) > 0.0:
        state[X] = x
        state[Y] = y
        state[TURNED] = heading
    state[POINT] = next_point(state[X], state[Y], int(state[POINT]))
    observation[5] = action[0]
    observation[6] = action[1]
    _observe(v, w, state, observation)


@compiled
def drive(x: float, y: float, heading: float, goal_x: float, goal_y: float) -> tuple[float, float]:
    """Return the command towards a goal: turn and drive, slower while turning; stop at the goal.

    Returns:
        Forward speed in m/s, turn rate in rad/s.
    """
    ahead, left = goal_x - x, goal_y - y
    distance = math.sqrt(ahead * ahead + left * left)
    if distance <= REACHED:
        return 0.0, 0.0
    error = math.atan2(left, ahead) - heading
    error = math.atan2(math.sin(error), math.cos(error))
    return 0.8 * max(0.0, math.cos(error)) * min(1.0, distance), max(-1.5, min(1.5, 2.0 * error))


@compiled
def _baseline(time: float, observation: Array, parameters: Array, action: Array) -> None:  # noqa: ARG001 - it needs the observation only
    """Drive to the next point."""
    action[0], action[1] = drive(
        observation[0], observation[1], observation[2], observation[8], observation[9]
    )


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Draw the rooms with the path of the robot, and commanded and true speed."""
    from matplotlib.patches import Circle, Rectangle

    from rtamt_gym.drawing import SIGNAL, tidy

    rooms, speed = figure.subplots(2, 1, height_ratios=[2.6, 1.0])
    tidy(rooms, "y [m]")
    rooms.set(xlabel="x [m]", aspect="equal", xlim=(0, WIDTH), ylim=(0, HEIGHT))
    for left, low, right, high in OBSTACLES:
        rooms.add_patch(Rectangle((left, low), right - left, high - low, color="0.75"))
    for name, position in (("desk", DESK), ("dock", DOCK)):
        rooms.plot(*position, "s", color=GOAL, markersize=6)
        rooms.annotate(name, position, (0, 8), textcoords="offset points", ha="center")
    x, y, heading, v = episode.observations[:, :4].T
    rooms.plot(x, y, color=SIGNAL)
    rooms.add_patch(Circle((x[-1], y[-1]), RADIUS, color=SIGNAL, alpha=0.6))
    nose = RADIUS * np.cos(heading[-1]), RADIUS * np.sin(heading[-1])
    rooms.plot([x[-1], x[-1] + nose[0]], [y[-1], y[-1] + nose[1]], color="k", linewidth=1)
    tidy(speed, "speed [m/s]")
    command = episode.observations[:, 5]
    speed.plot(episode.times, command, color=COMMAND, linewidth=1.0, label="command")
    speed.plot(episode.times, v, color=SIGNAL, linewidth=1.0, label="robot")
    speed.set(xlabel="time [s]", xlim=(0, SCENARIO.duration))
    speed.legend(loc="upper right", fontsize=8.5, frameon=False, ncols=2)


def _to(point: Array) -> str:
    """Return the distance of the robot to a point, as a term."""
    return f"sqrt(pow(x - {point[0]:g}, 2) + pow(y - {point[1]:g}, 2))"


SCENARIO = Scenario(
    name="MobileRobot",
    title="A mobile robot that follows commands",
    source=(
        "D. Nickovic, T. Yamaguchi: RTAMT: Online Robustness Monitors from STL, ATVA 2020; "
        "the STDR simulator"
    ),
    period=PERIOD,
    duration=60.0,
    actions=(Quantity("linear", "m/s", -1.0, 1.0), Quantity("angular", "rad/s", -2.0, 2.0)),
    observations=(
        Quantity("x", "m", 0.0, WIDTH),
        Quantity("y", "m", 0.0, HEIGHT),
        Quantity("heading", "rad", -math.pi, math.pi),
        Quantity("v", "m/s", -math.inf, math.inf),
        Quantity("w", "rad/s", -math.inf, math.inf),
        Quantity("cmd_v", "m/s", -1.0, 1.0),
        Quantity("cmd_w", "rad/s", -2.0, 2.0),
        Quantity("clearance", "m", 0.0, WIDTH),
        Quantity("next_x", "m", 0.0, WIDTH),
        Quantity("next_y", "m", 0.0, HEIGHT),
    ),
    parameters=(
        Parameter("lag", 0.0, 2.0, default=0.0, unit="s", about="time constant of the twist"),
        Parameter(
            "noise", 0.0, 0.5, default=0.05, about="standard deviation, relative to the twist"
        ),
        Parameter("start_x", 0.6, 2.4, default=1.2, unit="m", about="position at the start"),
        Parameter("start_y", 0.6, 2.4, default=1.2, unit="m", about="position at the start"),
        Parameter(
            "start_heading", -3.1, 3.1, default=0.0, unit="rad", about="heading at the start"
        ),
    ),
    inputs=(Signal("linear", -1.0, 1.0, points=12), Signal("angular", -2.0, 2.0, points=12)),
    requirements=f"""
        follows = always(abs(cmd_v - v) <= 0.5)
        clear = always(clearance >= 0.1)
        desk = {_to(DESK)}  // metres
        dock = {_to(DOCK)}
        visits = eventually[0:30s](desk <= 0.3 and eventually[0:30s](dock <= 0.3))
    """,
    state=6,
    noise=2,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)
