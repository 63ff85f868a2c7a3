"""The monitors of JAX equal the C++ machines bit by bit."""

from __future__ import annotations

import doctest
import io
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from array_contract import ArrayMonitor, EpisodeContract, OfflineContract, OnlineContract, places
from bits import bits
from numpy.typing import NDArray

import rtamt_arrays.jax as arrays
from rtamt.errors import InputError, InputTypeError
from rtamt.program.algebra import FUNCTIONS
from rtamt_arrays import functions, offline
from rtamt_arrays.operations import Tensor

pytestmark = pytest.mark.usefixtures("doubles")


class Jax:
    """JAX under ``jit`` and ``scan``: a compiler takes a second, so it gets formulas together."""

    arrays = arrays
    kinds = (jnp.float32, jnp.bfloat16)

    def doubles(self, values: Tensor) -> Tensor:
        return values.astype(jnp.float64)

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
    """Return the readings over samples, of all variables or of its own, in one scan."""
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


def test_steps_are_vectorized_by_vmap_as_entries_are() -> None:
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
def test_monitor_made_during_a_trace(
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


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (arrays.online, "historically[0:3](x > 0) and once(y > 1)"),
        (arrays.episode, "always(x > 0 implies eventually[0:3](y > 1)) and (x > 1) until (y > 1)"),
    ],
)
def test_a_state_that_was_saved_goes_on_where_it_was(
    made: Callable[..., ArrayMonitor], text: str
) -> None:
    monitor, file = made(text), io.BytesIO()
    samples = jnp.asarray(np.random.default_rng(8).normal(size=(9, 3, 2)))
    state = monitor.init(3)
    for sample in samples[:6]:
        state, _ = monitor.update(state, sample)
    np.savez(file, **state._asdict())
    file.seek(0)
    loaded = type(state)(**np.load(file))
    for sample in samples[6:]:
        (state, expected), (loaded, found) = (
            monitor.update(each, sample) for each in (state, loaded)
        )
        for x, y in zip((*loaded, *found), (*state, *expected), strict=True):
            assert bits(x) == bits(y)


@pytest.mark.parametrize("made", [arrays.online, arrays.episode])
def test_gradient_of_the_deciding_sample(
    made: Callable[..., ArrayMonitor],
) -> None:
    monitor = made("historically[0:3](x > 0)" if made is arrays.online else "always(x > 0)")
    samples = jnp.asarray([[[3.0]], [[1.0]], [[2.0]]])
    resets = jnp.zeros((3, 1), dtype=bool)
    gradient = jax.grad(lambda x: stepped(monitor, x, resets, every=True).robustness[-1, 0])
    assert np.ravel(gradient(samples)).tolist() == [0.0, 1.0, 0.0]


def test_float64_must_be_enabled() -> None:
    monitor, x = arrays.online("x > 0"), {"x": np.zeros(2)}
    state = monitor.init(2)
    with jax.enable_x64(new_val=False):
        for call in (
            lambda: arrays.online("x > 0", dtype="float64"),
            lambda: arrays.evaluate("x > 0", x, dtype=float),
            lambda: monitor.update(state, x),
        ):
            with pytest.raises(InputError, match=r"float64 is not enabled; call jax\.config"):
                call()


def test_saved_bfloat16_state_error() -> None:
    monitor, file = arrays.online("once[0:1](x > 0)", dtype=jnp.bfloat16), io.BytesIO()
    state, _ = monitor.update(monitor.init(2), jnp.array([[3.0], [1.0]]))
    np.savez(file, **state._asdict())
    file.seek(0)
    loaded = type(state)(**np.load(file))
    with pytest.raises(InputTypeError, match="with arrays of bfloat16 as 'ring', got"):
        monitor.reset(loaded)
    kinds = {name: x.dtype for name, x in state._asdict().items()}
    viewed = type(state)(**{name: x.view(kinds[name]) for name, x in loaded._asdict().items()})
    _, reading = monitor.update(viewed, jnp.array([[2.0], [2.0]]))
    assert reading.robustness.tolist() == [3.0, 2.0]


DEVICES = """
import sys
from functools import partial

import jax
import numpy as np
from jax.sharding import PartitionSpec

import rtamt_arrays.jax as arrays

assert len(jax.devices()) == 4
monitor = getattr(arrays, sys.argv[1])(sys.argv[2])
samples = np.random.default_rng(9).normal(size=(12, 8, 2)).astype(np.float32)
resets = np.random.default_rng(9).random((12, 8)) < 0.1
step = lambda state, given: monitor.update(monitor.reset(state, given[1]), given[0])
run = lambda state, samples, resets: jax.lax.scan(step, state, (samples, resets))

# Entries are the last axis of what has entries; the places of delays have none.
state = monitor.init(8)
entries = lambda x, axes: PartitionSpec(*[None] * (axes - 1), "entries")
states = type(state)(
    *(
        PartitionSpec() if name == "place" else entries(x, x.ndim)
        for name, x in state._asdict().items()
    )
)
_, reading = jax.eval_shape(run, state, samples, resets)
mesh = jax.sharding.Mesh(jax.devices(), ("entries",))
sharded = jax.shard_map(
    run,
    mesh=mesh,
    in_specs=(states, PartitionSpec(None, "entries"), PartitionSpec(None, "entries")),
    out_specs=(states, jax.tree.map(lambda x: entries(x, x.ndim), reading)),
)
compiled = jax.jit(sharded).lower(state, samples, resets).compile()
for word in ("all-reduce", "all-gather", "collective-permute", "all-to-all"):
    assert word not in compiled.as_text(), word
found, expected = compiled(state, samples, resets), jax.jit(run)(state, samples, resets)
for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
    assert np.asarray(x).tobytes() == np.asarray(y).tobytes()
assert len(found[1].robustness.sharding.device_set) == 4
print("equal")
"""


@pytest.mark.parametrize(
    ("made", "text"),
    [
        ("online", "historically[0:3](x > 0) and once(y > 1)"),
        ("episode", "always(x > 0 implies eventually[0:3](y > 1)) and (x > 1) until (y > 1)"),
    ],
)
def test_sharded_step_has_no_communication(made: str, text: str) -> None:
    """In a process of its own, because JAX fixes the number of devices at its start."""
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=4", "JAX_PLATFORMS": "cpu"}
    ran = subprocess.run(
        [sys.executable, "-c", DEVICES, made, text],
        env=os.environ | flags | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stdout == "equal\n", ran.stderr


def test_functions_are_those_of_programs() -> None:
    assert set(functions.FUNCTIONS) == set(FUNCTIONS)


def test_the_examples_of_docstrings_show_what_happens() -> None:
    for module in (arrays, offline):
        done = doctest.testmod(module)
        assert done.attempted
        assert not done.failed
