"""Monitors of JAX: pure functions under ``jit``, ``vmap``, ``scan`` and ``grad``."""

from __future__ import annotations

from rtamt.typing import Align, Period
from rtamt_arrays.episode import EpisodeArrays
from rtamt_arrays.inputs import ArraySample, Spec, program_of, traces
from rtamt_arrays.jax.operations import JaxOperations, JaxReader
from rtamt_arrays.layout import BoundsReading, EpisodeState
from rtamt_arrays.offline import RobustnessSemantics, lattice_of, robustness_of, smoothing_error
from rtamt_arrays.online import OnlineMonitor, OnlineReading, OnlineState
from rtamt_arrays.operations import Tensor

__all__ = [
    "BoundsReading",
    "EpisodeArrays",
    "EpisodeState",
    "OnlineMonitor",
    "OnlineReading",
    "OnlineState",
    "episode",
    "evaluate",
    "online",
    "smoothing_error",
]


def online(
    spec: Spec, period: Period | None = None, *, align: Align | None = None, dtype: object = None
) -> OnlineMonitor:
    """Return `rtamt.VectorMonitor` as pure functions: robustness that is late by the latency.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`.
        dtype: The dtype of floats; by default JAX's, which is float32 unless x64 is enabled.

    Raises:
        SpecificationError: As for `rtamt.Monitor`.
        InputError: If the period is wrong, or float64 is not enabled.

    Example:
        >>> import jax.numpy as jnp
        >>> monitor = online("once[0:1](x > 0)")
        >>> state = monitor.init(2)
        >>> state, reading = monitor.update(state, {"x": jnp.array([1.0, 2.0])})
        >>> state = monitor.reset(state, jnp.array([True, False]))
        >>> state, reading = monitor.update(state, {"x": jnp.array([-3.0, -3.0])})
        >>> reading.robustness.tolist()
        [-3.0, 2.0]
    """
    return OnlineMonitor(
        program_of(spec, period, align, online=True), JaxOperations(), JaxReader(dtype)
    )


def episode(
    spec: Spec, period: Period | None = None, *, align: Align | None = None, dtype: object = None
) -> EpisodeArrays:
    """Return `rtamt.VectorEpisodeMonitor` as pure functions: robustness, bounds and verdicts.

    The arguments are the same as for `online`.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, or if more than eight
            unbounded operators are inside others.
        InputError: As `online` does.

    Example:
        >>> import jax.numpy as jnp
        >>> monitor = episode("always[0:100](x > 1)")
        >>> state, reading = monitor.update(monitor.init(2), {"x": jnp.array([5.0, 0.0])})
        >>> reading.lower.tolist(), reading.upper.tolist(), reading.verdict.tolist()
        ([-inf, -inf], [4.0, -1.0], [0, -1])
    """
    program = program_of(spec, period, align, online=False)
    return EpisodeArrays(program, JaxOperations(), JaxReader(dtype))


def evaluate(
    spec: Spec,
    signals: ArraySample,
    period: Period | None = None,
    *,
    align: Align | None = None,
    dtype: object = None,
    semantics: RobustnessSemantics = "standard",
    temperature: Tensor | None = None,
) -> Tensor:
    """Return the robustness at every sample of a batch of traces, as `rtamt.evaluate` does.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: For each variable an array of shape (..., samples), others are ignored; or an array
            of shape (..., samples, variables).
        period: As for `rtamt.evaluate`.
        align: As for `rtamt.evaluate`.
        dtype: The dtype of floats; by default JAX's.
        semantics: "standard"; or "smooth", which has a gradient everywhere and the error that
            `smoothing_error` bounds.
        temperature: For "smooth", a number above 0 or an array of shape (). The error is
            proportional to it.

    Returns:
        An array of shape (..., samples). A trace has nan everywhere if a variable or a term is nan
        anywhere, or if the temperature is an array that is not finite and above 0.

    Raises:
        SpecificationError: If a bound is not a multiple of the period.
        InputError: If a variable is missing, a shape or the temperature is wrong, or there are no
            samples or variables.
        InputTypeError: If a signal is not an array of real numbers.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> x = jnp.array([3.0, 1.0, 2.0])
        >>> evaluate("always[0:1](x > 0)", {"x": x}).tolist()
        [1.0, 1.0, 2.0]
        >>> gradient = jax.grad(lambda x: evaluate("always(x > 0)", {"x": x})[0])(x)
        >>> (gradient != 0.0).tolist()
        [False, True, False]
        >>> smooth = evaluate("always(x > 0)", {"x": x}, semantics="smooth", temperature=0.1)
        >>> round(float(smooth[0]), 4)  # the minimum is 1
        1.0
    """
    reader, operations = JaxReader(dtype), JaxOperations()
    lattice = lattice_of(operations, reader, semantics, temperature)
    program = program_of(spec, period, align, online=False)
    values = traces(program, reader, signals)
    return robustness_of(program, operations, reader.dtype, lattice, values).swapaxes(0, -1)
