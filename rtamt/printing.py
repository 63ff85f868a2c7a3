"""Formulas as text, with the fewest brackets that the parser needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtamt.operators import OPERATORS, Operator

if TYPE_CHECKING:
    from rtamt.formula import Node

__all__ = ["node_text", "number_text"]


def number_text(value: float) -> str:
    """The shortest text that reads back as the number."""
    text = repr(value)
    return text.removesuffix(".0")


def node_text(node: Node, op: Operator) -> str:
    match op.notation:
        case "atom":
            return str(node.args[0]) if node.args else op.symbol
        case "call":
            return f"{op.symbol}({', '.join(str(a) for a in node.args)})"
        case "prefix":
            return _prefix_text(node, op)
        case "infix":
            symbol = op.symbol + ("" if node.interval is None else str(node.interval))
            first, *rest = node.args
            loose = op.grouping == "none"
            words = [_operand(first, op.precedence + loose)]
            words += [_operand(a, op.precedence + 1) for a in rest]
            return f" {symbol} ".join(words)


def _prefix_text(node: Node, op: Operator) -> str:
    operand = node.args[0]
    inner = operand.args[0] if operand.op is OPERATORS["value"] else operand
    interval = "" if node.interval is None else str(node.interval)
    text = str(operand)
    if op.symbol == "-":
        tight = inner.op is None or inner.op.notation == "call"
        return f"-{text}" if tight and not text.startswith("-") else f"-({text})"
    bare = (
        inner.op is not None and inner.op.notation in ("prefix", "atom", "call") and text[0] != "-"
    )
    if bare and op.symbol == "not":
        return f"not {text}"
    return f"{op.symbol}{interval} {text}" if bare else f"{op.symbol}{interval}{_space(op)}({text})"


def _space(op: Operator) -> str:
    return " " if op.symbol == "not" else ""


def _operand(node: Node, least: int) -> str:
    inner = node.args[0] if node.op is OPERATORS["value"] else node
    text = str(node)
    return f"({text})" if inner.op is not None and inner.op.precedence < least else text
