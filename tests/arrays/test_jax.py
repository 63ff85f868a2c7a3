"""The monitors of JAX equal the C++ machines to the bit."""

from __future__ import annotations

import doctest
from collections.abc import Callable, Iterator

import array_cases as cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import strategies as s
from bits import bits
from hypothesis import given, settings

import rtamt
import rtamt_arrays.jax as arrays
from rtamt.errors import InputError, InputTypeError, SpecificationError
from rtamt.program.algebra import FUNCTIONS
from rtamt_arrays import functions
from rtamt_arrays.operations import Tensor


@pytest.fixture(autouse=True, scope="module")
def doubles() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - its only form
    yield
    jax.config.update("jax_enable_x64", before)


def stepped(formula: rtamt.Formula, samples: Tensor, resets: Tensor) -> Tensor:
    """The readings of a monitor over samples of all variables, in one scan."""
    monitor = arrays.online(formula)
    places = jnp.array([s.VARIABLES.index(name) for name in monitor.variables])

    def step(state: Tensor, given: Tensor) -> Tensor:
        sample, mask = given
        return monitor.update(monitor.reset(state, mask), sample[:, places])

    return jax.lax.scan(step, monitor.init(resets.shape[1]), (samples, resets))[1]


@cases.few
@given(cases.cases())
def test_online_equals_the_lockstep_monitor_with_resets_in_the_middle(case: cases.Case) -> None:
    run = jax.jit(lambda x, m: [stepped(f, x, m).robustness for f in case.formulas])
    readings = run(case.samples, case.resets)
    for formula, reading in zip(case.formulas, readings, strict=True):
        assert bits(np.ravel(reading)) == bits(np.ravel(case.online(formula))), formula


@cases.few
@given(cases.cases(endless=True))
def test_evaluate_equals_the_offline_evaluation(case: cases.Case) -> None:
    run = jax.jit(lambda x: [arrays.evaluate(f, cases.columns(f, x)) for f in case.formulas])
    for formula, each in zip(case.formulas, run(case.samples), strict=True):
        assert bits(np.ravel(each)) == bits(np.ravel(case.offline(formula))), formula


@settings(max_examples=15)
@given(s.formulas(3).filter(lambda f: bool(f.variables)), s.traces())
def test_every_function_is_right_within_four_units_in_the_last_place(
    formula: rtamt.Formula, trace: s.Trace
) -> None:
    columns = {name: np.array(trace[name]) for name in formula.variables}
    expected = rtamt.evaluate(formula, columns)
    found = np.asarray(arrays.evaluate(formula, columns))
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


@settings(max_examples=3)
@given(cases.cases())
def test_the_gradient_through_the_steps_is_that_of_the_trace(case: cases.Case) -> None:
    samples = jnp.asarray(np.random.default_rng(1).normal(size=case.samples.shape))
    late = [arrays.online(f).latency for f in case.formulas]

    def online(samples: Tensor) -> list[Tensor]:
        found = [stepped(f, samples, jnp.zeros_like(case.resets)) for f in case.formulas]
        return [each.robustness[n:].sum() for n, each in zip(late, found, strict=True)]

    def offline(samples: Tensor) -> list[Tensor]:
        found = [arrays.evaluate(f, cases.columns(f, samples)) for f in case.formulas]
        ends = [max(0, cases.SAMPLES - n) for n in late]
        return [each[:, :end].sum() for end, each in zip(ends, found, strict=True)]

    def gradients(function: Callable[[Tensor], list[Tensor]]) -> Tensor:
        return jax.jit(jax.jacrev(function))(samples)

    for x, y in zip(gradients(online), gradients(offline), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)


def test_the_gradient_of_a_least_value_is_that_of_one_sample_that_attains_it() -> None:
    def least(x: Tensor) -> Tensor:
        return arrays.evaluate("always(x >= 0)", {"x": x})[0]

    assert sorted(jax.grad(least)(jnp.array([2.0, 0.0, 0.0])).tolist()) == [0.0, 0.0, 1.0]


