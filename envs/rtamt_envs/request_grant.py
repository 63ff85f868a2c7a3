"""Requests of a client and the grants of a server: the smallest example of inputs and outputs.

The server grants the request of ``delay`` seconds ago, at most ``limit``, with Gaussian noise.
Requests are the input of the requirement, and grants are its output. With interface-aware semantics
(``semantics="output-robustness"``, ``"input-vacuity"``), robustness shows whether the input or the
output satisfies the requirement. Requests and grants are levels without a unit.

The baseline requests a ``height`` for ``length`` seconds. The four signals of the paper are

* (a) default parameters: request 6, grant 6; robustness 3,
* (b) ``height=2``: a request below the level that counts; robustness 1, and vacuous, unlike (a),
* (c) ``limit=1``: request 6, grant 1; robustness -2,
* (d) ``height=4, limit=1``: robustness -1, while the output is 2 too low.

Source: T. Yamaguchi, B. Hoxha, D. Nickovic: RTAMT - Runtime Robustness Monitors with Application to
CPS and Robotics, STTT 2024, the figure of the four signals. The paper only draws signals. The
server with a delay is an assumption of this model, and its noise is not validated.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import EpisodeSoFar, Quantity, Scenario
from rtamt_gym.inputs.space import Parameter, Signal

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


PERIOD = 0.1
LONGEST = 10.0
"""The longest delay, in seconds."""
KEPT = round(LONGEST / PERIOD) + 1
"""The number of requests in the state."""

COUNTS = 3.0
"""The level from which a request and a grant count."""
GRANT = "#D55E00"
"""The colour of grants."""

DELAY, LIMIT, NOISE, HEIGHT, ONSET, LENGTH = range(6)


@compiled
def _grant(request: float, parameters: Array, noise: Array) -> float:
    """Return the level that the server grants: limited, with noise, and not negative."""
    level: float = min(request, parameters[LIMIT]) + parameters[NOISE] * noise[0]
    return max(level, 0.0)


@compiled
def _start(parameters: Array, noise: Array, state: Array, observation: Array) -> None:
    """Start without requests; ``state`` is the number of steps and a ring of requests."""
    for i in range(KEPT + 1):
        state[i] = 0.0
    observation[0] = 0.0
    observation[1] = _grant(0.0, parameters, noise)


@compiled
def _step(action: Array, parameters: Array, noise: Array, state: Array, observation: Array) -> None:
    """Take the action as the request at the end of the step."""
    steps = int(state[0]) + 1
    delay = math.floor(min(parameters[DELAY], LONGEST) / PERIOD + 0.5)
    state[0] = steps
    state[1 + steps % KEPT] = action[0]
    # The ring holds zeros for times before the start.
    requested = state[1 + (steps + KEPT - delay) % KEPT]
    observation[0] = action[0]
    observation[1] = _grant(requested, parameters, noise)


@compiled
def _baseline(time: float, observation: Array, parameters: Array, action: Array) -> None:  # noqa: ARG001 - a client does not wait for grants
    """Make one request, at the samples nearest to its time."""
    since = time + PERIOD - parameters[ONSET] + PERIOD / 2.0
    lasts = 0.0 <= since < parameters[LENGTH]
    action[0] = parameters[HEIGHT] if lasts else 0.0


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Draw both signals as steps, and the level from which they count."""
    from rtamt_gym.drawing import SIGNAL, tidy

    ax = figure.subplots()
    tidy(ax, "level")
    times, (requests, grants) = episode.times, episode.observations.T
    ax.step(times, requests, where="post", color=SIGNAL, label="req")
    ax.step(times, grants, where="post", color=GRANT, linestyle="-.", label="gnt")
    ax.axhline(COUNTS, color="0.5", linestyle="--", linewidth=0.8)
    ax.set(xlabel="time [s]", xlim=(0, SCENARIO.duration), ylim=(0, 8))
    ax.legend(loc="upper right", frameon=False)


SCENARIO = Scenario(
    name="RequestGrant",
    title="Requests of a client and grants of a server",
    source=(
        "T. Yamaguchi, B. Hoxha, D. Nickovic: RTAMT - Runtime Robustness Monitors with "
        "Application to CPS and Robotics, STTT 2024"
    ),
    period=PERIOD,
    duration=15.0,
    actions=(Quantity("request", "", 0.0, 8.0),),
    observations=(Quantity("req", "", 0.0, 8.0), Quantity("gnt", "", 0.0, math.inf)),
    parameters=(
        Parameter("delay", 0.0, LONGEST, default=4.0, unit="s", about="from request to grant"),
        Parameter("limit", 0.0, 8.0, default=8.0, about="the largest grant"),
        Parameter("noise", 0.0, 1.0, default=0.0, about="standard deviation of the grants"),
        Parameter("height", 0.0, 8.0, default=6.0, about="the request of the baseline"),
        Parameter("onset", 0.0, 10.0, default=2.0, unit="s", about="the start of this request"),
        Parameter("length", 0.0, 10.0, default=2.0, unit="s", about="the duration of this request"),
    ),
    inputs=(Signal("request", 0.0, 8.0, points=15),),
    requirements=f"""
        input float req
        output float gnt
        granted = always[0:10s](req >= {COUNTS:g} implies eventually[0:5s](gnt >= {COUNTS:g}))
    """,
    state=1 + KEPT,
    noise=1,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)
