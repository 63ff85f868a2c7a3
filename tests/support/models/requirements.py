"""The benchmarks' requirements as loops over NumPy slices, without the library.

Windows are in samples and are cut at the end of the trace. In an empty window, always is +inf and
eventually -inf. Every function returns the robustness at sample 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Robustness = Callable[[Floats], float]


def always(x: Floats, low: int, high: int) -> Floats:
    return np.array([np.min(x[k + low : k + high + 1], initial=math.inf) for k in range(len(x))])


def eventually(x: Floats, low: int, high: int) -> Floats:
    return -always(-x, low, high)


def implies(condition: Floats, consequence: Floats) -> Floats:
    return np.maximum(-condition, consequence)


def _ceiling(column: int, limit: float, end: int) -> Robustness:
    return lambda trace: float(np.min(limit - trace[: end + 1, column]))


def _gear_holds(gear: int) -> Robustness:
    def robustness(trace: Floats) -> float:
        here = 0.5 - np.abs(trace[:, 2] - gear)
        soon = eventually(here, 1, 10)
        held = eventually(always(here, 0, 250), 1, 10)
        return float(always(implies(np.minimum(-here, soon), held), 0, 3000)[0])

    return robustness


def _slow_engine(pairs: tuple[tuple[int, float], ...]) -> Robustness:
    def robustness(trace: Floats) -> float:
        slow = float(np.min(3000 - trace[:3001, 1]))
        limits = [_ceiling(0, limit, seconds * 100)(trace) for seconds, limit in pairs]
        return min(max(-slow, limit) for limit in limits)

    return robustness


TRANSMISSION: Mapping[str, Robustness] = {
    "AT1": _ceiling(0, 120, 2000),
    "AT2": _ceiling(1, 4750, 1000),
    **{f"AT5{gear}": _gear_holds(gear) for gear in (1, 2, 3, 4)},
    "AT6a": _slow_engine(((4, 35),)),
    "AT6b": _slow_engine(((8, 50),)),
    "AT6c": _slow_engine(((20, 65),)),
    "AT6abc": _slow_engine(((4, 35), (8, 50), (20, 65))),
}
"""Requirements on rows (speed, rpm, gear) every 0.01 s."""


def _cc1(y: Floats) -> float:
    return float(always(40 - (y[:, 4] - y[:, 3]), 0, 2000)[0])


def _cc2(y: Floats) -> float:
    return float(always(eventually(y[:, 4] - y[:, 3] - 15, 0, 600), 0, 1400)[0])


def _cc3(y: Floats) -> float:
    near = always(20 - (y[:, 1] - y[:, 0]), 0, 400)
    far = eventually(y[:, 4] - y[:, 3] - 40, 0, 400)
    return float(always(np.maximum(near, far), 0, 1600)[0])


def _cc4(y: Floats) -> float:
    apart = always(y[:, 4] - y[:, 3] - 8, 0, 100)
    return float(always(eventually(apart, 0, 600), 0, 1300)[0])


def _cc5(y: Floats) -> float:
    first = always(y[:, 1] - y[:, 0] - 9, 0, 100)
    last = always(y[:, 4] - y[:, 3] - 9, 100, 400)
    return float(always(eventually(implies(first, last), 0, 160), 0, 1440)[0])


def _ccx(y: Floats) -> float:
    return float(np.min(np.diff(y[:1001], axis=1) - 7.5))


CHASING: Mapping[str, Robustness] = {
    "CC1": _cc1,
    "CC2": _cc2,
    "CC3": _cc3,
    "CC4": _cc4,
    "CC5": _cc5,
    "CCx": _ccx,
}
"""Requirements on rows y1 .. y5 every 0.05 s."""


def condenser(pressure: Floats) -> float:
    """The pressure, every 0.01 s, is between 87 and 87.5 kPa from 30 s to 35 s."""
    window = pressure[3000:3501]
    return float(min(np.min(window - 87), np.min(87.5 - window)))


def follows(command: Floats, position: Floats) -> float:
    """At the last sample: every rise of the command was followed within 3, from 1 s on, for 1 s.

    Samples are 0.01 s apart. Before sample 0 the command counts as below.
    """
    near = eventually(always(3 - np.abs(command - position), 0, 100), 0, 100)
    high = command - 0.9
    before = np.concatenate([[-math.inf], high[:-1]])
    return float(np.min(implies(np.minimum(high, -before), near)))
