"""Operators and operands of formulas, and errors about requirements on the first sample only."""

from __future__ import annotations

import re
from typing import Any, Final, cast

from rtamt import Formula, Specification, SpecificationError, parse
from rtamt_gym.tables import shorten

_UNARY: Final = {"always", "eventually", "next", "s_next"}
_BINARY: Final = {"and", "or", "implies", "iff", "xor"}
_ASSIGNMENT: Final = re.compile(r"(?:^|[\n;])\s*[\w.]+\s*=(?!=)")


def operator_of(node: Any) -> str:  # noqa: ANN401 - a formula, or a term in one
    """Return the name of the outermost operator; empty for a variable or a number."""
    return "" if node.op is None else str(node.op.name)


def operands(node: Formula) -> tuple[Formula, ...]:
    """Return the operands of a logical or temporal operator, which are formulas."""
    return cast("tuple[Formula, ...]", node.args)


def looks_ahead(node: Formula) -> bool:
    """Return whether a formula has a future operator."""
    return any(part.op is not None and part.op.future for part in node.nodes())


def require_whole_episode(owner: str, spec: Specification, option: object) -> None:
    """Raise SpecificationError if a requirement or an operand is about the first sample only.

    ``always p implies q`` is ``(always p) implies q``, which evaluates q at the first sample only.
    Without brackets around p, a reader could also take it as ``always(p implies q)``. ``owner`` is
    the name of the specification, and ``option`` the argument that requires it at every sample.

    Example:
        >>> import rtamt
        >>> require_whole_episode("it", rtamt.parse("always(x > 0) and y > 0"), "")
        >>> try:
        ...     require_whole_episode("it", rtamt.parse("always x > 0 and y > 0"), "")
        ... except rtamt.ParseError as error:
        ...     print(error.hint)
        write always(x > 0 and y > 0), or for the first sample (y > 0) and always(x > 0)
    """
    if not spec.looks_ahead:
        raise first_sample_error(owner, spec, option)
    nodes: list[Formula] = [spec.formula]
    while nodes:
        node = nodes.pop()
        if operator_of(node) in _BINARY:
            _refuse_loose_operand(spec, node)
        if operator_of(node) in {*_BINARY, "not"}:
            nodes += operands(node)


def first_sample_error(owner: str, spec: Specification, option: object) -> SpecificationError:
    """Return the error for a requirement that is about the first sample only."""
    way_out = f"write always({shorten(str(spec.formula), 60)}) or "
    if spec.requirement is not None and spec.id is not None:
        way_out = f"its id makes it a requirement by itself: remove the id, {way_out}"
    elif spec.requirement is not None:
        way_out = (
            "no other formula uses it, so that it is a requirement by itself: use it in another, "
            + way_out
        )
    return SpecificationError(f"{owner} is about the first sample only; {way_out}", option)


def _refuse_loose_operand(spec: Specification, node: Formula) -> None:
    """Refuse an operand about the first sample after a temporal operator that seems to hold it."""
    args = operands(node)
    for index, left in enumerate(args[:-1]):
        later = args[index + 1 :]
        loose = [arg for arg in later if not looks_ahead(arg)]
        temporal = _last(left)
        if (
            not loose
            or operator_of(temporal) not in _UNARY
            or not any(_near(spec, temporal, part) for part in (node, *loose))
        ):
            continue
        if operator_of(node) != "implies" and _bracketed(spec, temporal):
            continue
        word, interval = f" {operator_of(node)} ", temporal.interval or ""
        inner = word.join(f"({arg})" for arg in (temporal.args[0], *later))
        every = f"{operator_of(temporal)}{interval}({inner})"
        suggestion = word.join([*(f"({arg})" for arg in args[:index]), every])
        # eventually(p implies q) holds as soon as p fails once, which nobody intends
        if operator_of(node) == "implies" and (
            operator_of(temporal) != "always" or _enclosed(spec, temporal, node)
        ):
            suggestion = f"always({node})"
        suggestion = str(parse(suggestion, unit=spec.unit, constants=spec.constants).formula)
        raise spec.error(
            node,
            f"'{shorten(str(node), 60)}' reads {shorten(str(loose[0]), 40)} at the first sample "
            "only",
            f"write {shorten(suggestion, 60)}, or for the first sample "
            f"{shorten(_first(node, index), 60)}",
        )


def _first(node: Formula, index: int) -> str:
    """Return an equivalent text of a formula that can be read in one way only."""
    args = operands(node)
    if operator_of(node) == "implies":
        return f"not ({args[0]}) or {args[1]}"
    loose = [str(arg) for arg in args[index + 1 :] if not looks_ahead(arg)]
    others = [str(arg) for arg in args if str(arg) not in loose]
    word = f" {operator_of(node)} "
    return word.join([*(f"({text})" for text in loose), *others])


def _last(node: Formula) -> Formula:
    """Return the operand at the end of the text of a formula without brackets."""
    while operator_of(node) in _BINARY:
        node = operands(node)[-1]
    return node


def _near(spec: Specification, temporal: Formula, node: Formula) -> bool:
    """Return whether the text has a temporal operator before an operator, in one statement."""
    places = [_offset(spec, part) for part in (temporal, node)]
    if None in places:
        return False
    start, end = cast("tuple[int, int]", tuple(places))
    return start < end and _ASSIGNMENT.search(spec.text[start:end]) is None


def _bracketed(spec: Specification, temporal: Formula) -> bool:
    """Return whether the operand of a temporal operator is written in brackets."""
    remainder = spec.text[_offset(spec, temporal) :]
    remainder = re.sub(r"^(?:\[[^\]]*\]|\w+)\s*", "", remainder)
    if not remainder.startswith("("):
        return False
    depth = 0
    for place, letter in enumerate(remainder):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return re.match(r"\s*(?:[=!+*/>]|<(?!->)|-(?!>))", remainder[place + 1 :]) is None
    return False


def _enclosed(spec: Specification, temporal: Formula, node: Formula) -> bool:
    """Return whether a temporal operator is written in brackets with its operand, as ``(G p)``."""
    start, end = _offset(spec, temporal), _offset(spec, node)
    if start is None or end is None:
        return False
    before = spec.text[:start].rstrip()
    if spec.text[start] == "[":  # the place of an operator with an interval
        before = re.sub(r"\w+$", "", before).rstrip()
    if not before.endswith("("):
        return False
    depth = 1
    for letter in spec.text[start:end]:
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return True
    return False


def _offset(spec: Specification, node: Formula) -> int | None:
    """Return the place of an operator in the text; None if the text does not have it."""
    if node not in spec.positions:
        return None
    line, column = spec.positions[node]
    return sum(len(text) + 1 for text in spec.text.split("\n")[: line - 1]) + column - 1
