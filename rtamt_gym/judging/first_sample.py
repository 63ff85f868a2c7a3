"""Errors about requirements that speak of the first sample only, as a whole or in one operand."""

from __future__ import annotations

import re
from typing import Final, cast

from rtamt import Formula, Specification, SpecificationError, parse
from rtamt_gym.tables import shorten

_UNARY: Final = {"always", "eventually", "next", "s_next"}
_BINARY: Final = {"and", "or", "implies", "iff", "xor"}
_ASSIGNMENT: Final = re.compile(r"(?:^|[\n;])\s*[\w.]+\s*=(?!=)")


def require_whole_episode(what: str, spec: Specification, way: object) -> None:
    """Raise SpecificationError if a requirement, or an operand of it, skips later samples.

    ``always p implies q`` is ``(always p) implies q``, where q is evaluated at the first sample
    only. Without brackets around p it can be read as ``always(p implies q)`` too.

    Args:
        what: Names the specification.
        spec: The specification.
        way: The argument that requires it at every sample, a text or an `Argument`.

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
        raise first_sample_error(what, spec, way)
    rest: list[Formula] = [spec.formula]
    while rest:
        node = rest.pop()
        if _name(node) in _BINARY:
            _refuse_loose_operand(spec, node)
        if _name(node) in {*_BINARY, "not"}:
            rest += cast("tuple[Formula, ...]", node.args)


def first_sample_error(what: str, spec: Specification, way: object) -> SpecificationError:
    """Return the error about a requirement that is about the first sample only.

    Args:
        what: Names the specification.
        spec: The specification.
        way: The argument that requires it at every sample, a text or an `Argument`.
    """
    way_out = f"write always({shorten(str(spec.formula), 60)}) or "
    if spec.requirement is not None and spec.id is not None:
        way_out = f"its id makes it a requirement by itself: remove the id, {way_out}"
    elif spec.requirement is not None:
        way_out = (
            "no other formula uses it, so that it is a requirement by itself: use it in another, "
            + way_out
        )
    return SpecificationError(f"{what} is about the first sample only; {way_out}", way)


def _refuse_loose_operand(spec: Specification, node: Formula) -> None:
    """Refuse an operand about the first sample after a temporal operator that seems to hold it."""
    args = cast("tuple[Formula, ...]", node.args)
    for index, left in enumerate(args[:-1]):
        later = args[index + 1 :]
        loose = [arg for arg in later if not _looks_ahead(arg)]
        temporal = _last(left)
        if (
            not loose
            or _name(temporal) not in _UNARY
            or not any(_near(spec, temporal, part) for part in (node, *loose))
        ):
            continue
        if _name(node) != "implies" and _bracketed(spec, temporal):
            continue
        word, interval = f" {_name(node)} ", temporal.interval or ""
        inner = word.join(f"({arg})" for arg in (temporal.args[0], *later))
        every = f"{_name(temporal)}{interval}({inner})"
        whole = word.join([*(f"({arg})" for arg in args[:index]), every])
        # eventually(p implies q) holds as soon as p fails once: nobody means it.
        if _name(node) == "implies" and (
            _name(temporal) != "always" or _enclosed(spec, temporal, node)
        ):
            whole = f"always({node})"
        whole = str(parse(whole, unit=spec.unit, constants=spec.constants).formula)
        raise spec.error(
            node,
            f"'{shorten(str(node), 60)}' reads {shorten(str(loose[0]), 40)} at the first sample "
            "only",
            f"write {shorten(whole, 60)}, or for the first sample "
            f"{shorten(_first(node, index), 60)}",
        )


def _first(node: Formula, index: int) -> str:
    """Return a text whose meaning is that of a formula, and which can be read in one way only."""
    args = cast("tuple[Formula, ...]", node.args)
    if _name(node) == "implies":
        return f"not ({args[0]}) or {args[1]}"
    loose = [str(arg) for arg in args[index + 1 :] if not _looks_ahead(arg)]
    others = [str(arg) for arg in args if str(arg) not in loose]
    word = f" {_name(node)} "
    return word.join([*(f"({text})" for text in loose), *others])


def _last(node: Formula) -> Formula:
    """Return the operand at the end of the text of a formula without brackets."""
    while _name(node) in _BINARY:
        node = cast("Formula", node.args[-1])
    return node


def _near(spec: Specification, temporal: Formula, node: Formula) -> bool:
    """Return whether a temporal operator is written before an operator, in the same statement."""
    places = [_offset(spec, part) for part in (temporal, node)]
    if None in places:
        return False
    start, end = cast("tuple[int, int]", tuple(places))
    return start < end and _ASSIGNMENT.search(spec.text[start:end]) is None


def _bracketed(spec: Specification, temporal: Formula) -> bool:
    """Return whether the operand of a temporal operator is written in brackets."""
    rest = spec.text[_offset(spec, temporal) :]
    rest = re.sub(r"^(?:\[[^\]]*\]|\w+)\s*", "", rest)
    if not rest.startswith("("):
        return False
    depth = 0
    for place, letter in enumerate(rest):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return re.match(r"\s*(?:[=!+*/>]|<(?!->)|-(?!>))", rest[place + 1 :]) is None
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
    """Return the place of an operator in the text; None if it was not written there."""
    if node not in spec.positions:
        return None
    line, column = spec.positions[node]
    return sum(len(text) + 1 for text in spec.text.split("\n")[: line - 1]) + column - 1


def _looks_ahead(node: Formula) -> bool:
    return any(part.op is not None and part.op.future for part in node.nodes())


def _name(node: Formula) -> str:
    return "" if node.op is None else node.op.name
