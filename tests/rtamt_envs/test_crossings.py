"""The first crossing of a polynomial, compared with its roots."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from interpreted import compiled_and_interpreted
from rtamt_envs.chasing_cars import first_crossing

coefficients = st.lists(st.floats(-8, 8).map(lambda x: round(x, 3)), min_size=1, max_size=7)


def first(polynomial: list[float], level: float = 0.0, sign: float = 1.0) -> float:
    return first_crossing(np.array(polynomial), len(polynomial), level, sign)


@given(coefficients, st.sampled_from([-1.0, 1.0]), st.floats(-4, 4).map(lambda x: round(x, 3)))
@example([1.0, -6.0, 8.0], 1.0, 0.0)  # below 0 only from 1/4 to 1/2: both ends are above
@example([0.125, -0.75, 1.125, 0.0], 1.0, 0.0)
def test_it_is_the_first_root(polynomial: list[float], sign: float, level: float) -> None:
    found = first(polynomial, level, sign)
    course = sign * (np.polynomial.Polynomial(polynomial) - level)
    if found == 0.0:
        assert course(0.0) <= 0.0
        return
    before = np.linspace(0.0, min(found, 1.0), 4001)[:-1]
    scale = 1.0 + np.abs(polynomial).sum()
    assert course(before).min() > -1e-9 * scale
    if found <= 1.0:
        assert abs(course(found)) <= 1e-13 * scale
    else:
        assert found == 2.0
        assert course(1.0) > 0.0


@pytest.mark.parametrize("at", [0.001, 0.25, 1 / 3, 0.9, 1.0])
def test_a_root_is_found_to_rounding(at: float) -> None:
    assert first([at, -1.0]) == pytest.approx(at, rel=4e-16)
    assert first([at * at, 0.0, -1.0]) == pytest.approx(at, rel=4e-16)
    assert first([-math.expm1(at), 1.0, 0.5, 1 / 6, 1 / 24], sign=-1.0) == pytest.approx(
        first([math.expm1(at), -1.0, -0.5, -1 / 6, -1 / 24]), rel=4e-16
    )


@pytest.mark.parametrize("at", [0.25, 1 / 3, 0.7])
def test_a_touch_counts_and_what_misses_by_a_little_does_not(at: float) -> None:
    below = 1e-12
    assert first([at * at - below, -2 * at, 1.0]) == pytest.approx(at, abs=2e-6)
    assert first([at * at + below, -2 * at, 1.0]) == 2.0


@pytest.mark.slow
def test_crossings_are_the_same_without_numba() -> None:
    program = (
        "import numpy as np\n"
        "from rtamt_envs.chasing_cars import first_crossing\n"
        "rows = np.random.default_rng(0).uniform(-8, 8, (400, 4)).round(3).tolist()\n"
        "rows += [[1 / 9 + 1e-12, -2 / 3, 1.0], [1.0, -6.0, 8.0], [0.957, -2.339, -2.941, 2.247]]\n"
        "for row in rows:\n"
        "    for sign in (-1.0, 1.0):\n"
        "        print(first_crossing(np.array(row), len(row), 0.0, sign).hex())\n"
    )
    compiled, interpreted = compiled_and_interpreted(program)
    assert len(compiled.split()) == 806
    assert {0.0, 2.0} < {float.fromhex(each) for each in compiled.split()}
    assert compiled == interpreted
