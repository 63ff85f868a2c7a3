"""Frozen trees in which equal parts are the same object.

``==`` is identity, hashing is free, and a sub-formula that occurs twice is compiled to one
register.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from typing import Self, TypeVar, cast

from rtamt.errors import SpecificationError
from rtamt.language.interval import Interval
from rtamt.language.table import Operator

__all__ = [
    "MAX_DEPTH",
    "MAX_NAME",
    "MAX_OPERANDS",
    "MAX_PARTS",
    "MAX_SIZE",
    "Node",
    "interned",
    "too_deep",
    "too_long",
]

MAX_DEPTH = 200
"""Nodes on the longest path of a formula; also the most brackets that may stand inside another."""

MAX_SIZE = 1_000_000
"""Nodes of a formula written out; a name used twice counts twice."""


MAX_OPERANDS = 250_000
"""The most operands of a text's operators together; ``a and (b and c)`` has two and three."""

MAX_PARTS = 32
"""The most parts of a dotted name: the message, its fields, their fields."""

MAX_NAME = 255
"""The most characters of a name."""


def too_long(name: str) -> str:
    """The reason to refuse a name for its length or its parts; nothing if it has none."""
    parts = name.count(".") + name.count("[") + 1
    if parts > MAX_PARTS:
        return f"a dotted name has {parts} parts; the limit is {MAX_PARTS}"
    if len(name) > MAX_NAME:
        return f"a name has {len(name)} characters; the limit is {MAX_NAME}"
    return ""


def too_deep(what: str, depth: int) -> str:
    """The reason to refuse a formula or brackets."""
    return f"{what} nested {depth} deep; the limit is {MAX_DEPTH}"


class Node:
    """A term or a formula. Made by `make`, `variable` and `number`, never directly.

    Attributes:
        op: Row of the operator, or None for a variable or a number.
        args: Operands.
        interval: Interval of a temporal operator; None where it has none, or ``[0, inf)``.
        leaf: Name of a variable or value of a number.
        depth: Nodes on the longest path.
        size: Nodes of the tree written out.
    """

    __slots__ = ("__weakref__", "args", "depth", "interval", "leaf", "op", "size")

    op: Operator | None
    args: tuple[Node, ...]
    interval: Interval | None
    leaf: str | float | None
    depth: int
    size: int

    def __setattr__(self, name: str, value: object) -> None:
        msg = f"{type(self).__name__} is frozen: make a new one instead of setting {name}"
        raise AttributeError(msg)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self}>"

    def nodes(self) -> Iterator[Node]:
        """Every different node below and with this one, operands before what uses them."""
        seen: set[Node] = set()
        stack: list[tuple[Node, bool]] = [(self, False)]
        while stack:
            node, done = stack.pop()
            if done:
                yield node
            elif node not in seen:
                seen.add(node)
                stack.append((node, True))
                stack.extend((child, False) for child in reversed(node.args))

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables, in order of first appearance."""
        return tuple(n.leaf for n in self.nodes() if n.op is None and isinstance(n.leaf, str))


_N = TypeVar("_N", bound=Node)
_nodes: weakref.WeakValueDictionary[tuple[object, ...], Node] = weakref.WeakValueDictionary()
_lock = threading.Lock()


def interned(
    kind: type[_N],
    op: Operator | None,
    args: tuple[Node, ...] = (),
    interval: Interval | None = None,
    leaf: str | float | None = None,
) -> _N:
    """The one node of a class with these attributes.

    Raises:
        SpecificationError: If it is nested deeper than `MAX_DEPTH` or larger than `MAX_SIZE`.
    """
    # repr tells 0.0 from -0.0, which compare equal but divide differently.
    key = (kind, op, args, interval, leaf, repr(leaf))
    with _lock:
        node = _nodes.get(key)
        if node is None:
            depth = 1 + max((a.depth for a in args), default=0)
            size = 1 + sum(a.size for a in args)
            if depth > MAX_DEPTH:
                raise SpecificationError(too_deep("the formula is", depth))
            if size > MAX_SIZE:
                msg = f"the formula has {size} nodes written out; the limit is {MAX_SIZE}"
                raise SpecificationError(msg)
            node = object.__new__(kind)
            values = (op, args, interval, leaf, depth, size)
            for name, value in zip(_FIELDS, values, strict=True):
                object.__setattr__(node, name, value)
            _nodes[key] = node
        return cast("_N", node)


_FIELDS = ("op", "args", "interval", "leaf", "depth", "size")
