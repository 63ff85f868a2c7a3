"""What the walks over a program ask of an array library, beside the operators of its arrays.

To add an array library: a package next to ``jax`` and ``torch`` with a class that has these
methods, and a group ``tests/arrays/NAME.txt``. ``tests/support/array_contract.py`` tests every
library, ``array_requirements.py`` the wrappers of environments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

Tensor = Any
"""An array of JAX, or a tensor of torch: neither library's types are needed to check this one."""


class Operations(Protocol):
    """The functions in which array libraries differ. Time, if there is any, is the first axis.

    Attributes:
        count: The kind of integers that count.
        row: The kind of integers that name the rows of a table.
        truth: The kind of booleans.
    """

    count: object
    row: object
    truth: object

    def full(self, shape: tuple[int, ...], value: float, dtype: object) -> Tensor:
        """An array of one value."""

    def constant(self, values: Sequence[float], dtype: object) -> Tensor:
        """A vector of numbers, made where a monitor is made: it may have to reach a device."""

    def arange(self, begin: int, end: int) -> Tensor:
        """The integers from one on to below another, as counts."""

    def where(self, condition: Tensor, x: Tensor | float, y: Tensor | float) -> Tensor:
        """The values of x where the condition holds, and those of y elsewhere."""

    def signbit(self, x: Tensor) -> Tensor:
        """Whether the sign bit is set."""

    def neg(self, x: Tensor) -> Tensor:
        """The negative."""

    def lesser(self, x: Tensor, y: Tensor) -> Tensor:
        """The lesser number, -0.0 below 0.0; at a tie one of them gets the gradient."""

    def greater(self, x: Tensor, y: Tensor) -> Tensor:
        """The greater number, -0.0 below 0.0; at a tie one of them gets the gradient."""

    def isnan(self, x: Tensor) -> Tensor:
        """Whether a value is nan."""

    def abs(self, x: Tensor) -> Tensor:
        """The absolute value."""

    def sqrt(self, x: Tensor) -> Tensor:
        """The square root; nan below 0."""

    def exp(self, x: Tensor) -> Tensor:
        """The exponential."""

    def ln(self, x: Tensor) -> Tensor:
        """The natural logarithm; nan below 0."""

    def isinf(self, x: Tensor) -> Tensor:
        """Whether a value is infinite."""

    def logaddexp(self, x: Tensor, y: Tensor) -> Tensor:
        """ln(exp(x) + exp(y)) of finite numbers."""

    def pow(self, x: Tensor, y: Tensor) -> Tensor:
        """The power."""

    def as_integers(self, x: Tensor) -> Tensor:
        """Booleans as counts."""

    def least(self, x: Tensor, most: int) -> Tensor:
        """The lesser of integers and a number."""

    def as_kind_of(self, x: Tensor, like: Tensor) -> Tensor:
        """Numbers as those of the kind of others."""

    def concatenate(self, arrays: Sequence[Tensor]) -> Tensor:
        """Arrays one after the other along the first axis."""

    def stack(self, arrays: Sequence[Tensor]) -> Tensor:
        """Arrays as rows of a new first axis."""

    def broadcast(self, x: Tensor, shape: tuple[int, ...]) -> Tensor:
        """The array repeated to a shape."""

    def gather(self, table: Tensor, rows: Tensor) -> Tensor:
        """Rows of a table, all at once."""

    def scatter(self, table: Tensor, rows: Tensor, values: Tensor) -> Tensor:
        """The table with other values in rows that differ, all at once; in place where it can."""
