"""An elevator with its hydraulics: against SciPy's solvers, and the order of its steps."""

import numpy as np
import pytest
from rtamt_envs.aircraft_elevator import SIDE, advance, stepping
from rtamt_envs.scenario import Floats
from scipy.integrate import solve_ivp

# Commands, modes of outer and inner actuator, supplies: every mode, both pistons at once, a lost
# circuit, and an elevator without an actuator.
PIECES = [
    (1.75, (4.0, 3.0), (1000.0, 1000.0)),
    (-1.75, (4.0, 3.0), (1000.0, 1000.0)),
    (-1.0, (1.0, 4.0), (0.0, 1000.0)),
    (1.5, (3.0, 4.0), (1000.0, 1000.0)),
    (0.5, (4.0, 4.0), (1000.0, 1000.0)),
    (2.0, (0.0, 2.0), (1000.0, 0.0)),
]
SAMPLES = 25


def _ours(substeps: int) -> Floats:
    side = np.zeros(SIDE)
    course = []
    for command, modes, supplies in PIECES:
        for _ in range(SAMPLES):
            advance(side, command, modes, supplies, stepping(substeps))
            course.append(side[:8].copy())
    return np.array(course)


def _scipy(method: str, tolerance: float) -> Floats:
    """Solve the equations of the source, with the control laws between the samples."""
    y = np.zeros(8)
    integral = last = 0.0
    course = []
    for command, (outer, inner), supplies in PIECES:
        for _ in range(SAMPLES):
            error = command - y[0]
            pid = 0.0012 * error + 5.7e-5 * integral + 2.4e-4 * (error - last) / 0.01
            integral += 0.01 * error
            last = error
            drives = (pid * (outer >= 3), 0.000325 * error * (inner >= 3))
            spools = (outer == 4, inner == 4)

            def slope(
                _: float,
                y: Floats,
                drives: tuple[float, float] = drives,
                spools: tuple[bool, bool] = spools,
                supplies: tuple[float, float] = supplies,
            ) -> list[float]:
                x, v = y[:2]
                force = sum(100 * y[i] * spool for i, spool in zip((2, 5), spools, strict=True))
                rates = [v, force - 10 * v - 1000 * x]
                for i, drive, supply in zip((2, 5), drives, supplies, strict=True):
                    pressure, valve, speed = y[i : i + 3]
                    rates += [
                        100 * (supply - pressure) * valve - 100 * v,
                        speed,
                        200 * drive - 10 * speed - 30 * valve,
                    ]
                return rates

            y = solve_ivp(
                slope, (0, 0.01), y, method=method, rtol=tolerance, atol=tolerance * 1e-3
            ).y[:, -1]
            course.append(y)
    return np.array(course)


@pytest.mark.slow
def test_a_side_moves_as_scipys_solvers_say() -> None:
    exact = _scipy("DOP853", 1e-12)
    error = np.abs(_ours(10) - exact).max(axis=0)
    assert np.all(error[[0, 3, 4, 6, 7]] < [2e-5, 5e-8, 5e-6, 5e-8, 5e-6]), error
    assert np.all(error[[2, 5]] < 3e-3), error
    assert np.abs(exact[:, 0]).max() > 1.5
    stiff = _scipy("Radau", 1e-8)
    np.testing.assert_allclose(stiff[:, 0], exact[:, 0], rtol=0, atol=1e-5)


def test_half_the_step_leaves_a_sixteenth_of_the_error() -> None:
    fine = _ours(320)
    errors = np.array([np.abs(_ours(n) - fine)[:, 0].max() for n in (5, 10, 20, 40)])
    assert errors[1] < 2e-5
    np.testing.assert_allclose(errors[:-1] / errors[1:], 16, rtol=0.06)


def test_an_elevator_that_nobody_moves_swings_back_to_the_middle() -> None:
    side = np.zeros(SIDE)
    side[0], side[1] = 1.5, 0.0
    for sample in range(1, 101):
        advance(side, 2.0, (0.0, 1.0), (1000.0, 1000.0), stepping(10))
        time = sample / 100
        rate = np.sqrt(1000 - 25)
        swing = np.cos(rate * time) + 5 / rate * np.sin(rate * time)
        assert side[0] == pytest.approx(1.5 * np.exp(-5 * time) * swing, abs=1e-6)