def test_a_nan_takes_the_robustness_of_its_lane_until_the_lane_is_reset() -> None:
    monitor = arrays.online("once[0:1](sqrt(x) > 1 or x > 2)")
    state, seen = monitor.init(2), []
    for x, y in ((4, 4), (-1, 4), (4, 4)):
        state, reading = monitor.update(state, {"x": jnp.array([x, y])})
        seen.append((reading.nan.tolist(), jnp.isnan(reading.robustness).tolist()))
    assert seen == [([False] * 2,) * 2, ([True, False],) * 2, ([True, False],) * 2]
    state, reading = monitor.update(monitor.reset(state), {"x": jnp.array([4, 4])})
    assert reading.robustness.tolist() == [2.0, 2.0]
    nan = arrays.evaluate("x > 0", {"x": jnp.array([[1.0, jnp.nan], [1.0, 2.0]])})
    np.testing.assert_array_equal(nan, [[np.nan, np.nan], [1.0, 2.0]])


def test_steps_are_vectorized_by_vmap_as_lanes_are() -> None:
    monitor = arrays.online("historically[0:2](x > y)")
    samples = jnp.asarray(np.random.default_rng(0).normal(size=(5, 4, 3, 2)))
    states = jax.vmap(lambda _: monitor.init(3))(jnp.arange(4))
    wide = monitor.init(12)
    for sample in samples:
        states, reading = jax.vmap(monitor.update)(states, sample)
        wide, expected = monitor.update(wide, sample.reshape(12, 2))
        np.testing.assert_array_equal(reading.robustness.ravel(), expected.robustness)


def test_a_window_may_be_longer_than_any_trace() -> None:
    monitor = arrays.online("historically[0:1000](x > 0)", dtype=jnp.float32)
    step = jax.jit(monitor.update, donate_argnums=0)
    state = monitor.init(1)
    for x in (3.0, 1.0, 2.0):
        state, reading = step(state, jnp.array([[x]]))
    assert reading.robustness.tolist() == [1.0]
    assert reading.robustness.dtype == jnp.float32


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda m, s: m.update(s, {"y": jnp.ones(2)}), InputError, "variable 'x', got y"),
        (lambda m, s: m.update(s, {"x": jnp.ones(3)}), InputError, "expected shape (2,) of 'x'"),
        (lambda m, s: m.update(s, jnp.ones((2, 3))), InputError, "to have 1 variables (x)"),
        (lambda m, s: m.update(s, {"x": [1.0, 2.0]}), InputTypeError, "arrays of real numbers"),
        (lambda m, s: m.update(s, {"x": jnp.ones(2) * 1j}), InputTypeError, "of real numbers"),
        (lambda m, s: m.update((s,), {"x": jnp.ones(2)}), InputTypeError, "init(lanes) makes"),
        (lambda m, s: m.reset(s, jnp.ones(2)), InputTypeError, "mask of booleans"),
        (lambda m, s: m.reset(s, jnp.ones(3, dtype=bool)), InputError, "mask of shape (2,)"),
        (lambda m, _: m.init(0), InputError, "expected 1 lane or more, got 0"),
        (lambda m, _: m.init(2.0), InputTypeError, "expected a number of lanes, got 2.0"),
        (
            lambda m, _: m.update(arrays.online("once[0:9](x > 0)").init(2), {"x": jnp.ones(2)}),
            InputError,
            "it is that of another specification",
        ),
        (lambda *_: arrays.online("always(x > 0) or x > 1"), SpecificationError, "whole future"),
        (lambda *_: arrays.online("x > 0", dtype=int), InputTypeError, "a dtype of floats"),
        (lambda *_: arrays.evaluate("x > 0", {"x": jnp.ones(0)}), InputError, "1 sample or more"),
        (lambda *_: arrays.evaluate("x > 0", {"x": jnp.ones(())}), InputError, "axis of samples"),
        (lambda *_: arrays.evaluate("true", {}), InputError, "a variable"),
    ],
)
def test_what_is_wrong_is_refused_when_it_is_traced(
    call: Callable[..., object], error: type[Exception], message: str
) -> None:
    monitor = arrays.online("once[0:1](x > 0)")
    with pytest.raises(error) as refused:
        jax.jit(lambda: call(monitor, monitor.init(2)))()
    assert message in str(refused.value)


def test_functions_are_those_of_programs() -> None:
    assert set(functions.FUNCTIONS) == set(FUNCTIONS)


def test_the_examples_of_docstrings_show_what_happens() -> None:
    done = doctest.testmod(arrays)
    assert done.attempted
    assert not done.failed
