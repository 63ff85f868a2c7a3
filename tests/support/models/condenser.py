"""An independent implementation of the steam condenser, for SciPy's implicit solvers.

Yaghoubi, Fainekos: Gray-box adversarial testing for control systems with machine learning
components, HSCC 2019. Units: kPa, degrees Celsius, kg/s, seconds. The sensor and the actuator start
at rest, at 90 kPa and at the flow of the set point; the network's delays start at 0.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

FLOW = 107.8880952381
_PRESSURES = np.arange(50.0, 111.0, 10.0)
_BOILING = np.array([81.3167, 85.9258, 89.9315, 93.4854, 96.6870, 99.6059, 102.2923])
_LATENT = np.array([2305.42, 2293.64, 2283.30, 2274.05, 2265.65, 2257.92, 2250.76])
_IN = np.array([-0.36932254958803395, 0.37111199431650393, -0.5273628058411883])
_BIAS = np.array([0.401290502963486, -0.12475735064274925, -1.3584541012442735])
_OUT = np.array([-0.22749313555095124, 2.0804767959906643, -0.5664480988620816])
_OUT_BIAS = -0.3322786668413711
_DELAYED = np.array(
    [
        [
            0.44769854454577174,
            1.1961840315574388,
            1.1412233787458486,
            0.7200162301978621,
            -0.37547125154051064,
            -0.6154676090487433,
        ],
        [
            -0.1666873035945436,
            -0.016432941671533533,
            -0.22132796342367161,
            -0.03720622409555299,
            0.059874671921603305,
            0.08020259272911583,
        ],
        [
            0.24187644262601646,
            -0.6696328523822819,
            -1.0984401489322673,
            0.029109804692608397,
            1.3722216833345802,
            0.6616690666952404,
        ],
    ]
)


def _map(x: float, source: tuple[float, float], target: tuple[float, float]) -> float:
    share = (x - source[0]) / (source[1] - source[0])
    return target[0] + share * (target[1] - target[0])


def _slope(setpoint: float, steam: float, y: Floats) -> Floats:
    pressure, temperature, flow, measured = y[:4]
    first, second = y[4:7], y[7:10]
    boiling = np.interp(pressure, _PRESSURES, _BOILING)
    mean = (temperature - 60) / np.log((boiling - 60) / (boiling - temperature))
    heat = mean / (0.0872924756541668 / flow**0.8 + 0.00073786772008033)
    condensed = heat / np.interp(pressure, _PRESSURES, _LATENT)
    x = _map(float(measured) - setpoint, (-3.7742393716738434, 5.7997431225043385), (-1, 1))
    layer = np.tanh(_BIAS + _IN * x + _DELAYED @ y[4:10])
    u = _map(float(_OUT_BIAS + _OUT @ layer), (-1, 1), (-30.855068745036114, 66.87926496596293))
    return np.array(
        [
            0.461526 / 3 * (steam - condensed) * boiling,
            (heat / 4.2 + (60 - temperature) * flow) / 500,
            min(max(u + FLOW, 0.0), 200.0) - flow,
            (pressure - measured) / 0.5,
            *(layer - 10 * first),
            *(first - 10 * second),
        ]
    )


def solve(steam: Floats, *, method: str = "LSODA", rtol: float = 1e-10) -> Floats:
    """Return the states at 0, 0.01, ... s; steam flows are held over 0.01 s.

    A row is (pressure, temperature, flow, measured pressure, d1 .. d6).
    """
    y = np.array([90.0, 80.0, FLOW, 90.0, 0, 0, 0, 0, 0, 0])
    rows = [y]
    changes = {0, len(steam), *(1 + np.flatnonzero(np.diff(steam))), min(200, len(steam))}
    stops = sorted(int(i) for i in changes)
    for begin, end in itertools.pairwise(stops):
        setpoint = 90.0 if begin < 200 else 87.0  # the set point falls at 2 s
        run = solve_ivp(
            lambda _, y, setpoint=setpoint, flow=steam[begin]: _slope(setpoint, flow, y),
            (begin / 100, end / 100),
            y,
            method=method,
            rtol=rtol,
            atol=rtol,
            t_eval=np.minimum(np.arange(begin + 1, end + 1) / 100, end / 100),
        )
        rows += list(run.y.T)
        y = run.y[:, -1]
    return np.array(rows)
