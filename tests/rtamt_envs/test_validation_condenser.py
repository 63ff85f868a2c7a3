"""The steam condenser against SciPy's implicit solvers and a robustness in NumPy."""

import functools

import numpy as np
import pytest
from models import condenser, requirements
from models.judged import evaluated, monitored, observed
from numpy.typing import NDArray

pytestmark = pytest.mark.slow

Floats = NDArray[np.float64]


@functools.cache
def inputs() -> Floats:
    """Return steam flows (12, 3500, 1): twenty pieces of 1.75 s, the last two cases at corners."""
    rng = np.random.default_rng(7)
    flows = rng.uniform(3.99, 4.01, (12, 20))
    flows[10:] = rng.choice([3.99, 4.01], (2, 20))
    return flows.repeat(175, axis=1)[..., None]


@functools.cache
def traces() -> Floats:
    return observed("SteamCondenser", inputs())


def test_pressure_and_its_reading_are_those_of_an_implicit_solver() -> None:
    # Radau and DOP853 at 1e-12 show an error of 4e-8 kPa for steps of 0.01 s; LSODA at 1e-10, which
    # is faster, adds 2e-8.
    for case, trace in zip(inputs(), traces(), strict=True):
        rows = condenser.solve(case[:, 0])
        np.testing.assert_allclose(trace[:, [0, 5]], rows[:, [3, 0]], rtol=0, atol=1e-7)
        np.testing.assert_allclose(trace[:, [2, 3]], rows[:, [1, 2]], rtol=0, atol=5e-7)


def test_robustness_and_verdict_are_those_of_numpy() -> None:
    (name,) = evaluated("SteamCondenser", traces()[0])
    for trace in traces():
        assert evaluated("SteamCondenser", trace) == {name: requirements.condenser(trace[:, 0])}
    for case in (0, 11):
        expected = requirements.condenser(traces()[case][:, 0])
        verdict = "VIOLATED" if expected < 0 else "SATISFIED"
        assert monitored("SteamCondenser", inputs()[case]) == {name: (verdict, expected)}
