"""Monitors of torch: functions of tensors, in eager mode and under ``torch.compile``."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from rtamt.typing import Align, Period
from rtamt_arrays.inputs import ArraySample, Spec, program_of, traces
from rtamt_arrays.layout import BoundsReading, EpisodeState
from rtamt_arrays.offline import RobustnessSemantics, evaluated, lattice_of, smoothing_error
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

# Under torch.compile a specification is read while the graph is made, and is no part of it.
_program_of = torch.compiler.assume_constant_result(program_of)

# torch.load reads states that were saved, with what it takes for safe.
torch.serialization.add_safe_globals([OnlineState, EpisodeState])


def online(
    spec: Spec,
    period: Period | None = None,
    *,
    align: Align | None = None,
    dtype: object = None,
    device: object = None,
) -> TorchOnlineMonitor:
    """`rtamt.VectorMonitor` on tensors: the robustness of every lane, late by the latency.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`.
        dtype: The kind of floats; None: the default of torch, which is float32 at first.
        device: Where state and samples are; None: the default of torch.

    Raises:
        SpecificationError: As for `rtamt.Monitor`, so on a future without an end.
        InputError: On a period that is none, or a device that is not there.

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
    """`rtamt.VectorEpisodeMonitor` on tensors: robustness, bounds and verdict of each lane.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `rtamt.Monitor`.
        align: As for `rtamt.Monitor`.
        dtype: The kind of floats; None: the default of torch, which is float32 at first.
        device: Where state and samples are; None: the default of torch.

    Raises:
        SpecificationError: On bounds that are no whole number of samples, or more than six
            operators without an end inside others.
        InputError: On a period that is none, or a device that is not there.

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
    """Robustness at every sample of traces, many at once; `rtamt.evaluate` of each.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: For each variable a tensor of shape (..., samples), others are ignored; or one
            tensor of shape (..., samples, variables).
        period: As for `rtamt.evaluate`.
        align: As for `rtamt.evaluate`.
        dtype: The kind of floats; None: the default of torch.
        semantics: "standard", or "smooth": smooth min and max between formulas and over windows,
            which have a gradient everywhere; `smoothing_error` says how far they may be off.
        temperature: Of the smooth ones, a number above 0 or a tensor of shape (): the nearer to 0,
            the nearer to min and max.

    Returns:
        A tensor of shape (..., samples); nan throughout a trace in which a variable or a term is,
        and where it depends on a temperature in a tensor that is not finite and above 0.

    Raises:
        SpecificationError: On bounds that are no whole number of samples.
        InputError: On a missing variable, other shapes, no samples, no variable at all, or a
            temperature that is missing, not wanted, or a number that is not finite and above 0.
        InputTypeError: On what are no tensors of real numbers.

    Example:
        >>> import torch
        >>> x = torch.tensor([3.0, 1.0, 2.0], requires_grad=True)
        >>> evaluate("always[0:1](x > 0)", {"x": x}).tolist()
        [1.0, 1.0, 2.0]
        >>> evaluate("always(x > 0)", {"x": x})[0].backward()
        >>> (x.grad != 0.0).tolist()
        [False, True, False]
        >>> smooth = evaluate("always(x > 0)", {"x": x}, semantics="smooth", temperature=0.1)
        >>> round(smooth[0].item(), 4)  # the least value is 1
        1.0
    """
    reader = TorchReader(dtype, _device_of(signals))
    operations = TorchOperations(reader.device)
    lattice = lattice_of(operations, reader, semantics, temperature)
    program = _program_of(spec, period, align, online=False)
    values = traces(program, reader, signals)
    return evaluated(program, operations, reader.dtype, lattice, values).swapaxes(0, -1)


def _device_of(signals: ArraySample) -> object:
    values = signals.values() if isinstance(signals, Mapping) else [signals]
    return next((each.device for each in values if isinstance(each, torch.Tensor)), None)
