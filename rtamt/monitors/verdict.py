"""Verdicts, and whether a formula holds by the sign bit of its robustness."""

from __future__ import annotations

import enum
import textwrap
from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.arrays import array_of_numbers, kind_of


class _Coloured:
    """A coloured name for notebooks; a base class, since Enum reserves names such as _name_."""

    __slots__ = ()

    name: str

    def _repr_html_(self) -> str:
        colour = {"VIOLATED": "#b3261e", "UNDECIDED": "#5f6368", "SATISFIED": "#1b6e3c"}[self.name]
        style = f"background:{colour};color:#fff;padding:0 .4em;border-radius:.3em"
        return f'<span style="{style}">{self.name}</span>'


class Verdict(_Coloured, enum.IntEnum):
    """The verdict on an episode, decided as soon as both bounds have the same sign bit."""

    VIOLATED = -1
    """No continuation can satisfy the specification: the upper bound is negative, or -0.0."""
    UNDECIDED = 0
    """The lower bound is negative, or -0.0, and the upper is not."""
    SATISFIED = 1
    """No continuation can violate the specification: the lower bound is positive, or +0.0."""


@overload
def holds(robustness: float) -> bool: ...
@overload
def holds(robustness: NDArray[Any] | Sequence[Any]) -> NDArray[np.bool_]: ...
def holds(robustness: object) -> object:
    """Return whether the formula holds, from its robustness; at 0 the sign bit decides.

    Robustness is positive where a formula holds and negative where it does not. At 0 both are
    possible: it is +0.0 where the formula holds (``x >= 3`` at 3) and -0.0 where it does not
    (``x > 3`` at 3). No comparison distinguishes the two.

    A file must keep the sign of 0: ``-0.0`` in a text keeps it, ``0`` in a column of integers does
    not. Under interface-aware semantics a predicate of no concern counts 0 and neither holds nor
    fails; use the bounds of an `EpisodeMonitor` there.

    Args:
        robustness: A number, or an array of any shape.

    Returns:
        A bool, or an array of booleans of the same shape.

    Raises:
        InputError: On nan, which is not a robustness.
        InputTypeError: On values that are not real numbers.

    Example:
        >>> from rtamt import evaluate
        >>> trace = {"x": [2, 3, 4]}
        >>> evaluate("x >= 3", trace).tolist(), holds(evaluate("x >= 3", trace)).tolist()
        ([-1.0, 0.0, 1.0], [False, True, True])
        >>> evaluate("x > 3", trace).tolist(), holds(evaluate("x > 3", trace)).tolist()
        ([-1.0, -0.0, 1.0], [False, False, True])
        >>> holds(0.0), holds(-0.0)
        (True, False)
    """
    values = array_of_numbers(robustness, "the robustness")
    if np.asarray(robustness).dtype.kind == "b":
        raise InputTypeError(f"expected a robustness, got {kind_of(robustness)}")
    missing = np.isnan(values)
    if missing.any():
        where = ""
        if values.ndim:
            index = np.argwhere(missing)[0].tolist()
            where = f" at index {index[0] if len(index) == 1 else tuple(index)}"
        raise InputError(
            f"nan{where} is not a robustness: a monitor returns nan while the value is unknown, "
            "for the first `latency` samples or before the first sample"
        )
    held = ~np.signbit(values)
    return held if values.ndim else bool(held)


def zero_text(*, held: bool) -> str:
    """Return the text of a robustness of 0, with the meaning of its sign."""
    return "0, holds" if held else "0, violated"


def rounded(value: float) -> str:
    """Return a number for a text, without -0: the verdict stands next to it."""
    return f"{value + 0.0:.6g}"


def wrapped(text: str, margin: str = "") -> list[str]:
    """Return the lines of a text of at most 80 columns, the first after a margin."""
    return textwrap.wrap(
        text,
        width=80,
        initial_indent=margin,
        subsequent_indent=" " * (len(margin) + 4),
        break_on_hyphens=False,
        max_lines=3,
        placeholder=" ...",
    )
