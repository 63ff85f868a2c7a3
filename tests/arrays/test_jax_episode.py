"""Episodes in JAX: robustness and bounds equal those of the C++ machines to the bit."""

from __future__ import annotations

from collections.abc import Iterator

import array_cases as cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import strategies as s
from bits import bits
from hypothesis import given

import rtamt
import rtamt_arrays.jax as arrays
from rtamt.errors import InputError, InputTypeError, SpecificationError
from rtamt_arrays.operations import Tensor

READ = ("robustness", "lower", "upper", "verdict")


@pytest.fixture(autouse=True, scope="module")
def doubles() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - its only form
    yield
    jax.config.update("jax_enable_x64", before)


def stepped(formula: rtamt.Formula, samples: Tensor, resets: Tensor) -> arrays.BoundsReading:
    """The readings of a monitor over samples of all variables, in one scan."""
    monitor = arrays.episode(formula)
    places = jnp.array([s.VARIABLES.index(name) for name in monitor.variables])

    def step(state: Tensor, given: Tensor) -> Tensor:
        sample, mask = given
        return monitor.update(monitor.reset(state, mask), sample[:, places])

    readings: arrays.BoundsReading = jax.lax.scan(
        step, monitor.init(resets.shape[1]), (samples, resets)
    )[1]
    return readings


@cases.few
@given(cases.cases(endless=True))
def test_bounds_equal_those_of_the_lockstep_monitor_with_resets_in_the_middle(
    case: cases.Case,
) -> None:
    run = jax.jit(lambda x, m: [stepped(f, x, m) for f in case.formulas])
    for formula, reading in zip(case.formulas, run(case.samples, case.resets), strict=True):
        for name, expected in zip(READ, case.episode(formula, READ), strict=True):
            found = np.ravel(getattr(reading, name))
            assert bits(found) == bits(np.ravel(expected)), (name, formula)


def test_a_nan_decides_nothing_until_the_lane_is_reset() -> None:
    monitor = arrays.episode("always(x > 0)")
    state, _ = monitor.update(monitor.init(2), {"x": jnp.array([jnp.nan, -1.0])})
    state, reading = monitor.update(state, {"x": jnp.array([-1.0, -1.0])})
    assert jnp.isnan(reading.robustness).tolist() == reading.nan.tolist() == [True, False]
    assert reading.lower.tolist() == [-np.inf, -np.inf]
    assert reading.upper.tolist() == [np.inf, -1.0]
    assert reading.verdict.tolist() == [0, -1]
    _, reading = monitor.update(monitor.reset(state), {"x": jnp.array([2.0, 2.0])})
    assert reading.robustness.tolist() == [2.0, 2.0]


def test_what_was_decided_stays_after_more_samples_than_are_counted() -> None:
    monitor = arrays.episode("eventually[0:2](x > 0)")
    state = monitor.init(1)
    for x in (-1.0, 3.0, *[-5.0] * 9):
        state, reading = monitor.update(state, {"x": jnp.array([x])})
    assert reading.lower.tolist() == reading.upper.tolist() == [3.0]


@pytest.mark.parametrize(
    ("formula", "error", "message"),
    [
        (
            " and ".join(f"always(x > {i} or eventually(y > {i}))" for i in range(7)),
            SpecificationError,
            "the limit is 6",
        ),
        ("always[0:1500000000](x > 0)", SpecificationError, "arrays count up to"),
    ],
)
def test_formulas_that_do_not_fit_are_refused(
    formula: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as refused:
        arrays.episode(formula)
    assert message in str(refused.value)


def test_states_of_others_are_refused() -> None:
    monitor, x = arrays.episode("always(x > 0)"), {"x": jnp.ones(2)}
    other = arrays.episode("always(once[0:3](x > 0))")
    foreign: Tensor = arrays.online("x > 0").init(2)
    with pytest.raises(InputError, match="that of another specification"):
        monitor.update(other.init(2), x)
    with pytest.raises(InputTypeError, match="expected a state of this monitor"):
        monitor.reset(foreign)
