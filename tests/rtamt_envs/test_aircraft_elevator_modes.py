"""The mode logic of the elevators: against a chart of events, and its promises."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import pytest
from rtamt_envs.aircraft_elevator import (
    ACTIVE,
    ISOLATED,
    OFF,
    PASSIVE,
    STANDBY,
    decide,
    position_failed,
    pressure_failed,
)

LO, LI, RI, RO = range(4)
NORMAL = (ACTIVE, STANDBY, STANDBY, ACTIVE)
CIRCUIT = (0, 1, 1, 2)
LOW = list(product((0.0, 1.0), repeat=3))
FAILED = list(product((0.0, 1.0), repeat=4))


class Chart:
    """Four parallel states that send events to each other: the logic of the source.

    An actuator that leaves for Off or Isolated sends its event while it is in no state. An inner
    one that becomes Active sends one to the outer one of its side. Receivers react at once. A
    sample makes one transition of each, so some reactions take several samples.
    """

    TOLD = {LO: (LI,), RO: (RI,), LI: (LO, RO), RI: (RO, LO, LI)}  # noqa: RUF012 - a constant

    def __init__(self) -> None:
        self.modes: list[float | None] = list(NORMAL)
        self.fails = [0, 0, 0, 0]

    def sample(self, low: Sequence[float], failed: Sequence[float]) -> None:
        self.low = low
        for outer, inner in ((LO, LI), (RO, RI)):
            a, b = low[CIRCUIT[outer]], failed[outer]
            c, d = low[1], failed[inner]
            if a and not c and not d:
                self.go_off(outer)
            elif a:
                self.isolate(outer)
                self.isolate(inner)
            elif b and not c and not d:
                self.isolate(outer)
            elif b:
                self.isolate(outer)
                self.isolate(inner)
            elif c:
                self.go_off(inner)
            elif d:
                self.isolate(inner)
        for actuator in (LO, RO, LI, RI):
            self.react(actuator)

    def go_off(self, actuator: int) -> None:
        if self.modes[actuator] in {OFF, ISOLATED}:
            return
        if self.fails[actuator] >= 5:
            self.modes[actuator] = ISOLATED
        else:
            self.leave_for(OFF, actuator)

    def isolate(self, actuator: int) -> None:
        if self.modes[actuator] != ISOLATED:
            self.leave_for(ISOLATED, actuator)

    def leave_for(self, mode: float, actuator: int) -> None:
        self.modes[actuator] = None
        for told in self.TOLD[actuator]:
            self.react(told)
        self.modes[actuator] = mode

    def react(self, actuator: int) -> None:
        mode = self.modes[actuator]
        outer, inner = (LO, LI) if actuator in {LO, LI} else (RO, RI)
        other_outer, other_inner = (RO, RI) if outer == LO else (LO, LI)
        active = [each == ACTIVE for each in self.modes]
        if mode == OFF and not self.low[CIRCUIT[actuator]]:
            self.fails[actuator] += 1
            self.modes[actuator] = PASSIVE
        elif actuator == outer:
            if mode == PASSIVE and active[inner]:
                self.modes[actuator] = STANDBY
            elif mode in {PASSIVE, STANDBY} and (not active[inner] or active[other_outer]):
                self.modes[actuator] = ACTIVE
            elif mode == ACTIVE and active[inner] and not active[other_outer]:
                self.modes[actuator] = STANDBY
        elif mode == PASSIVE and active[outer]:
            self.modes[actuator] = STANDBY
        elif mode in {PASSIVE, STANDBY} and (not active[outer] or active[other_inner]):
            self.modes[actuator] = ACTIVE
            self.react(outer)
        elif mode == ACTIVE and active[outer] and active[other_outer]:
            self.modes[actuator] = STANDBY


class Logic:
    def __init__(self) -> None:
        self.modes = np.array(NORMAL)
        self.returns = np.zeros(4)

    def sample(self, low: Sequence[float], failed: Sequence[float]) -> list[float]:
        decide(self.modes, self.returns, np.array(low), np.array(failed))
        return [float(mode) for mode in self.modes]


def _histories() -> Iterator[list[tuple[Sequence[float], Sequence[float]]]]:
    """Failures that appear and disappear; failures of positions, which isolate, are rare."""
    rng = np.random.default_rng(3)
    for chance in np.linspace(0.02, 0.5, 150):
        yield [
            (
                (rng.random(3) < 0.3).astype(float).tolist(),
                (rng.random(4) < chance * 0.2).astype(float).tolist(),
            )
            for _ in range(25)
        ]
    for low, failed in product(LOW, FAILED):
        yield [(low, failed)]


def test_the_logic_settles_where_the_chart_of_events_settles() -> None:
    seen = set()
    for history in _histories():
        chart, logic = Chart(), Logic()
        for low, failed in history:
            for _ in range(4):
                chart.sample(low, failed)
            modes = logic.sample(low, failed)
            assert modes == chart.modes, history
            for mode, returns, fails in zip(modes, logic.returns, chart.fails, strict=True):
                assert mode == ISOLATED or returns == fails, history
            seen.add(tuple(modes))
    assert len(seen) > 20


def test_an_elevator_is_driven_by_one_good_actuator_wherever_there_is_one() -> None:
    for history in _histories():
        logic = Logic()
        before = list(NORMAL)
        for low, failed in history:
            modes = logic.sample(low, failed)
            good = [
                modes[each] != ISOLATED and not low[CIRCUIT[each]] and not failed[each]
                for each in range(4)
            ]
            for side in ((LO, LI), (RO, RI)):
                active = [each for each in side if modes[each] == ACTIVE]
                assert len(active) == any(good[each] for each in side), (history, modes)
                assert all(good[each] for each in active), (history, modes)
            for was, mode in zip(before, modes, strict=True):
                assert was != ISOLATED or mode == ISOLATED
            if all(good):
                assert modes[LO] == modes[RO]
                assert modes[LI] == modes[RI]
            before = modes


@pytest.mark.parametrize(
    ("low", "failed", "modes"),
    [
        ((0, 0, 0), (0, 0, 0, 0), NORMAL),
        ((1, 0, 0), (0, 0, 0, 0), (OFF, ACTIVE, ACTIVE, STANDBY)),
        ((0, 0, 1), (0, 0, 0, 0), (STANDBY, ACTIVE, ACTIVE, OFF)),
        ((0, 1, 0), (0, 0, 0, 0), (ACTIVE, OFF, OFF, ACTIVE)),
        ((1, 1, 0), (0, 0, 0, 0), (ISOLATED, ISOLATED, OFF, ACTIVE)),
        ((0, 0, 0), (1, 0, 0, 0), (ISOLATED, ACTIVE, ACTIVE, STANDBY)),
        ((0, 0, 0), (0, 1, 0, 0), (ACTIVE, ISOLATED, STANDBY, ACTIVE)),
        ((0, 0, 0), (1, 0, 1, 0), (ISOLATED, ACTIVE, ISOLATED, ACTIVE)),
        ((1, 1, 1), (0, 0, 0, 0), (ISOLATED,) * 4),
    ],
)
def test_a_failure_changes_the_modes_within_a_sample(
    low: tuple[float, ...], failed: tuple[float, ...], modes: tuple[float, ...]
) -> None:
    assert tuple(Logic().sample(low, failed)) == modes


def test_an_actuator_that_comes_back_stands_by_and_is_isolated_the_sixth_time() -> None:
    logic = Logic()
    for _ in range(5):
        assert logic.sample((1, 0, 0), (0,) * 4) == [OFF, ACTIVE, ACTIVE, STANDBY]
        assert logic.sample((0, 0, 0), (0,) * 4) == [STANDBY, ACTIVE, ACTIVE, STANDBY]
    assert logic.sample((1, 0, 0), (0,) * 4) == [ISOLATED, ACTIVE, ACTIVE, STANDBY]
    assert logic.sample((0, 0, 0), (0,) * 4) == [ISOLATED, ACTIVE, ACTIVE, STANDBY]


def test_the_monitors_know_range_and_rate() -> None:
    good = [(500, 500), (2000, 1900), (1000, 900), (900, 1000)]
    bad = [(499, 500), (2001, 2001), (1000, 899), (899, 1000)]
    assert [pressure_failed(*map(float, each)) for each in good] == [False] * 4
    assert [pressure_failed(*map(float, each)) for each in bad] == [True] * 4
    assert [position_failed(each) for each in (-10.1, -10.0, 10.0, 10.1)] == [
        True,
        False,
        False,
        True,
    ]
