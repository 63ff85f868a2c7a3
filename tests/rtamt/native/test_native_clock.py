"""Times in ticks and ticks as times in C++, against exact arithmetic on the text of the double."""

from __future__ import annotations

import math
import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from fmu_calls import ERROR, OK, dense, unit, write

import rtamt
from rtamt.program.encoding import clock_of

native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")

LIMIT = 2**62
DECIMAL = {f"1e-{digits}": Fraction(1, 10**digits) for digits in (0, 1, 3, 9, 15, 18)}
OTHERS = {"3e-9": Fraction(3, 10**9), "2e-3": Fraction(1, 500), "7": Fraction(7)}


def times() -> list[float]:
    """Times that round in every way: few digits at each magnitude, halves, any doubles."""
    rng = random.Random(3)
    found = [0.0, 5e-324, 1.7976931348623157e308, 2.0**53, 2.0**53 + 2, 2.0**62, 2.0**63]
    for exponent in range(-30, 40):
        found += [
            float(f"{digits}e{exponent}") for digits in (1, 2, 4, 5, 15, 25, 35, 46, 47, 9_999)
        ]
        found += [float(f"{rng.randrange(10**17)}e{exponent}") for _ in range(4)]
        found += [float(f"{rng.randrange(10**6)}.5e{exponent}") for _ in range(4)]
        found += [rng.random() * 10.0**exponent for _ in range(4)]
    return [*found, *(-time for time in found)]


@pytest.mark.parametrize("sure", [True, False], ids=["by the product", "by the text"])
@pytest.mark.parametrize("name", DECIMAL)
def test_decimal_clocks_count_each_double_exactly(name: str, *, sure: bool) -> None:
    """A scale that is not a number counts each time by its text, as no product is sure."""
    tick = DECIMAL[name]
    scale, ticks, units = clock_of(tick)
    clock = (scale if sure else math.nan, ticks, units)
    for time in times():
        exact = round(Fraction(repr(time)) / tick)
        found = native.ticks(clock, np.array([time]))
        assert (None if found is None else found.tolist()) == (
            [exact] if abs(exact) < LIMIT else None
        ), time


@pytest.mark.parametrize("name", OTHERS)
def test_other_clocks_count_exactly_or_not_at_all(name: str) -> None:
    tick, counted = OTHERS[name], 0
    for time in times():
        exact = round(Fraction(repr(time)) / tick)
        found = native.ticks(clock_of(tick), np.array([time]))
        if found is not None:
            counted += 1
            assert found.tolist() == [exact], time
            assert abs(exact) < LIMIT
    assert counted > 800
    half = float(tick / 2)
    assert native.ticks(clock_of(tick), np.array([half])) is None


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf])
def test_what_is_no_time_is_not_counted(time: float) -> None:
    for tick in DECIMAL.values():
        assert native.ticks(clock_of(tick), np.array([0.0, time])) is None


FAR = {  # the length of a tick, and times that are counted
    "one of many ticks": (Fraction(1, 10**18), [0.0, 1e-18, 0.1, 0.123456789, 1 / 3, 2.5, 4.0]),
    "one of more ticks than are counted": (Fraction(1, 10**20), [0.0, 3e-20, 1 / 300, 0.04]),
    "one beyond the numbers of doubles": (Fraction(3000), [0.0, 6e3, 3e19, 1e22]),
    "third of a nanosecond": (Fraction(1, 3 * 10**9), [0.0, 0.1, 1 / 3, 2e8, 1e9 + 0.1]),
    "million seconds and one": (Fraction(1_000_001), [0.0, 1e9, 1e15, 4e18, 4e21]),
}


@pytest.mark.parametrize("what", FAR)
def test_times_of_ticks_are_the_nearest_doubles(what: str) -> None:
    tick, later = FAR[what]
    times = [-time for time in later[:0:-1]] + later
    events = [(time, float(i)) for i, time in enumerate(times)]
    exact = [round(Fraction(repr(time)) / tick) for time, _ in events]
    expected = [(float(n * tick), value) for n, (_, value) in zip(exact, events, strict=True)]
    for backend in ("native", "python"):
        monitor = rtamt.dense.Monitor("x > 0", resolution=tick, backend=backend)
        found = monitor.update({"x": events}) + monitor.finish()
        assert found == expected
        assert monitor.settled == expected[-1][0]
        signal = rtamt.dense.evaluate("x > 0", {"x": events}, resolution=tick, backend=backend)
        assert list(signal) == expected


def test_a_unit_takes_the_even_one_of_two_ticks_that_are_equally_near(tmp_path: Path) -> None:
    with unit(2, write(tmp_path, dense("always(x > 0)", "2ms"))) as made:
        for half, even in ((0.001, 0), (0.003, 2), (0.005, 2), (0.007, 4)):
            made.begin(half)
            assert made.step(half, 0.001) == OK
            next_one = half + 0.001
            again = round(next_one / 0.002) == even
            assert made.step(next_one, 0.001) == (ERROR if again else OK)
            if again:
                assert made.said.endswith(f"two begin on the tick of {next_one} s")
            assert made.call("Reset") == OK
