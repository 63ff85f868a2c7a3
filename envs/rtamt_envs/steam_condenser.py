"""A steam condenser (SC): a recurrent network controls its pressure by the flow of cooling water.

The action is the flow of steam Fs [kg/s]. The steam condenses on tubes with a flow of water Fcw
[kg/s]. With the volume V = 3, the mass of water Mcw = 500 and its temperature Tcw = 60 at the
inlet:

    P' = 0.461526 / V (Fs - Fc) Tc(P)             pressure of the steam [kPa], P(0) = 90
    T' = (Q / 4.2 + (Tcw - T) Fcw) / Mcw          water at the outlet [deg C], T(0) = 80
    Q = dTm / (0.0872924756541668 / Fcw^0.8 + 0.00073786772008033)         heat [kW]
    dTm = (T - Tcw) / log((Tc(P) - Tcw) / (Tc(P) - T))                     mean difference [K]
    Fc = Q / lambda(P)                            condensate [kg/s]

Tables over 50 .. 110 kPa, with lines between their points, give the temperature of condensation Tc
[deg C] and the heat of evaporation lambda [kJ/kg]. A sensor with a lag of 0.5 s reads p. The
requirement is about this reading, the fourth output of the original. The controller takes p minus
the setpoint (90 kPa; from 2 s on, the parameter ``setpoint``). It is a layer of three neurons with
feedback of their outputs through two lags 1 / (s + 10). Fcw follows its command, limited to
0 .. 200 kg/s, with a lag of 1 s. At the start p is 90 kPa, Fcw is 107.888 kg/s and the lags of
the layer are 0.

**Solver.** The classical Runge-Kutta method with steps of a period, 0.01 s. The action is constant
over a period and the setpoint changes at a sample, so within a step only the slopes of the tables
jump, when P passes 90 kPa. At every quarter second of ten random runs, the pressure differs from a
solver of order 8 (tolerances 1e-13) by at most 1.2e-6 kPa with steps of 0.05 s, 7.7e-8 with
0.025 s, 1.4e-8 with 0.01 s and 1.8e-9 with 0.005 s. No sample differs by more than 4e-8.

**Not validated:** the Simulink model was not run, and volume, masses and tables are those of the
benchmark.

Source: S. Yaghoubi, G. Fainekos: Gray-box adversarial testing for control systems with machine
learning components, HSCC 2019. The requirement and the inputs are from the competition ARCH-COMP
(falsification): 20 even pieces over 35 s within 3.99 .. 4.01 kg/s. No input that violates the
requirement is known.

    >>> import gymnasium as gym, rtamt_envs
    >>> condenser = gym.make_vec("rtamt/SteamCondenser-v0", num_envs=1)
    >>> observation, _ = condenser.reset()
    >>> p = condenser.unwrapped.rollout([[[4.0]]] * 3500)[2999:, 0, 0]  # kPa, from 30 s on
    >>> print(f"{p.min():.3f} .. {p.max():.3f} kPa")
    87.293 .. 87.294 kPa
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

_PERIOD = 0.01  # seconds
_STEP = 200.0  # samples, after which the setpoint changes
_FLOW = 107.8880952381  # kg/s, at the start and where the controller's output is 0

# The indices of the state; the number of samples since the start is last.
_P, _T, _MEASURED, _FCW, _DELAYS = 0, 1, 2, 3, 4
_ORDER = 10
_SAMPLES = _ORDER
_STATE = _ORDER + 1

# The Runge-Kutta method: the weights of its four stages, and the times of the next stages.
_WEIGHTS = (_PERIOD / 6.0, _PERIOD / 3.0, _PERIOD / 3.0, _PERIOD / 6.0)
_TIMES = (_PERIOD / 2.0, _PERIOD / 2.0, _PERIOD)

_CONDENSATION = (81.3167, 85.9258, 89.9315, 93.4854, 96.6870, 99.6059, 102.2923)  # degC
_EVAPORATION = (2305.42, 2293.64, 2283.30, 2274.05, 2265.65, 2257.92, 2250.76)  # kJ/kg

# The controller: for each neuron the bias, and the weights of the input, the output and the lags.
_ERROR = (-3.7742393716738434, 5.7997431225043385)  # kPa at -1 and 1
_COMMAND = (-30.855068745036114, 66.87926496596293)  # kg/s at -1 and 1
_BIAS = (0.401290502963486, -0.12475735064274925, -1.3584541012442735)
_INPUT = (-0.36932254958803395, 0.37111199431650393, -0.5273628058411883)
_OUTPUT = (-0.22749313555095124, 2.0804767759906643, -0.5664480988620816)
_OUTPUT_BIAS = -0.3322786668413711
_LAYER = (
    (
        0.44769854454577174,
        1.1961840315574388,
        1.1412233787458486,
        0.7200162301978621,
        -0.37547125154051064,
        -0.6154676090487433,
    ),
    (
        -0.1666873035945436,
        -0.016432941671533533,
        -0.22132796342367161,
        -0.03720622409555299,
        0.059874671921603305,
        0.08020259272911583,
    ),
    (
        0.24187644262601646,
        -0.6696328523822819,
        -1.0984401489322673,
        0.029109804692608397,
        1.3722216833345802,
        0.6616690666952404,
    ),
)


@compiled
def _between(table: tuple[float, ...], pressure: float) -> float:
    """Interpolate a table over 50 .. 110 kPa; the lines at its ends extend beyond them."""
    position = (pressure - 50.0) / 10.0
    row = min(max(int(position), 0), 5)
    return table[row] + (position - row) * (table[row + 1] - table[row])


@compiled
def _heat(pressure: float, temperature: float, flow: float) -> float:
    """Return the heat into the cooling water, in kW."""
    condensation = _between(_CONDENSATION, pressure)
    mean = (temperature - 60.0) / math.log((condensation - 60.0) / (condensation - temperature))
    return mean / (0.0872924756541668 / math.pow(flow, 0.8) + 0.00073786772008033)


@compiled
def _rates(steam: float, setpoint: float, state: Floats, rates: Floats) -> None:
    """Fill the time derivatives of the state."""
    pressure, temperature = float(state[_P]), float(state[_T])
    measured, flow = float(state[_MEASURED]), float(state[_FCW])
    heat = _heat(pressure, temperature, flow)
    condensate = heat / _between(_EVAPORATION, pressure)
    rates[_P] = 0.461526 / 3.0 * (steam - condensate) * _between(_CONDENSATION, pressure)
    rates[_T] = (heat / 4.2 + (60.0 - temperature) * flow) / 500.0
    rates[_MEASURED] = (pressure - measured) / 0.5
    error = 2.0 * (measured - setpoint - _ERROR[0]) / (_ERROR[1] - _ERROR[0]) - 1.0
    output = _OUTPUT_BIAS
    for neuron in range(3):
        total = _BIAS[neuron] + _INPUT[neuron] * error
        for delay in range(6):
            total += _LAYER[neuron][delay] * float(state[_DELAYS + delay])
        value = math.tanh(total)
        output += _OUTPUT[neuron] * value
        first, second = float(state[_DELAYS + neuron]), float(state[_DELAYS + 3 + neuron])
        rates[_DELAYS + neuron] = value - 10.0 * first
        rates[_DELAYS + 3 + neuron] = first - 10.0 * second
    command = _FLOW + _COMMAND[0] + 0.5 * (output + 1.0) * (_COMMAND[1] - _COMMAND[0])
    rates[_FCW] = min(max(command, 0.0), 200.0) - flow


@compiled
def _setpoint(parameters: Floats, state: Floats) -> float:
    return 90.0 if state[_SAMPLES] < _STEP else float(parameters[0])


@compiled
def _observe(parameters: Floats, state: Floats, observation: Floats) -> None:
    observation[0] = state[_MEASURED]
    observation[1] = _setpoint(parameters, state)
    observation[2] = state[_T]
    observation[3] = state[_FCW]
    observation[4] = _heat(float(state[_P]), float(state[_T]), float(state[_FCW]))
    observation[5] = state[_P]


@compiled
def _start(parameters: Floats, noise: Floats, state: Floats, observation: Floats) -> None:  # noqa: ARG001 - as every scenario's
    state[:] = 0.0
    state[_P], state[_T], state[_MEASURED], state[_FCW] = 90.0, 80.0, 90.0, _FLOW
    _observe(parameters, state, observation)


@compiled
def _step(
    action: Floats,
    parameters: Floats,
    noise: Floats,  # noqa: ARG001 - as every scenario's
    state: Floats,
    observation: Floats,
) -> None:
    setpoint = _setpoint(parameters, state)
    steam = float(action[0])
    point, rates, total = np.empty(_ORDER), np.empty(_ORDER), np.zeros(_ORDER)
    point[:] = state[:_ORDER]
    for stage in range(4):
        _rates(steam, setpoint, point, rates)
        total += _WEIGHTS[stage] * rates
        if stage < 3:
            point[:] = state[:_ORDER] + _TIMES[stage] * rates
    state[:_ORDER] += total
    state[_SAMPLES] += 1.0
    _observe(parameters, state, observation)


@compiled
def _baseline(time: float, observation: Floats, parameters: Floats, action: Floats) -> None:  # noqa: ARG001 - as every scenario's
    """Set a constant flow of 4 kg/s."""
    action[0] = 4.0


def _draw(figure: Figure, episode: EpisodeSoFar) -> None:
    """Plot the pressure with its setpoint and the required band, then the flows."""
    from rtamt import Verdict
    from rtamt_gym.drawing import OPEN, SIGNAL, VERDICT_COLOURS, tidy

    pressure, water, steam = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    tidy(pressure, "pressure [kPa]")
    pressure.fill_between(
        (30.0, 35.0), 87.0, 87.5, color=VERDICT_COLOURS[Verdict.SATISFIED], alpha=0.25
    )
    pressure.plot(
        episode.times,
        episode.observations[:, 1],
        color=OPEN,
        linewidth=0.9,
        linestyle=(0, (4, 3)),
        label="setpoint",
    )
    pressure.plot(episode.times, episode.observations[:, 0], color=SIGNAL, linewidth=1.2, label="p")
    pressure.legend(fontsize=8.5, frameon=False, loc="upper right")
    tidy(water, "Fcw [kg/s]")
    water.plot(episode.times, episode.observations[:, 3], color=SIGNAL, linewidth=1.2)
    tidy(steam, "Fs [kg/s]")
    steam.stairs(episode.actions[:, 0], episode.times, baseline=None, color=SIGNAL, linewidth=1.2)
    steam.set_xlabel("time [s]", fontsize=9.5)


SCENARIO = Scenario(
    name="SteamCondenser",
    title="Steam condenser with a recurrent neural network as its controller",
    source="S. Yaghoubi, G. Fainekos: Gray-box adversarial testing for control systems with "
    "machine learning components, HSCC 2019",
    period=_PERIOD,
    duration=35.0,
    actions=(Quantity("Fs", "kg/s", 3.99, 4.01),),
    observations=(
        Quantity("p", "kPa", 50.0, 110.0),
        Quantity("setpoint", "kPa", 50.0, 110.0),
        Quantity("T", "deg C", 60.0, 102.2923),
        Quantity("Fcw", "kg/s", 0.0, 200.0),
        Quantity("Q", "kW", 0.0, 100_000.0),
        Quantity("P", "kPa", 50.0, 110.0),
    ),
    parameters=(Parameter("setpoint", 85.0, 89.0, default=87.0, unit="kPa", about="from 2 s on"),),
    inputs=(Signal("Fs", 3.99, 4.01, points=20),),
    requirements="SC = always[30:35](p >= 87 and p <= 87.5)",
    state=_STATE,
    start=_start,
    step=_step,
    baseline=_baseline,
    draw=_draw,
)
