"""The operations and inputs of JAX."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from rtamt.errors import InputError, InputTypeError, brief, nearest
from rtamt_arrays.operations import Tensor


class JaxOperations:
    """`rtamt_arrays.operations.Operations` of JAX."""

    count: object = jnp.int32
    row: object = jnp.int32
    truth: object = jnp.bool_

    def full(self, shape: tuple[int, ...], value: float, dtype: object) -> Tensor:
        return jnp.full(shape, value, dtype)

    def constant(self, values: Sequence[float], dtype: object) -> Tensor:
        # An array that JAX creates during a trace belongs to that trace only.
        return np.asarray(values, jnp.dtype(dtype))

    def arange(self, begin: int, end: int) -> Tensor:
        return jnp.arange(begin, end, dtype=jnp.int32)

    where = staticmethod(jnp.where)
    signbit = staticmethod(jnp.signbit)
    isnan = staticmethod(jnp.isnan)
    sqrt = staticmethod(jnp.sqrt)
    exp = staticmethod(jnp.exp)
    ln = staticmethod(jnp.log)
    isinf = staticmethod(jnp.isinf)
    logaddexp = staticmethod(jnp.logaddexp)
    pow = staticmethod(jnp.power)
    broadcast = staticmethod(jnp.broadcast_to)
    least = staticmethod(jnp.minimum)
    concatenate = staticmethod(jnp.concatenate)
    stack = staticmethod(jnp.stack)

    def abs(self, x: Tensor) -> Tensor:
        # At 0 the gradient of jnp.abs is 1; in torch it is 0.
        return jnp.where(x == 0.0, 0.0, jnp.abs(x))

    def neg(self, x: Tensor) -> Tensor:
        return -x

    def lesser(self, x: Tensor, y: Tensor) -> Tensor:
        return jnp.where(_first(x, y), x, y)

    def greater(self, x: Tensor, y: Tensor) -> Tensor:
        return jnp.where(_first(x, y), y, x)

    def as_integers(self, x: Tensor) -> Tensor:
        return x.astype(jnp.int32)

    def as_kind_of(self, x: Tensor, like: Tensor) -> Tensor:
        return jnp.asarray(x, like.dtype)

    def gather(self, table: Tensor, rows: Tensor) -> Tensor:
        return jnp.asarray(table).at[rows].get(mode="promise_in_bounds", unique_indices=True)

    def scatter(self, table: Tensor, rows: Tensor, values: Tensor) -> Tensor:
        return (
            jnp.asarray(table).at[rows].set(values, mode="promise_in_bounds", unique_indices=True)
        )


def _first(x: Tensor, y: Tensor) -> Tensor:
    """Return whether x is the minimum; XLA's own minimum does not distinguish the zeros."""
    return (x < y) | ((x == y) & jnp.signbit(x))


class JaxReader:
    """`rtamt_arrays.inputs.ArrayReader` for arrays of JAX and of NumPy."""

    kind = "arrays"
    module = "jnp"

    def __init__(self, dtype: object) -> None:
        self.dtype = jnp.dtype(jnp.result_type(float) if dtype is None else dtype)
        if not jnp.issubdtype(self.dtype, jnp.floating):
            raise InputTypeError(f"expected a dtype of floats, got {self.dtype}")
        self._check_enabled()
        info = jnp.finfo(self.dtype)
        self.limits = float(info.tiny), float(info.max)

    def as_array(self, value: object) -> Tensor | None:
        self._check_enabled()
        if not (isinstance(value, jax.Array | np.ndarray | np.generic) and _is_real(value.dtype)):
            return None
        return jnp.asarray(value, self.dtype)

    def is_array(self, value: object) -> bool:
        return isinstance(value, jax.Array | np.ndarray | np.generic)

    def holds(self, value: object, dtype: object) -> bool:
        return self.is_array(value) and value.dtype == dtype  # type: ignore[attr-defined]

    def mask(self, mask: object, like: Tensor) -> Tensor | None:
        if mask is None:
            return jnp.ones_like(like, dtype=bool)
        return jnp.asarray(mask) if self.holds(mask, jnp.bool_) else None

    def describe(self, value: object) -> str:
        return brief(value)

    def nearest(self, name: str, names: Sequence[str]) -> str:
        return nearest(name, names)

    def announce(self, text: str) -> None:
        """Do nothing: JAX raises errors while it traces."""

    def _check_enabled(self) -> None:
        if jax.dtypes.canonicalize_dtype(self.dtype) != self.dtype:
            raise InputError(
                f"{self.dtype} is not enabled; call jax.config.update('jax_enable_x64', True) first"
            )


def _is_real(dtype: object) -> bool:
    return any(jnp.issubdtype(dtype, kind) for kind in (jnp.floating, jnp.integer, jnp.bool_))
