"""Two service robots that carry things between stations of a room, and keep a distance.

The robots are discs that roll in any direction. The velocity of each follows its command as a
first-order system with time constant ``lag``, solved exactly for a constant command over the step.
Gaussian ``noise`` with this standard deviation, in m/s, is added to the commands. Walls stop a
robot. The robots do not stop each other: if they overlap, the requirement ``apart`` is violated.
The first robot goes between kitchen and desk, the second between shelf and door, so their paths
cross in the middle of the room. Requirements read the positions.

The baseline goes straight to the next station. Within ``caution`` metres of the other robot, it
gives way to the right.

:func:`parallel_env` is the scenario as a parallel environment of PettingZoo, with an agent per
robot.

Source: two robots in one room are the second case study of D. Nickovic, T. Yamaguchi: RTAMT: Online
Robustness Monitors from STL, ATVA 2020. The room, the dynamics, the numbers and the baseline
are inventions of this model, and were not compared with a robot.
"""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from rtamt import InputError, StateError
from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import EpisodeSoFar, Quantity, Scenario
from rtamt_gym.inputs.space import Parameter, Signal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gymnasium import spaces
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

if TYPE_CHECKING or find_spec("pettingzoo"):
    from pettingzoo.utils import ParallelEnv
else:

    class ParallelEnv:
        """A stand-in for the class of PettingZoo if it is not installed."""


PERIOD = 0.1
RADIUS = 0.3
"""Radius of a robot, in metres."""
WIDTH, HEIGHT = 8.0, 6.0
"""The walls are at 0 and WIDTH, 0 and HEIGHT, in metres."""
NAMES = ("kitchen", "desk", "shelf", "door")
STATIONS = np.array([[1.0, 1.0], [7.0, 5.0], [1.0, 5.0], [7.0, 1.0]])
"""The first two are the stations of the first robot, the others of the second; in metres."""
REACHED = 0.2
"""A station is reached at this distance, in metres."""

APART = 0.8
"""The required distance between the centres of the robots, in metres."""

OTHER = "#D55E00"
"""The colour of the second robot."""

LAG, NOISE, SPEED, CAUTION, START = range(5)  # four parameters begin at START
VELOCITY, STATION = 4, 8  # indices of the state, after the positions; a station is 0 or 1


@compiled
def _observe(state: Array, observation: Array) -> None:
    """Fill the positions, then the next stations."""
    for i in range(4):
        observation[i] = state[i]
    for robot in range(2):
        station = 2 * robot + int(state[STATION + robot])
        observation[4 + 2 * robot] = STATIONS[station, 0]
        observation[5 + 2 * robot] = STATIONS[station, 1]


@compiled
def _start(parameters: Array, noise: Array, state: Array, observation: Array) -> None:  # noqa: ARG001 - robots at rest have no noise
    """Start at rest; each robot goes to its second station first."""
    for i in range(4):
        state[i] = parameters[START + i]
        state[VELOCITY + i] = 0.0
    state[STATION] = 1.0
    state[STATION + 1] = 1.0
    _observe(state, observation)


@compiled
def _step(action: Array, parameters: Array, noise: Array, state: Array, observation: Array) -> None:
    """Update the velocities exactly, and move; walls stop a robot."""
    lag = parameters[LAG]
    fade = math.exp(-PERIOD / lag) if lag > 0.0 else 0.0
    for i in range(4):
        command = action[i] + parameters[NOISE] * noise[i]
        error = state[VELOCITY + i] - command
        position = state[i] + command * PERIOD + error * lag * (1.0 - fade)
        velocity = command + error * fade
        end = (WIDTH if i % 2 == 0 else HEIGHT) - RADIUS
        if position < RADIUS:
            position, velocity = RADIUS, 0.0
        elif position > end:
            position, velocity = end, 0.0
        state[i] = position
        state[VELOCITY + i] = velocity
    for robot in range(2):
        station = 2 * robot + int(state[STATION + robot])
        right = STATIONS[station, 0] - state[2 * robot]
        up = STATIONS[station, 1] - state[2 * robot + 1]
        if right * right + up * up <= REACHED * REACHED:
            state[STATION + robot] = 1.0 - state[STATION + robot]
    _observe(state, observation)


