"""Robustness of recorded traces on arrays, with exact or smooth min and max.

With a temperature T, the smooth max of numbers x is T log(sum(exp(x / T))), and the smooth min is
the negated smooth max of the negated numbers. Both have a gradient everywhere; the gradient of each
number is its share of the sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, SupportsIndex

import numpy as np

from rtamt.errors import InputError, InputTypeError, brief
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.program import Program
from rtamt.typing import Align, Period
from rtamt_arrays.functions import FUNCTIONS, Fold, Lattice, exact, slide
from rtamt_arrays.inputs import (
    ArrayReader,
    Spec,
    as_whole,
    dtype_name,
    program_of,
    raise_error,
    terms,
)
from rtamt_arrays.operations import Operations, Tensor


def robustness_of(
    program: Program, o: Operations, dtype: object, lattice: Lattice, values: list[Tensor]
) -> Tensor:
    """Return the robustness at every time of traces; time is the first axis.

    If a variable or a term is nan anywhere in a trace, its robustness is nan everywhere.
    """
    shape = tuple(values[0].shape)
    n = shape[0]
    registers, is_nan = terms(program, o, dtype, values)
    for instruction in program.instructions[program.terms :]:
        match instruction:
            case Map("min", (a, b)):
                registers.append(lattice.lesser(registers[a], registers[b]))
            case Map("max", (a, b)):
                registers.append(lattice.greater(registers[a], registers[b]))
            case Map(function, args):
                registers.append(FUNCTIONS[function](o, *(registers[a] for a in args)))
            case Window(name, lo, hi, args):
                # As in `Program.clamped`, with code that graph compilers support.
                lo = -n if lo is None else max(-n, min(n, lo))
                hi = n if hi is None else max(-n, min(n, hi))
                fold = Fold.named(name, lattice)
                before, after = max(0, -lo), max(0, hi)
                x = tuple(
                    o.concatenate(
                        [
                            o.full((before, *shape[1:]), identity, dtype),
                            o.broadcast(registers[a], shape),
                            o.full((after, *shape[1:]), identity, dtype),
                        ]
                    )
                    for a, identity in zip(args, fold.identity, strict=True)
                )
                begin = lo + before
                registers.append(slide(fold, x, hi - lo + 1)[-1][begin : begin + n])
            case Load() | Const():
                msg = "an input after the terms"
                raise AssertionError(msg)
    result = o.broadcast(registers[program.result], shape)
    if is_nan is None:
        return result
    count = o.as_integers(is_nan).sum(0)
    return o.where(count > 0, math.nan, result)


RobustnessSemantics = Literal["standard", "smooth"]
"""The robustness with exact or with smooth min and max."""

_Error = tuple[float, float]
"""How far a smooth value may be below and above the standard value, at temperature 1."""


def lattice_of(
    o: Operations,
    reader: ArrayReader,
    semantics: RobustnessSemantics,
    temperature: Tensor | None,
) -> Lattice:
    """Return min and max of a semantics, or raise an error about its temperature."""
    if semantics == "standard":
        if temperature is not None:
            text = (
                f"temperature={reader.describe(temperature)} has no effect with "
                "semantics='standard'; set semantics='smooth', or leave it out"
            )
            raise_error(reader, InputError, text)
        return exact(o)
    if semantics != "smooth":
        hint = reader.nearest(str(semantics), ["standard", "smooth"])
        text = f"expected semantics 'standard' or 'smooth', got {semantics!r}{hint}"
        raise_error(reader, InputError, text)
    if temperature is None:
        text = "semantics='smooth' needs a temperature; set temperature= to a number above 0"
        raise_error(reader, InputError, text)
    if getattr(temperature, "shape", None) == () and not isinstance(temperature, np.generic):
        array = reader.as_array(temperature)
        if array is not None:
            # An error cannot depend on the content of an array.
            return _smooth(o, o.where((array > 0.0) & ~o.isinf(array), array, math.nan))
    number, (low, high) = _checked(reader, temperature), reader.limits
    if not low <= number <= high:
        text = (
            f"expected a temperature from {low:.3g} to {high:.3g}, the normal numbers of "
            f"{dtype_name(reader.dtype)}, got {number}"
        )
        raise_error(reader, InputError, text)
    return _smooth(o, number)


def _checked(reader: ArrayReader | None, temperature: object) -> float:
    if isinstance(temperature, bool) or not isinstance(
        temperature, int | float | np.floating | np.integer
    ):
        shown = brief if reader is None else reader.describe
        text = f"expected a number as temperature, got {shown(temperature)}"
        raise_error(reader, InputTypeError, text)
    if not 0.0 < temperature < math.inf:
        text = f"expected a finite temperature above 0, got {temperature}"
        raise_error(reader, InputError, text)
    return temperature if isinstance(temperature, int | float) else float(temperature)


def _smooth(o: Operations, temperature: Tensor) -> Lattice:
    lattice = exact(o)

    def greater(x: Tensor, y: Tensor) -> Tensor:
        # Use the exact maximum for infinite numbers, whose gradients would be nan, and for
        # numbers that overflow when they are divided by the temperature.
        infinite = o.isinf(x / temperature) | o.isinf(y / temperature)
        both = (o.where(infinite, 0.0, number) / temperature for number in (x, y))
        return o.where(infinite, lattice.greater(x, y), temperature * o.logaddexp(*both))

    return Lattice(lambda x, y: -greater(-x, -y), greater)


def smoothing_error(
    spec: Spec,
    samples: SupportsIndex,
    temperature: float,
    period: Period | None = None,
    *,
    align: Align | None = None,
) -> tuple[float, float]:
    """Return how far smooth robustness can be below and above standard robustness.

    A smooth max of n numbers exceeds their max by at most T log n, and a smooth min is below their
    min by at most T log n. The bounds hold at every time of every trace: with smooth robustness s
    and bounds (below, above), the standard robustness is in [s - above, s + below]. Hence s > above
    proves that the requirement is satisfied, and s < -below proves that it is violated.

    Args:
        spec: As for ``evaluate``.
        samples: The number of samples of a trace, 1 or more.
        temperature: A finite number above 0.
        period: As for ``evaluate``.
        align: As for ``evaluate``.

    Returns:
        Two numbers of 0 or more, in the unit of the robustness.

    Raises:
        SpecificationError: If a bound is not a multiple of the period.
        InputError: If ``samples`` is below 1, or the temperature is not finite and above 0.
        InputTypeError: If an argument is not a number.

    Example:
        >>> below, above = smoothing_error("always[0:9](x > 0)", 100, 0.5)
        >>> round(below, 4), above  # 0.5 * log(10), for the minimum of 10 numbers
        (1.1513, 0.0)
    """
    number = as_whole(samples)
    if number is None:
        raise InputTypeError(f"expected a whole number of samples, got {brief(samples)}")
    if number < 1:
        raise InputError(f"expected 1 sample or more, got {number}")
    scale = _checked(None, temperature)
    below, above = _error(program_of(spec, period, align, online=False), number)
    return scale * below, scale * above


def _error(program: Program, n: int) -> _Error:
    program = program.clamped(n)
    errors: list[_Error] = [(0.0, 0.0)] * program.terms
    for instruction in program.instructions[program.terms :]:
        match instruction:
            case Map("min", (a, b)):
                errors.append(_lesser(errors[a], errors[b]))
            case Map("max", (a, b)):
                errors.append(_greater(errors[a], errors[b]))
            case Map("neg", (a,)):
                errors.append((errors[a][1], errors[a][0]))
            case Window(name, lo, hi, args):
                width = (n if hi is None else hi) - (-n if lo is None else lo) + 1
                combine = FOLDS[name].made(_lesser, _greater)
                errors.append(_window_error(combine, tuple(errors[a] for a in args), width)[-1])
            case Load() | Const() | Map():
                msg = "an input or another function after the terms"
                raise AssertionError(msg)
    return errors[program.result]


def _window_error(
    combine: Callable[[tuple[_Error, ...], tuple[_Error, ...]], tuple[_Error, ...]],
    element: tuple[_Error, ...],
    width: int,
) -> tuple[_Error, ...]:
    """Return the error of a fold of ``width`` elements, combined as in `functions.slide`."""
    power, size = element, 1
    result: tuple[_Error, ...] | None = None
    while True:
        if width & size:
            result = power if result is None else combine(result, power)
        size *= 2
        if size > width:
            return result or element
        power = combine(power, power)


def _lesser(x: _Error, y: _Error) -> _Error:
    return _log_add_exp(x[0], y[0]), max(x[1], y[1])


def _greater(x: _Error, y: _Error) -> _Error:
    return max(x[0], y[0]), _log_add_exp(x[1], y[1])


def _log_add_exp(x: float, y: float) -> float:
    return max(x, y) + math.log1p(math.exp(-abs(x - y)))
