"""The elevators of an aircraft with redundant actuators and hydraulic circuits, under faults.

The case study of T. Yamaguchi, B. Hoxha, D. Nickovic: RTAMT - Runtime Robustness Monitors with
Application to CPS and Robotics, STTT 2024, on the model of P. J. Mosterman and J. Ghidella: Model
Reuse for the Training of Fault Scenarios in Aerospace, AIAA Modeling and Simulation Technologies
Conference 2004, paper 2004-4931, and MathWorks' documentation of it (Detect Faults in Aircraft
Elevator Control System).

Each side has an elevator that an outer and an inner hydraulic actuator can move. Circuit H1 serves
the left outer actuator, H2 both inner ones, H3 the right outer one, at 1000 kPa. While nothing
fails the outer actuators are active, under a PID law sampled every 0.01 s, and the inner ones stand
by, under a proportional law. Monitors watch pressures and positions, and a mode logic
(`aircraft_elevator_modes`) turns off or isolates what has failed and sets the other actuator of the
side to work, and with it the same actuator of the other side.

Positions are in cm, pressures in kPa, times in s. The action is the pilot's command, held over the
step; the first step starts from rest at command 0. An observation is taken at the end of a step:
`pc` is the command of that step, `lep` and `rep` are the positions of the elevators, the modes are
those decided at that time (0 Isolated, 1 Off, 2 Passive, 3 Standby, 4 Active), and `p1` to `p3` are
the pressures as the monitors see them, the middle of three sensors each.

A fault begins at the first sample at or after its time, and never ends. Supply and reading of a
lost circuit fall to 0. A failed position reads 100 cm; the actuator itself still works, it is the
monitors that rule it out.

As in the source, the pressure across a piston follows the same equation whether the piston pushes
or not. So an actuator that takes over starts from a pressure that does not fit the
position, and the elevator jumps and swings for half a second: by 1 or 2 cm where an inner actuator
takes over, by 5 cm and more where an outer one does that has stood by through a step of the
command, as its law is the stronger one. Beyond 10 cm the monitors take the jump for a failure and
isolate the actuator: with H1 lost at 4 s, H2 at 5 s and an amplitude of 1.5 cm, both sides are
lost. A bypass would take the pressure off; the equations have none.

What is not validated. The equations are solved to 1e-6 cm while nothing fails, and to 1e-5 of the
greatest position where it jumps; but they have not been compared with the Simulink model, nor with
an aircraft. How fast a lost circuit empties, what a failed sensor reads and the noise of the
pressure sensors are choices made here. In the mode logic all reactions to a failure come within one
sample; the original takes a few samples for some. The original starts in mode Passive and reaches
Active and Standby a sample later; here an episode starts there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rtamt_envs.aircraft_elevator_modes import (
    ACTIVE,
    STANDBY,
    decide,
    position_failed,
    pressure_failed,
)
from rtamt_envs.aircraft_elevator_plant import PERIOD, SIDE, advance, stepping
from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import EpisodeSoFar, Floats, Quantity, Scenario
from rtamt_gym.inputs.ranges import Parameter, Signal

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STEPPING = stepping(10)
_SUPPLY = 1000.0  # kPa
_LOST = 100.0  # cm, the reading of a failed position
_SENSORS = 3  # for each pressure

# The state: both sides, then the parts named here, then the number of samples since the start.
_MODES = 2 * SIDE
_RETURNS = _MODES + 4
_PRESSURES = _RETURNS + 4
_TICKS = _PRESSURES + 3

# The parameters: four actuators and three circuits with the times of their faults, then these.
_NOISE, _FREQUENCY, _AMPLITUDE = 7, 8, 9


@compiled
def _middle(a: float, b: float, c: float) -> float:
    return max(min(a, b), min(max(a, b), c))


@compiled
def _supply(circuit: int, time: float, parameters: Floats) -> float:
    return 0.0 if time >= parameters[4 + circuit] else _SUPPLY


@compiled
def _sense(
    command: float,
    parameters: Floats,
    noise: Floats,
    state: Floats,
    observation: Floats,
) -> None:
    """Read the sensors, decide the modes, and fill the observation."""
    first = state[_TICKS] == 0.0
    time = state[_TICKS] / 100.0
    observation[0] = command
    observation[1] = state[0]
    observation[2] = state[SIDE]
    low = np.zeros(3)
    for circuit in range(3):
        sensors = _SENSORS * circuit
        error = _middle(noise[sensors], noise[sensors + 1], noise[sensors + 2])
        reading = _supply(circuit, time, parameters) + parameters[_NOISE] * error
        previous = reading if first else state[_PRESSURES + circuit]
        low[circuit] = 1.0 if pressure_failed(reading, previous) else 0.0
        state[_PRESSURES + circuit] = reading
        observation[7 + circuit] = reading
    failed = np.zeros(4)
    for actuator in range(4):
        reading = state[0] if actuator < 2 else state[SIDE]
        if time >= parameters[actuator]:
            reading = _LOST
        failed[actuator] = 1.0 if position_failed(reading) else 0.0
    modes = state[_MODES:_RETURNS]
    decide(modes, state[_RETURNS:_PRESSURES], low, failed)
    for actuator in range(4):
        observation[3 + actuator] = modes[actuator]


@compiled
def _start(
    parameters: Floats,
    noise: Floats,
    state: Floats,
    observation: Floats,
) -> None:
    for i in range(state.shape[0]):
        state[i] = 0.0
    state[_MODES] = ACTIVE
    state[_MODES + 1] = STANDBY
    state[_MODES + 2] = STANDBY
    state[_MODES + 3] = ACTIVE
    _sense(0.0, parameters, noise, state, observation)


@compiled
def _step(
    action: Floats,
    parameters: Floats,
    noise: Floats,
    state: Floats,
    observation: Floats,
) -> None:
    time = state[_TICKS] / 100.0
    h1 = _supply(0, time, parameters)
    h2 = _supply(1, time, parameters)
    h3 = _supply(2, time, parameters)
    lo, li, ri, ro = state[_MODES], state[_MODES + 1], state[_MODES + 2], state[_MODES + 3]
    advance(state[:SIDE], action[0], (lo, li), (h1, h2), _STEPPING)
    advance(state[SIDE:_MODES], action[0], (ro, ri), (h3, h2), _STEPPING)
    state[_TICKS] += 1.0
    _sense(action[0], parameters, noise, state, observation)


@compiled
def _baseline(
    time: float,
    observation: Floats,  # noqa: ARG001 - the signature of every baseline
    parameters: Floats,
    action: Floats,
) -> None:
    """Fill the action with a square wave that starts with its upper half.

    1e-9 keeps an edge at a sample from being missed.
    """
    halves = math.floor(2.0 * parameters[_FREQUENCY] * time + 1e-9)
    upper = halves - 2.0 * math.floor(halves / 2.0) < 0.5
    action[0] = parameters[_AMPLITUDE] if upper else -parameters[_AMPLITUDE]


_REQUIREMENTS = """
// From the paper: within a second of a step up, the elevator is within 3 cm for a second. There it
// is historically(rise(pc >= 0.9) implies eventually[0:1](always[0:1](abs(pc - lep) <= 3))), told
// 2 s late: its last value speaks of the same steps as always[0:8] at the start of 10 s. Intervals
// below end where 10 s leave all that is asked for.
follows_left = always[0:8](rise(pc >= 0.9) implies
    eventually[0:1](always[0:1](abs(pc - lep) <= 3)))