@compiled
def _baseline(time: float, observation: Array, parameters: Array, action: Array) -> None:  # noqa: ARG001 - it does not need the time
    """Go straight to the station; near the other robot, give way to the right."""
    for robot in range(2):
        x, y = observation[2 * robot], observation[2 * robot + 1]
        right, up = observation[4 + 2 * robot] - x, observation[5 + 2 * robot] - y
        distance = math.sqrt(right * right + up * up)
        speed = min(parameters[SPEED], distance) / max(distance, 1e-9)
        right, up = speed * right, speed * up
        to_x, to_y = observation[2 - 2 * robot] - x, observation[3 - 2 * robot] - y
        gap = math.sqrt(to_x * to_x + to_y * to_y)
        if 0.0 < gap < parameters[CAUTION]:
            urge = parameters[SPEED] * (1.0 - gap / parameters[CAUTION]) / gap
            right += urge * (2.0 * to_y - 1.5 * to_x)
            up += urge * (-2.0 * to_x - 1.5 * to_y)
        action[2 * robot] = max(-1.0, min(1.0, right))
        action[2 * robot + 1] = max(-1.0, min(1.0, up))


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Draw the room with the paths of both robots, and their distance over time."""
    from matplotlib.patches import Circle

    from rtamt_gym.drawing import SIGNAL, tidy

    room, distance = figure.subplots(2, 1, height_ratios=[2.6, 1.0])
    tidy(room, "y [m]")
    room.set(xlabel="x [m]", aspect="equal", xlim=(0, WIDTH), ylim=(0, HEIGHT))
    for name, (x, y) in zip(NAMES, STATIONS, strict=True):
        room.plot(x, y, "s", color="0.7", markersize=9)
        below = -17 if y < HEIGHT / 2 else 9
        room.annotate(name, (x, y), (0, below), textcoords="offset points", ha="center")
    positions = episode.observations[:, :4]
    for robot, colour in enumerate((SIGNAL, OTHER)):
        x, y = positions[:, 2 * robot : 2 * robot + 2].T
        room.plot(x, y, color=colour, linewidth=1.0, label=f"robot {robot + 1}")
        room.add_patch(Circle((x[-1], y[-1]), RADIUS, color=colour, alpha=0.6))
    room.legend(loc="upper center", fontsize=8.5, frameon=False, ncols=2)
    tidy(distance, "distance [m]")
    gaps = np.hypot(*(positions[:, :2] - positions[:, 2:]).T)
    distance.plot(episode.times, gaps, color="k", linewidth=1.0)
    distance.axhline(APART, color="0.5", linestyle="--", linewidth=0.8)
    distance.set(xlabel="time [s]", xlim=(0, SCENARIO.duration), ylim=(0, None))


def _to(robot: int, station: int) -> str:
    """Return the distance of a robot to a station, as a term."""
    x, y = STATIONS[station]
    return f"sqrt(pow(x{robot} - {x:g}, 2) + pow(y{robot} - {y:g}, 2))"


SCENARIO = Scenario(
    name="TwoServiceRobots",
    title="Two service robots in a room",
    source=(
        "D. Nickovic, T. Yamaguchi: RTAMT: Online Robustness Monitors from STL, ATVA 2020 "
        "(two robots in a room; the model is not from the paper)"
    ),
    period=PERIOD,
    duration=60.0,
    actions=(
        Quantity("vx1", "m/s", -1.0, 1.0),
        Quantity("vy1", "m/s", -1.0, 1.0),
        Quantity("vx2", "m/s", -1.0, 1.0),
        Quantity("vy2", "m/s", -1.0, 1.0),
    ),
    observations=(
        Quantity("x1", "m", 0.0, WIDTH),
        Quantity("y1", "m", 0.0, HEIGHT),
        Quantity("x2", "m", 0.0, WIDTH),
        Quantity("y2", "m", 0.0, HEIGHT),
        Quantity("next_x1", "m", 0.0, WIDTH),
        Quantity("next_y1", "m", 0.0, HEIGHT),
        Quantity("next_x2", "m", 0.0, WIDTH),
        Quantity("next_y2", "m", 0.0, HEIGHT),
    ),
    parameters=(
        Parameter("lag", 0.0, 1.0, default=0.2, unit="s", about="time constant of the velocities"),
        Parameter(
            "noise", 0.0, 0.3, default=0.02, unit="m/s", about="standard deviation of the commands"
        ),
        Parameter("speed", 0.2, 1.0, default=0.8, unit="m/s", about="speed of the baseline"),
        Parameter(
            "caution",
            0.0,
            2.5,
            default=1.5,
            unit="m",
            about="distance at which the baseline gives way",
        ),
        Parameter(
            "start_x1", 0.5, 2.0, default=1.0, unit="m", about="position of robot 1 at the start"
        ),
        Parameter(
            "start_y1", 0.5, 2.0, default=1.0, unit="m", about="position of robot 1 at the start"
        ),
        Parameter(
            "start_x2", 0.5, 2.0, default=1.0, unit="m", about="position of robot 2 at the start"
        ),
        Parameter(
            "start_y2", 4.0, 5.5, default=5.0, unit="m", about="position of robot 2 at the start"
        ),
    ),
    inputs=(
        Signal("vx1", -1.0, 1.0, points=12),
        Signal("vy1", -1.0, 1.0, points=12),
        Signal("vx2", -1.0, 1.0, points=12),
        Signal("vy2", -1.0, 1.0, points=12),
    ),
    requirements=f"""
        separation = sqrt(pow(x1 - x2, 2) + pow(y1 - y2, 2))  // metres
        apart = always(separation >= {APART})
        kitchen = {_to(1, 0)}
        desk = {_to(1, 1)}
        shelf = {_to(2, 2)}
        door = {_to(2, 3)}
        serves1 = eventually[0:30s](desk <= 0.3 and eventually[0:30s](kitchen <= 0.3))
        serves2 = eventually[0:30s](door <= 0.3 and eventually[0:30s](shelf <= 0.3))
    """,
    state=10,
    noise=4,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)


class ParallelRobots(ParallelEnv):  # type: ignore[misc]  # it has no types
    """The two robots as agents of a parallel environment of PettingZoo.

    The agents are ``"robot_1"`` and ``"robot_2"``. An action is the commanded velocity (vx, vy) in
    m/s. An observation has the positions of the agent, of its next station and of the other robot:
    (x, y, next x, next y, other x, other y) in metres. Rewards are 0; the time limit truncates the
    episode of both. It also works without PettingZoo.

    Attributes:
        requirements: The requirements of the scenario by name, for ``ParallelStlMonitor``.
        signals: The selectors of their variables: ``{"x1": "robot_1: obs[0]", ...}``.
        dt: Seconds between two observations.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - PettingZoo's own, a dict of the class
        "name": "two_service_robots_v0",
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / PERIOD),
        "is_parallelizable": True,
    }

    def __init__(
        self, parameters: Mapping[str, float] | None = None, render_mode: str | None = None
    ) -> None:
        import gymnasium as gym  # here, because the robots run on ROS without it
        from gymnasium import spaces

        self._env = gym.make(
            f"rtamt/{SCENARIO.name}-v0", parameters=parameters, render_mode=render_mode
        )
        self.render_mode = render_mode
        self.possible_agents = ["robot_1", "robot_2"]
        self.agents: list[str] = []
        self.requirements = SCENARIO.specifications
        self.signals = {
            f"{axis}{robot}": f"robot_{robot}: obs[{index}]"
            for robot in (1, 2)
            for index, axis in enumerate(("x", "y", "next_x", "next_y"))
        }
        self.dt = PERIOD
        corner = np.array([WIDTH, HEIGHT])
        self._observation_spaces = {
            agent: spaces.Box(np.zeros(6), np.tile(corner, 3), dtype=np.float64)
            for agent in self.possible_agents
        }
        self._action_spaces = {
            agent: spaces.Box(-1.0, 1.0, (2,), np.float64) for agent in self.possible_agents
        }

    @property
    def unwrapped(self) -> ParallelRobots:
        """The environment itself."""
        return self

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the observation space of an agent, in metres."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """Return the action space of an agent, in m/s along x and y."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Start an episode.

        Args:
            seed: The seed of the noise, as for the scenario.
            options: ``{"parameters": {"lag": 0.5}}`` sets parameters of this episode. Other options
                are ignored, because PettingZoo passes them to every layer.

        Raises:
            InputError: If a parameter is unknown, is not a number, or is among the options
                themselves.
        """
        own_options = options or {}
        for name in {parameter.name for parameter in SCENARIO.parameters} & set(own_options):
            raise InputError(
                f"{name!r} is a parameter; write options={{'parameters': {{{name!r}: "
                f"{own_options[name]!r}}}}}"
            )
        parameters = own_options.get("parameters")
        joint, info = self._env.reset(seed=seed, options=parameters)
        self.agents = [*self.possible_agents]
        return self._split(joint), {agent: dict(info) for agent in self.agents}

    def step(
        self, actions: Mapping[str, Array]
    ) -> tuple[
        dict[str, Array],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Move both robots for one period.

        Raises:
            StateError: Before :meth:`reset`, and after the end of an episode.
            InputError: If an agent has no action, or an action is wrong.
        """
        agents = self.agents
        if not agents:
            raise StateError("no episode runs; call reset() first")
        if set(actions) != set(agents):
            raise InputError(
                f"expected an action of {' and '.join(agents)}, got actions of "
                f"{', '.join(map(str, actions)) or 'none'}"
            )
        action = np.concatenate([actions[agent] for agent in agents])
        joint, reward, terminated, truncated, info = self._env.step(action)
        if terminated or truncated:
            self.agents = []
        return (
            self._split(joint),
            dict.fromkeys(agents, float(reward)),
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            {agent: dict(info) for agent in agents},
        )

    def state(self) -> Array:
        """Return the joint observation of the scenario."""
        return self._joint.copy()

    def render(self) -> Any:  # noqa: ANN401 - as the environment has it
        """Draw the episode so far."""
        return self._env.render()

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def _split(self, joint: Array) -> dict[str, Array]:
        self._joint = joint
        return {
            "robot_1": joint[[0, 1, 4, 5, 2, 3]],
            "robot_2": joint[[2, 3, 6, 7, 0, 1]],
        }


def parallel_env(
    parameters: Mapping[str, float] | None = None, render_mode: str | None = None
) -> ParallelRobots:
    """Return the two robots as a parallel environment, like a module of PettingZoo.

    Example:
        >>> import numpy as np
        >>> from rtamt_envs.two_service_robots import parallel_env
        >>> from rtamt_gym import ParallelStlMonitor
        >>> env = parallel_env()
        >>> env = ParallelStlMonitor(env, env.requirements)
        >>> observations, infos = env.reset(seed=0)
        >>> while env.agents:
        ...     right = {agent: np.array([1.0, 0.0]) for agent in env.agents}
        ...     observations, _, _, _, infos = env.step(right)
        >>> infos["robot_1"]["stl_violated_by"], infos["robot_1"]["stl_violated_at"]
        ('serves1', 300)
    """
    return ParallelRobots(parameters, render_mode)
