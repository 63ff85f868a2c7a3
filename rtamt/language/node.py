"""Frozen trees that share equal parts, and their text.

``==`` is identity, hashing is free, and a sub-formula that occurs twice is compiled to one
register. The text has the fewest brackets that the parser needs.
"""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Self, TypeVar, cast

from rtamt.errors import SpecificationError
from rtamt.language.interval import Interval, number_text
from rtamt.language.operators import OPERATORS, Operator

MAX_DEPTH = 200
"""Nodes on the longest path of a formula; also the most nested brackets."""

MAX_SIZE = 1_000_000
"""Nodes of a formula written out; a name used twice counts twice."""

MAX_OPERANDS = 250_000
"""The most operands of all operators of a text; ``a and (b and c)`` has two and three."""

MAX_PARTS = 32
"""The most parts of a dotted name: the message, its fields, their fields."""

MAX_NAME = 255
"""The most characters of a name."""


def too_long(name: str) -> str:
    """Return the reason to refuse a name that is too long; empty if its length is accepted."""
    parts = name.count(".") + name.count("[") + 1
    if parts > MAX_PARTS:
        return f"a dotted name has {parts} parts; the limit is {MAX_PARTS}"
    if len(name) > MAX_NAME:
        return f"a name has {len(name)} characters; the limit is {MAX_NAME}"
    return ""


def too_deep(subject: str, depth: int) -> str:
    """Return the reason to refuse a formula or brackets that are nested too deep."""
    return f"{subject} nested {depth} deep; the limit is {MAX_DEPTH}"


class Node:
    """A term or a formula; `make`, `variable` and `number` return nodes.

    Attributes:
        op: Row of the operator; None for a variable or a number.
        args: Operands.
        interval: Interval of a temporal operator; None without one, or for ``[0, inf)``.
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

    def __str__(self) -> str:
        return node_text(self)

    def nodes(self) -> Iterator[Node]:
        """Yield every different node of the tree once, operands before their operator."""
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
_FIELDS = ("op", "args", "interval", "leaf", "depth", "size")
_nodes: weakref.WeakValueDictionary[tuple[object, ...], Node] = weakref.WeakValueDictionary()
_lock = threading.Lock()


def interned(
    kind: type[_N],
    op: Operator | None,
    args: tuple[Node, ...] = (),
    interval: Interval | None = None,
    leaf: str | float | None = None,
) -> _N:
    """Return the only node of a class with these attributes, within the limits of a tree."""
    # repr distinguishes 0.0 from -0.0, which compare equal but divide differently.
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


_NO_NAMES: Mapping[Node, str] = {}


def node_text(
    root: Node, names: Mapping[Node, str] = _NO_NAMES, runs: Collection[Node] = ()
) -> str:
    """Return the text of a term or formula, with names in place of some formulas.

    Runs show even if their operands have become operands of the same operator: ``p and z > 0`` is
    one conjunction with the operands of ``p``.
    """
    # Operands before their operator: no recursion, and a shared part is written once.
    texts = dict(names)
    for node in root.nodes():
        if node not in texts:
            texts[node] = _compose(node, texts, names, runs)
    return texts[root]


def _compose(
    node: Node, texts: Mapping[Node, str], names: Mapping[Node, str], runs: Collection[Node]
) -> str:
    op = node.op
    if op is None:
        return node.leaf if isinstance(node.leaf, str) else number_text(cast("float", node.leaf))
    args = _with_runs(node, runs) if runs else node.args
    operands = [texts[a] for a in args]
    rows = [None if a in names else _row(a) for a in args]
    interval = "" if node.interval is None else str(node.interval)
    match op.notation:
        case "atom":
            return operands[0] if operands else op.symbol
        case "call":
            return f"{op.symbol}({', '.join(operands)})"
        case "prefix":
            return _prefix(op, interval, operands[0], rows[0])
        case "infix":
            # A left operand with the same operator needs brackets only if the row does not group.
            strengths = [op.precedence + (op.grouping == "none")]
            strengths += [op.precedence + 1] * (len(operands) - 1)
            parts = [
                text if (math.inf if row is None else row.precedence) >= strength else f"({text})"
                for text, row, strength in zip(operands, rows, strengths, strict=True)
            ]
            return f" {op.symbol}{interval} ".join(parts)


def _with_runs(node: Node, runs: Collection[Node]) -> Sequence[Node]:
    """Return the operands, with a run in place of the operands that came from it."""
    op, args = cast("Operator", node.op), node.args
    if op.grouping not in ("flat", "left-flat"):
        return args
    starts: dict[Node, list[Node]] = {}
    for run in runs:
        if run.op is op and run is not node:
            starts.setdefault(run.args[0], []).append(run)
    operands: list[Node] = []
    index = 0
    while index < len(args):
        fits = [
            r for r in starts.get(args[index], ()) if args[index : index + len(r.args)] == r.args
        ]
        if fits and (op.grouping == "flat" or index == 0):
            operands.append(max(fits, key=lambda r: len(r.args)))
            index += len(operands[-1].args)
        else:
            operands.append(args[index])
            index += 1
    return operands


def _prefix(op: Operator, interval: str, operand: str, row: Operator | None) -> str:
    if op.symbol == "-":
        tight = (row is None or row.notation == "call") and operand[0] != "-"
        return f"-{operand}" if tight else f"-({operand})"
    if row is not None and row.notation != "infix" and operand[0] != "-":
        return f"{op.symbol}{interval} {operand}"
    space = " " if op.symbol == "not" else ""
    return f"{op.symbol}{interval}{space}({operand})"


def _row(node: Node) -> Operator | None:
    """Return the operator that starts or joins the text of a node."""
    return node.args[0].op if node.op is OPERATORS["value"] else node.op