follows_right = always[0:8](rise(pc >= 0.9) implies
    eventually[0:1](always[0:1](abs(pc - rep) <= 3)))

// Whatever fails, an elevator is without an active actuator for 0.1 s at most.
driven_left = always[0:9.9](eventually[0:0.1](max(lo_mode, li_mode) >= 3.5))
driven_right = always[0:9.9](eventually[0:0.1](max(ri_mode, ro_mode) >= 3.5))

// Two actuators never push one elevator.
alone_left = always[0:10](min(lo_mode, li_mode) <= 3.5)
alone_right = always[0:10](min(ri_mode, ro_mode) <= 3.5)

// Where an outer circuit is lost and the inner one is there, both inner actuators take over.
takes_over = always[0:9.9](
    min(p1, p3) < 500 and p2 >= 500 implies eventually[0:0.1](min(li_mode, ri_mode) >= 3.5))

// Where both circuits of the left side are lost, it is isolated, and its elevator back in the
// middle within a second.
isolates_left = always[0:8.9](max(p1, p2) < 500 implies
    eventually[0:0.1](max(lo_mode, li_mode) <= 0.5)
    and eventually[0:1](always[0:0.1](abs(lep) <= 0.1)))
"""


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Draw the command with both elevators, the modes as coloured bands, and the pressures."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    from rtamt_gym.drawing import tidy

    top, bands, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(3, 1.4, 1.6))
    times, seen = episode.times, episode.observations
    tidy(top, "position [cm]")
    top.step(times, seen[:, 0], where="pre", color="#999999", linewidth=1.2, label="command pc")
    top.plot(times, seen[:, 1], color="#0072B2", linewidth=1.4, label="left lep")
    top.plot(times, seen[:, 2], color="#D55E00", linewidth=1.4, linestyle="--", label="right rep")
    tidy(bands, "mode")
    bands.grid(visible=False)
    edges = np.append(times, times[-1] + PERIOD) - 0.5 * PERIOD
    colours = ListedColormap(list(_COLOURS.values()))
    bands.pcolormesh(edges, np.arange(5) - 0.5, seen[:, 3:7].T, cmap=colours, vmin=-0.5, vmax=4.5)
    bands.set_yticks(range(4), ("LO", "LI", "RI", "RO"))
    bands.hlines((0.5, 1.5, 2.5), edges[0], edges[-1], color="white", linewidth=2.5)
    bands.invert_yaxis()
    tidy(bottom, "pressure [kPa]")
    for i, (colour, style) in enumerate(_LINES):
        name = f"p{i + 1}"
        bottom.plot(times, seen[:, 7 + i], color=colour, linestyle=style, linewidth=1.4, label=name)
    bottom.set_ylim(min(-60.0, seen[:, 7:].min()), max(1200.0, seen[:, 7:].max()))
    bottom.set_xlabel("time [s]", fontsize=9.5)
    patches = [Patch(color=colour, label=name) for name, colour in _COLOURS.items()]
    for ax, handles in ((top, None), (bands, patches), (bottom, None)):
        ax.legend(
            handles=handles,
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            fontsize=8.5,
            frameon=False,
        )
        ax.set_xlim(times[0], max(times[-1], PERIOD))


# Modes from Isolated to Active, and pressures from p1 to p3; Okabe and Ito's colours.
_COLOURS = {
    "Isolated": "#222222",
    "Off": "#D55E00",
    "Passive": "#CC79A7",
    "Standby": "#F0E442",
    "Active": "#009E73",
}
_LINES = (("#0072B2", "-"), ("#E69F00", "--"), ("#009E73", ":"))


def _fault(name: str, what: str) -> Parameter:
    return Parameter(name, 0.0, 10.0, default=math.inf, unit="s", about=f"when {what} fails")


SCENARIO = Scenario(
    name="AircraftElevator",
    title="Elevators of an aircraft with redundant actuators",
    source=(
        "T. Yamaguchi, B. Hoxha, D. Nickovic: RTAMT - Runtime Robustness Monitors with Application "
        "to CPS and Robotics, STTT 2024; P. J. Mosterman, J. Ghidella: Model Reuse for the "
        "Training of Fault Scenarios in Aerospace, AIAA 2004-4931"
    ),
    period=PERIOD,
    duration=10.0,
    actions=(Quantity("pc", "cm", -2.0, 2.0),),
    observations=(
        Quantity("pc", "cm", -2.0, 2.0),
        Quantity("lep", "cm"),
        Quantity("rep", "cm"),
        *(Quantity(f"{name}_mode", "", 0.0, 4.0) for name in ("lo", "li", "ri", "ro")),
        *(Quantity(name, "kPa") for name in ("p1", "p2", "p3")),
    ),
    parameters=(
        _fault("LO", "the position of the left outer actuator"),
        _fault("LI", "the position of the left inner actuator"),
        _fault("RI", "the position of the right inner actuator"),
        _fault("RO", "the position of the right outer actuator"),
        _fault("H1", "the left outer circuit"),
        _fault("H2", "the inner circuit"),
        _fault("H3", "the right outer circuit"),
        Parameter(
            "noise", 0.0, 50.0, default=0.0, unit="kPa", about="deviation of a pressure sensor"
        ),
        Parameter("frequency", 0.2, 0.8, default=0.2, unit="Hz", about="of the baseline's wave"),
        Parameter("amplitude", 1.0, 1.75, default=1.0, unit="cm", about="of the baseline's wave"),
    ),
    inputs=(Signal("pc", -2.0, 2.0, points=10),),
    requirements=_REQUIREMENTS,
    state=_TICKS + 1,
    noise=3 * _SENSORS,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)
