"""Monitors of torch: functions of tensors, in eager mode and under ``torch.compile``."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from rtamt.typing import Align, Period
from rtamt_arrays.inputs import ArraySample, Spec, program_of, traces
from rtamt_arrays.layout import BoundsReading, EpisodeState
from rtamt_arrays.offline import RobustnessSemantics, lattice_of, robustness_of, smoothing_error
from rtamt_arrays.online import OnlineReading, OnlineState
from rtamt_arrays.operations import Tensor
from rtamt_arrays.torch.monitors import TorchEpisodeMonitor, TorchOnlineMonitor
from rtamt_arrays.torch.operations import TorchOperations, TorchReader

__all__ = [
    "BoundsReading",
    "EpisodeState",
    "OnlineReading",
    "OnlineState",
    "TorchEpisodeMonitor",
    "TorchOnlineMonitor",
    "episode",
    "evaluate",
    "online",
    "smoothing_error",
]

# torch.compile calls this while it builds a graph, and uses the result as a constant.
_program_of = torch.compiler.assume_constant_result(program_of)

# Saved states can be read with torch.load(weights_only=True).
torch.serialization.add_safe_globals([OnlineState, EpisodeState])


def online(
    spec: Spec,
    period: Period | None = None,
    *,
    align: Align | None = None,
    dtype: object = None,
    device: object = None,
) -> TorchOnlineMonitor:
    """Return `rtamt.VectorMonitor` on tensors: robustness that is late by the latency.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`.
        dtype: The dtype of floats; by default torch's, which is float32 unless it was set.
        device: The device of states and samples; by default torch's.

    Raises:
        SpecificationError: As for `rtamt.Monitor`.
        InputError: If the period is wrong, or the device does not exist.

    Example:
        >>> import torch
        >>> monitor = online("once[0:1](x > 0)")
        >>> state = monitor.init(2)
        >>> state, reading = monitor.update(state, {"x": torch.tensor([1.0, 2.0])})
        >>> state = monitor.reset(state, torch.tensor([True, False]))
        >>> state, reading = monitor.update(state, {"x": torch.tensor([-3.0, -3.0])})
        >>> reading.robustness.tolist()
        [-3.0, 2.0]
    """
    program = program_of(spec, period, align, online=True)
    return TorchOnlineMonitor(program, TorchReader(dtype, device))


def episode(
    spec: Spec,
    period: Period | None = None,
    *,
    align: Align | None = None,
    dtype: object = None,
    device: object = None,
) -> TorchEpisodeMonitor:
    """Return `rtamt.VectorEpisodeMonitor` on tensors: robustness, bounds and verdicts.

    The arguments are the same as for `online`.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, or if more than eight
            unbounded operators are inside others.
        InputError: As `online` does.

    Example:
        >>> import torch
        >>> monitor = episode("always[0:100](x > 1)")
        >>> state, reading = monitor.update(monitor.init(2), {"x": torch.tensor([5.0, 0.0])})
        >>> reading.lower.tolist(), reading.upper.tolist(), reading.verdict.tolist()
        ([-inf, -inf], [4.0, -1.0], [0, -1])
    """
    program = program_of(spec, period, align, online=False)
    return TorchEpisodeMonitor(program, TorchReader(dtype, device))


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

    Arguments, result and errors are the same as for `rtamt_arrays.jax.evaluate`, with tensors.

    Example:
        >>> import torch
        >>> x = torch.tensor([3.0, 1.0, 2.0], requires_grad=True)
        >>> evaluate("always[0:1](x > 0)", {"x": x}).tolist()
        [1.0, 1.0, 2.0]
        >>> evaluate("always(x > 0)", {"x": x})[0].backward()
        >>> (x.grad != 0.0).tolist()
        [False, True, False]
        >>> smooth = evaluate("always(x > 0)", {"x": x}, semantics="smooth", temperature=0.1)
        >>> round(smooth[0].item(), 4)  # the minimum is 1
        1.0
    """
    reader = TorchReader(dtype, _device_of(signals))
    operations = TorchOperations(reader.device)
    lattice = lattice_of(operations, reader, semantics, temperature)
    program = _program_of(spec, period, align, online=False)
    values = traces(program, reader, signals)
    return robustness_of(program, operations, reader.dtype, lattice, values).swapaxes(0, -1)


def _device_of(signals: ArraySample) -> object:
    values = signals.values() if isinstance(signals, Mapping) else [signals]
    return next((value.device for value in values if isinstance(value, torch.Tensor)), None)
