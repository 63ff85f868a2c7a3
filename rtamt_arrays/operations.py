"""The functions in which array libraries differ, in addition to the operators of their arrays.

To add an array library, add a package next to ``jax`` and ``torch`` with a class that has these
methods, and a group ``tests/arrays/NAME.txt``. ``tests/support/array_contract.py`` tests every
library, and ``array_requirements.py`` tests the wrappers of environments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

Tensor = Any
"""An array of JAX or a tensor of torch; type checks of this package need neither library."""


class Operations(Protocol):
    """The functions of an array library; time is the first axis.

    ``count``, ``row`` and ``truth`` are the dtypes of counts, of row numbers and of booleans.
    """

    count: object
    row: object
    truth: object

    def full(self, shape: tuple[int, ...], value: float, dtype: object) -> Tensor: ...

    def constant(self, values: Sequence[float], dtype: object) -> Tensor:
        """Return a constant vector of a monitor, on its device."""

    def arange(self, begin: int, end: int) -> Tensor: ...

    def where(self, condition: Tensor, x: Tensor | float, y: Tensor | float) -> Tensor: ...

    def signbit(self, x: Tensor) -> Tensor: ...

    def neg(self, x: Tensor) -> Tensor: ...

    def lesser(self, x: Tensor, y: Tensor) -> Tensor:
        """Return the minimum, with -0.0 below 0.0; at a tie, one operand gets the gradient."""

    def greater(self, x: Tensor, y: Tensor) -> Tensor:
        """Return the maximum, with -0.0 below 0.0; at a tie, one operand gets the gradient."""

    def isnan(self, x: Tensor) -> Tensor: ...

    def abs(self, x: Tensor) -> Tensor: ...

    def sqrt(self, x: Tensor) -> Tensor: ...

    def exp(self, x: Tensor) -> Tensor: ...

    def ln(self, x: Tensor) -> Tensor: ...

    def isinf(self, x: Tensor) -> Tensor: ...

    def logaddexp(self, x: Tensor, y: Tensor) -> Tensor: ...

    def pow(self, x: Tensor, y: Tensor) -> Tensor: ...

    def as_integers(self, x: Tensor) -> Tensor:
        """Return booleans as counts."""

    def least(self, x: Tensor, limit: int) -> Tensor:
        """Return the minimum of integers and a number."""

    def as_kind_of(self, x: Tensor, like: Tensor) -> Tensor:
        """Return numbers with the dtype of another array."""

    def concatenate(self, arrays: Sequence[Tensor]) -> Tensor: ...

    def stack(self, arrays: Sequence[Tensor]) -> Tensor: ...

    def broadcast(self, x: Tensor, shape: tuple[int, ...]) -> Tensor: ...

    def gather(self, table: Tensor, rows: Tensor) -> Tensor:
        """Return rows of a table in one operation."""

    def scatter(self, table: Tensor, rows: Tensor, values: Tensor) -> Tensor:
        """Return the table with other values in distinct rows; in place where possible."""
