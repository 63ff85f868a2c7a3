"""The monitors of JAX equal the C++ machines to the bit."""

from __future__ import annotations

import doctest
from collections.abc import Callable, Iterator, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from array_contract import ArrayMonitor, EpisodeContract, OfflineContract, OnlineContract, places
from numpy.typing import NDArray

import rtamt_arrays.jax as arrays
from rtamt.program.algebra import FUNCTIONS
from rtamt_arrays import functions, smooth
from rtamt_arrays.operations import Tensor


@pytest.fixture(autouse=True, scope="module")
def doubles() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - its only form
    yield
    jax.config.update("jax_enable_x64", before)


class Jax:
    """JAX under ``jit`` and ``scan``: a compiler takes a second, so it gets formulas together."""

    arrays = arrays

    def tensor(self, values: object) -> Tensor:
        array = np.array(values)
        return jnp.asarray(array if array.dtype.kind in "bc" else array.astype(np.float64))

    def traced(self, call: Callable[[], object]) -> object:
        return jax.jit(call)()

    def readings(
        self,
        monitors: Sequence[ArrayMonitor],
        samples: NDArray[np.float64],
        resets: NDArray[np.bool_],
    ) -> list[Mapping[str, NDArray[np.float64]]]:
        run = jax.jit(lambda x, m: [stepped(monitor, x, m) for monitor in monitors])
        return [reading._asdict() for reading in run(samples, resets)]

    def evaluated(
        self, evaluations: Sequence[Callable[[Tensor], Tensor]], samples: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        return [
            np.asarray(each) for each in jax.jit(lambda x: [f(x) for f in evaluations])(samples)
        ]

    def gradients(
        self, functions: Sequence[Callable[[Tensor], Tensor]], samples: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        gradients = jax.jacrev(lambda x: [f(x) for f in functions])
        return [np.asarray(gradient) for gradient in jax.jit(gradients)(samples)]

    def sum_of_finite(self, values: Tensor) -> Tensor:
        return jnp.where(jnp.isfinite(values), values, 0.0).sum()

    def robustness_sum(self, monitor: ArrayMonitor, samples: Tensor) -> Tensor:
        readings = stepped(monitor, samples, jnp.zeros(samples.shape[:2], dtype=bool), every=True)
        return readings.robustness[monitor.latency :].sum()


def stepped(
    monitor: ArrayMonitor, samples: Tensor, resets: Tensor, *, every: bool = False
) -> Tensor:
    """The readings of a monitor over samples, of all variables or of its own, in one scan."""
    chosen = samples if every else samples[..., jnp.array(places(monitor.variables))]

    def step(state: Tensor, given: Tensor) -> Tensor:
        sample, mask = given
        return monitor.update(monitor.reset(state, mask), sample)

    return jax.lax.scan(step, monitor.init(resets.shape[1]), (chosen, resets))[1]


class TestOnline(OnlineContract):
    library = Jax()


class TestEpisode(EpisodeContract):
    library = Jax()


class TestOffline(OfflineContract):
    library = Jax()


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


@pytest.mark.parametrize("made", [arrays.online, arrays.episode])
def test_a_monitor_that_was_made_while_jax_traced_can_be_used_after(
    made: Callable[..., ArrayMonitor],
) -> None:
    kept = []

    def first(x: Tensor) -> Tensor:
        kept.append(made("once[0:3](x > 0 and historically(x > -1))"))
        return kept[0].update(kept[0].init(2), {"x": x})[1].robustness

    x = jnp.array([1.0, 2.0])
    found = jax.jit(first)(x)
    _, reading = kept[0].update(kept[0].init(2), {"x": x})
    assert reading.robustness.tolist() == found.tolist()


def test_functions_are_those_of_programs() -> None:
    assert set(functions.FUNCTIONS) == set(FUNCTIONS)


def test_the_examples_of_docstrings_show_what_happens() -> None:
    for module in (arrays, smooth):
        done = doctest.testmod(module)
        assert done.attempted
        assert not done.failed
