"""Which actuators drive the elevators: the fault monitors and the mode logic of `AircraftElevator`.

The actuators are left outer, left inner, right inner, right outer, in this order. A mode is a
number, as in the model that this follows: 0 Isolated, 1 Off, 2 Passive, 3 Standby, 4 Active.

At every sample the failures of a side decide what becomes of its two actuators, the first row that
fits:

| outer circuit low | outer position | inner circuit low | inner position | outer | inner |
|---|---|---|---|---|---|
| yes | any | no | good | goes off | |
| yes | any | any | any | is isolated | is isolated |
| no | failed | no | good | is isolated | |
| no | failed | any | any | is isolated | is isolated |
| no | good | yes | any | | goes off |
| no | good | no | failed | | is isolated |

An actuator that has come back from Off five times is isolated in place of going off again. Nothing
leaves Isolated. Then the actuators react to each other until they all stay as they are:

- Off ends, in Passive, as soon as the circuit is not low.
- An outer actuator becomes Active unless the inner one of its side is; Standby ends where the other
  outer one is Active, too. It goes from Active to Standby where the inner one of its side is Active
  and the other outer one is not.
- An inner actuator becomes Active unless the outer one of its side is; Standby ends where the other
  inner one is Active, too. It goes from Active to Standby where both outer ones are Active.

So one actuator drives an elevator at a time, and both are driven by their outer ones or both by
their inner ones, as far as the failures allow.
"""

from rtamt_envs.compiled import compiled
from rtamt_envs.scenario import Floats

ISOLATED, OFF, PASSIVE, STANDBY, ACTIVE = 0.0, 1.0, 2.0, 3.0, 4.0

_CIRCUIT = (0, 1, 1, 2)  # the hydraulic circuit of each actuator
_ORDER = (0, 3, 1, 2)  # outer actuators react first
_RETURNS = 5.0  # so often an actuator may come back from Off


@compiled
def pressure_failed(pressure: float, previous: float) -> bool:
    """Return whether a circuit is low: out of 500 to 2000 kPa, or changed by over 100 kPa."""
    return pressure < 500.0 or pressure > 2000.0 or abs(pressure - previous) > 100.0


@compiled
def position_failed(position: float) -> bool:
    """Return whether a position has failed: over 10 cm from 0.

    The source also counts a change by 20 cm in a sample, which leaves this range anyway.
    """
    return abs(position) > 10.0


@compiled
def _go_off(modes: Floats, returns: Floats, actuator: int) -> None:
    if modes[actuator] > OFF:
        modes[actuator] = OFF if returns[actuator] < _RETURNS else ISOLATED


@compiled
def _switch(
    modes: Floats,
    returns: Floats,
    low: Floats,
    failed: Floats,
    outer: int,
    inner: int,
) -> None:
    """Apply the first row of the table that fits to the actuators of a side."""
    outer_low, inner_low = low[_CIRCUIT[outer]] > 0.0, low[_CIRCUIT[inner]] > 0.0
    inner_lost = inner_low or failed[inner] > 0.0
    if outer_low and not inner_lost:
        _go_off(modes, returns, outer)
    elif outer_low or (failed[outer] > 0.0 and inner_lost):
        modes[outer] = ISOLATED
        modes[inner] = ISOLATED
    elif failed[outer] > 0.0:
        modes[outer] = ISOLATED
    elif inner_low:
        _go_off(modes, returns, inner)
    elif failed[inner] > 0.0:
        modes[inner] = ISOLATED


@compiled
def _react(
    modes: Floats,
    returns: Floats,
    low: Floats,
    actuator: int,
) -> None:
    """Move one actuator by one mode, if the others require it."""
    mode = modes[actuator]
    partner = modes[actuator ^ 1] == ACTIVE  # the other one of its side
    twin = modes[3 - actuator] == ACTIVE  # outer or inner too, of the other side
    if mode == OFF and low[_CIRCUIT[actuator]] == 0.0:
        returns[actuator] += 1.0
        modes[actuator] = PASSIVE
    elif mode == PASSIVE:
        modes[actuator] = STANDBY if partner else ACTIVE
    elif mode == STANDBY and (twin or not partner):
        modes[actuator] = ACTIVE
    elif mode == ACTIVE and partner:
        outer = actuator in (0, 3)
        if (outer and not twin) or (not outer and modes[3 - (actuator ^ 1)] == ACTIVE):
            modes[actuator] = STANDBY


@compiled
def decide(
    modes: Floats,
    returns: Floats,
    low: Floats,
    failed: Floats,
) -> None:
    """Update the modes after the failures of a sample.

    Args:
        modes: The modes of the four actuators, in and out.
        returns: The number of returns of each from Off, in and out.
        low: 1 for each of the three circuits with failed pressure, otherwise 0.
        failed: 1 for each actuator with a failed position, otherwise 0.
    """
    _switch(modes, returns, low, failed, 0, 1)
    _switch(modes, returns, low, failed, 3, 2)
    settled = False
    while not settled:
        settled = True
        for actuator in _ORDER:
            before = modes[actuator]
            _react(modes, returns, low, actuator)
            settled = settled and modes[actuator] == before
