"""Names that nobody declared: a variable keeps its last value, so a mistyped one would stay 0."""

from __future__ import annotations

from collections.abc import Collection

from rtamt.errors import nearest
from rtamt.language.specification import Specification

__all__ = ["check_declared"]


def check_declared(parsed: Specification, declared: Collection[str]) -> None:
    """Refuse a specification with a variable that neither it nor a call declares.

    Args:
        parsed: The specification.
        declared: The names that calls declared; one of a message stands for its fields.

    Raises:
        ParseError: At the first place of such a variable.
    """
    unknown = {}
    for node in parsed.nodes():
        name = node.leaf
        if node.op is not None or not isinstance(name, str) or parsed.declaration(name):
            continue
        if name not in declared and _head(name) not in declared:
            unknown[name] = node
    if not unknown:
        return
    name = min(unknown, key=lambda each: parsed.positions[unknown[each]])
    known = {*declared, *parsed.declarations, *parsed.formulas, *parsed.constants}
    near = nearest(name, sorted(known)).removeprefix("; ")
    hint = f"{near} declare_var('{_head(name)}', 'float') declares it".lstrip()
    raise parsed.error(unknown[name], f"'{name}' is not declared", hint)


def _head(name: str) -> str:
    return name.partition(".")[0]
