"""The functions and folds of `rtamt.program.algebra` on arrays, by name.

Selects prevent simplifications of compilers: XLA drops x + 0.0, which turns -0.0 into 0.0, and its
minima may not distinguish the zeros. Products and divisors add a zero that compilers cannot
detect. It prevents fused sums, which round once instead of twice, and multiplication with the
inverse of a constant divisor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rtamt.program.algebra import FOLDS, Element
from rtamt_arrays.operations import Operations, Tensor

Elements = tuple[Tensor, ...]
"""The numbers of an element of a fold, as arrays."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """A minimum and a maximum, exact or smooth."""

    lesser: Callable[[Tensor, Tensor], Tensor]
    greater: Callable[[Tensor, Tensor], Tensor]


def exact(o: Operations) -> Lattice:
    """Return min and max with -0.0 below 0.0; at a tie, one operand gets the gradient."""
    return Lattice(o.lesser, o.greater)


@dataclass(frozen=True, slots=True)
class Fold:
    """A fold of `rtamt.program.algebra` on arrays; the left operand is older."""

    combine: Callable[[Elements, Elements], Elements]
    identity: Element

    @classmethod
    def named(cls, name: str, lattice: Lattice) -> Fold:
        """Return the fold with a name, with the minimum and maximum of a lattice."""
        row = FOLDS[name]
        return cls(row.made(lattice.lesser, lattice.greater), row.identity)

    def masked(self, o: Operations, inside: Tensor, elements: Elements) -> Elements:
        """Replace the elements outside the mask by the identity."""
        return tuple(o.where(inside, x, e) for x, e in zip(elements, self.identity, strict=True))


def slide(fold: Fold, elements: Elements, width: int) -> Elements:
    """Return the folds of all windows of ``width`` elements along the first axis.

    A window is combined from windows without overlap, whose lengths are powers of two.
    """
    count = elements[0].shape[0] - width + 1
    power, size, done = elements, 1, 0
    result: Elements | None = None
    while True:
        if width & size:
            part = tuple(a[done : done + count] for a in power)
            result = part if result is None else fold.combine(result, part)
            done += size
        if done == width:
            return result or elements
        power = fold.combine(tuple(a[:-size] for a in power), tuple(a[size:] for a in power))
        size *= 2


def prefixes(o: Operations, fold: Fold, elements: Elements) -> Elements:
    """Return the folds of the first element, of the first two, and so on, along the first axis."""
    size = 1
    while size < elements[0].shape[0]:
        longer = fold.combine(tuple(a[:-size] for a in elements), tuple(a[size:] for a in elements))
        elements = tuple(
            o.concatenate([a[:size], b]) for a, b in zip(elements, longer, strict=True)
        )
        size *= 2
    return elements


def suffixes(o: Operations, fold: Fold, elements: Elements) -> Elements:
    """Return the folds from the first element on, from the second on, and so on."""
    size = 1
    while size < elements[0].shape[0]:
        longer = fold.combine(tuple(a[:-size] for a in elements), tuple(a[size:] for a in elements))
        elements = tuple(
            o.concatenate([b, a[-size:]]) for a, b in zip(elements, longer, strict=True)
        )
        size *= 2
    return elements


def fold_all(o: Operations, fold: Fold, elements: Elements) -> Elements:
    """Fold all elements along the first axis, which it removes."""
    while (count := elements[0].shape[0]) > 1:
        even = count - count % 2
        pairs = fold.combine(
            tuple(a[0:even:2] for a in elements), tuple(a[1:even:2] for a in elements)
        )
        if even < count:
            pairs = tuple(o.concatenate([b, a[-1:]]) for a, b in zip(elements, pairs, strict=True))
        elements = pairs
    return tuple(a[0] for a in elements)


def _no_negative_zero(o: Operations, x: Tensor) -> Tensor:
    return x + o.where(x == 0.0, 0.0, _negative_zero(o, x))


def _rounded(o: Operations, x: Tensor) -> Tensor:
    return x + _negative_zero(o, x)


def _negative_zero(o: Operations, x: Tensor) -> Tensor:
    """Return -0.0, which a sum ignores; nan for nan."""
    return o.where(x == x, -0.0, x)  # noqa: PLR0124


def _holds(o: Operations, x: Tensor, y: Tensor, holds: Tensor) -> Tensor:
    value = o.where(holds, math.inf, o.full((), -math.inf, x.dtype))
    return o.where(o.isnan(x) | o.isnan(y), math.nan, value)


FUNCTIONS: Mapping[str, Callable[..., Tensor]] = {
    "neg": lambda o, x: o.neg(x),
    "abs": lambda o, x: o.abs(x),
    "sqrt": lambda o, x: o.sqrt(x),
    "exp": lambda o, x: o.exp(x),
    "ln": lambda o, x: o.ln(x),
    "add": lambda _, x, y: x + y,
    "sub": lambda _, x, y: x - y,
    "mul": lambda o, x, y: _rounded(o, x * y),
    "div": lambda o, x, y: x / (y + _negative_zero(o, x)),
    "pow": lambda o, x, y: o.pow(x, y),
    "log": lambda o, x, y: o.ln(x) / o.ln(y),
    "min": lambda o, x, y: exact(o).lesser(x, y),
    "max": lambda o, x, y: exact(o).greater(x, y),
    "at_least": lambda o, x, y: _no_negative_zero(o, x - y),
    "above": lambda o, x, y: -_no_negative_zero(o, y - x),
    "equal": lambda o, x, y: _no_negative_zero(o, -o.abs(x - y)),
    "unequal": lambda o, x, y: -_no_negative_zero(o, -o.abs(x - y)),
    "nonnegative": _no_negative_zero,
    "ge": lambda o, x, y: _holds(o, x, y, x >= y),
    "gt": lambda o, x, y: _holds(o, x, y, x > y),
    "eq": lambda o, x, y: _holds(o, x, y, x == y),
    "ne": lambda o, x, y: _holds(o, x, y, x != y),
}
"""`rtamt.program.algebra.FUNCTIONS` on arrays; the first argument is the operations."""
