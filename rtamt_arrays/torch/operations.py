"""The operations and inputs of torch."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch.autograd import forward_ad
from torch.autograd.forward_ad import unpack_dual

from rtamt.errors import InputError, InputTypeError, brief, nearest
from rtamt_arrays.inputs import raise_error
from rtamt_arrays.operations import Tensor


class TorchOperations:
    """`rtamt_arrays.operations.Operations` of torch; a scatter may write ``in_place``."""

    count: object = torch.int32
    row: object = torch.int64
    truth: object = torch.bool

    def __init__(self, device: object, *, in_place: bool = False) -> None:
        self._device = device
        self._in_place = in_place

    def full(self, shape: tuple[int, ...], value: float, dtype: object) -> Tensor:
        return torch.full(shape, value, dtype=dtype, device=self._device)

    def constant(self, values: Sequence[float], dtype: object) -> Tensor:
        return torch.tensor(values, dtype=dtype, device=self._device)

    def arange(self, begin: int, end: int) -> Tensor:
        return torch.arange(begin, end, dtype=torch.int32, device=self._device)

    where = staticmethod(torch.where)
    isnan = staticmethod(torch.isnan)
    abs = staticmethod(torch.abs)
    sqrt = staticmethod(torch.sqrt)
    exp = staticmethod(torch.exp)
    ln = staticmethod(torch.log)
    isinf = staticmethod(torch.isinf)
    logaddexp = staticmethod(torch.logaddexp)
    pow = staticmethod(torch.pow)
    broadcast = staticmethod(torch.broadcast_to)
    concatenate = staticmethod(torch.cat)
    stack = staticmethod(torch.stack)

    def signbit(self, x: Tensor) -> Tensor:
        return _bits(x) < 0  # compilers vectorize this

    def neg(self, x: Tensor) -> Tensor:
        return -x

    def lesser(self, x: Tensor, y: Tensor) -> Tensor:
        if differentiated(x, y):
            return torch.where(_first(x, y), x, y)
        # torch.minimum may return either of two equal numbers. These differ only for zeros, in the
        # sign bit.
        return (_bits(torch.minimum(x, y)) | _bits(torch.minimum(y, x))).view(x.dtype)

    def greater(self, x: Tensor, y: Tensor) -> Tensor:
        if differentiated(x, y):
            return torch.where(_first(x, y), y, x)
        return (_bits(torch.maximum(x, y)) & _bits(torch.maximum(y, x))).view(x.dtype)

    def as_integers(self, x: Tensor) -> Tensor:
        return x.to(torch.int32)

    def least(self, x: Tensor, limit: int) -> Tensor:
        return x.clamp(max=limit)

    def as_kind_of(self, x: Tensor, like: Tensor) -> Tensor:
        return x.to(like.dtype)

    def gather(self, table: Tensor, rows: Tensor) -> Tensor:
        return table.index_select(0, rows)

    def scatter(self, table: Tensor, rows: Tensor, values: Tensor) -> Tensor:
        if self._in_place:
            return table.index_copy_(0, rows, values)
        return table.index_copy(0, rows, values)


BITS = {2: torch.int16, 4: torch.int32, 8: torch.int64}


def _bits(x: Tensor) -> Tensor:
    """Return the bits of floats as integers, which are negative where the sign bit is set."""
    return x.view(BITS[x.dtype.itemsize])


def _first(x: Tensor, y: Tensor) -> Tensor:
    """Return whether x is the minimum, with operations that have a gradient."""
    return (x < y) | ((x == y) & (_bits(x) < 0))


def differentiated(*operands: Tensor) -> bool:
    """Return whether an operand has a gradient or a tangent, which bits do not have."""
    if torch.is_grad_enabled() and any(x.requires_grad for x in operands):
        return True
    if torch.compiler.is_compiling():  # tensors have no tangent here
        return bool(_tangents_exist_now())
    return any(unpack_dual(x).tangent is not None for x in operands)


def _tangents_exist() -> bool:
    return bool(forward_ad._current_level >= 0)  # noqa: SLF001 - there is no public name


# torch.compile calls both while it builds a graph, and uses the results as constants.
_tangents_exist_now = torch.compiler.assume_constant_result(_tangents_exist)
_nearest = torch.compiler.assume_constant_result(nearest)


class TorchReader:
    """`rtamt_arrays.inputs.ArrayReader` for tensors of one device."""

    kind = "tensors"
    module = "torch"

    def __init__(self, dtype: object, device: object) -> None:
        self.dtype = torch.get_default_dtype() if dtype is None else dtype
        if not (isinstance(self.dtype, torch.dtype) and self.dtype.is_floating_point):
            got = self.describe(self.dtype)
            text = f"expected a dtype of floats, such as torch.float32, got {got}"
            raise_error(self, InputTypeError, text)
        info = torch.finfo(self.dtype)
        self.limits = info.tiny, info.max
        try:
            self.device = torch.empty(0, device=device).device
        except (RuntimeError, TypeError, AssertionError) as e:
            raise InputError(f"expected a device of torch, got {brief(device)}: {e}") from e

    def as_array(self, value: object) -> Tensor | None:
        if not isinstance(value, torch.Tensor) or value.dtype.is_complex:
            return None
        self._check_device(value)
        return value.to(self.dtype)

    def is_array(self, value: object) -> bool:
        return isinstance(value, torch.Tensor)

    def holds(self, value: object, dtype: object) -> bool:
        if not isinstance(value, torch.Tensor) or value.dtype != dtype:
            return False
        self._check_device(value)
        return True

    def mask(self, mask: object, like: Tensor) -> Tensor | None:
        if mask is None:
            return torch.ones_like(like, dtype=torch.bool)
        return mask if self.holds(mask, torch.bool) else None

    def describe(self, value: object) -> str:
        if torch.compiler.is_compiling() and not isinstance(value, str | int | float | None):
            return type(value).__name__
        return brief(value)

    def nearest(self, name: str, names: Sequence[str]) -> str:
        return str(_nearest(name, names))

    def announce(self, text: str) -> None:
        if torch.compiler.is_compiling():  # which shows only the texts of graph breaks
            torch._dynamo.graph_break(msg=text)  # noqa: SLF001 - torch documents it

    def _check_device(self, tensor: Tensor) -> None:
        if tensor.device != self.device:
            text = (
                f"expected tensors on {self.device}, got one on {tensor.device}; "
                "pass device= of the samples to the monitor, or move the samples"
            )
            raise_error(self, InputError, text)
