"""Formulas as text, with the fewest brackets that the parser needs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import cast

from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.table import Operator

__all__ = ["node_text", "number_text"]

_NO_NAMES: Mapping[Node, str] = {}


def number_text(value: float) -> str:
    """The shortest text that reads back as the number."""
    text = repr(value)
    return text.removesuffix(".0")


def node_text(
    root: Node, names: Mapping[Node, str] = _NO_NAMES, runs: Collection[Node] = ()
) -> str:
    """The text of a term or formula; formulas inside that have a name are written as their name.

    Args:
        root: The term or formula.
        names: Names of formulas.
        runs: The named formulas to show even where their operands have become operands of the same
            operator: ``p and z > 0`` is one conjunction with the operands of ``p``.
    """
    # Operands before what uses them: no recursion, and a shared part is written once.
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
    args = _joined(node, runs) if runs else node.args
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
            # Only operators that group to the left take their like on the left without brackets.
            least = [op.precedence + (op.grouping == "none")]
            least += [op.precedence + 1] * (len(operands) - 1)
            parts = [
                text if _strength(row) >= strength else f"({text})"
                for text, row, strength in zip(operands, rows, least, strict=True)
            ]
            return f" {op.symbol}{interval} ".join(parts)


def _joined(node: Node, runs: Collection[Node]) -> Sequence[Node]:
    """The operands, of which those that came from one of the runs are it again."""
    op, args = cast("Operator", node.op), node.args
    if op.grouping not in ("flat", "left-flat"):
        return args
    begins: dict[Node, list[Node]] = {}
    for run in runs:
        if run.op is op and run is not node:
            begins.setdefault(run.args[0], []).append(run)
    joined: list[Node] = []
    at = 0
    while at < len(args):
        fits = [r for r in begins.get(args[at], ()) if args[at : at + len(r.args)] == r.args]
        if fits and (op.grouping == "flat" or at == 0):
            joined.append(max(fits, key=lambda r: len(r.args)))
            at += len(joined[-1].args)
        else:
            joined.append(args[at])
            at += 1
    return joined


def _prefix(op: Operator, interval: str, operand: str, row: Operator | None) -> str:
    if op.symbol == "-":
        tight = (row is None or row.notation == "call") and operand[0] != "-"
        return f"-{operand}" if tight else f"-({operand})"
    if row is not None and row.notation != "infix" and operand[0] != "-":
        return f"{op.symbol}{interval} {operand}"
    space = " " if op.symbol == "not" else ""
    return f"{op.symbol}{interval}{space}({operand})"


def _row(node: Node) -> Operator | None:
    """The operator that the text of a node begins or joins with."""
    return node.args[0].op if node.op is OPERATORS["value"] else node.op


def _strength(row: Operator | None) -> float:
    return math.inf if row is None else row.precedence
