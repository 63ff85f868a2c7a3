"""Names that nobody declared: a variable keeps its last value, so a mistyped one would stay 0."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable

from rtamt.errors import nearest
from rtamt.language.names import steps
from rtamt.language.specification import Specification

__all__ = ["check_declared", "warn_of_unknown"]

_log = logging.getLogger(__name__)


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


def warn_of_unknown(names: Iterable[object], unread: Collection[str]) -> None:
    """Log the names of ignored data that are like a variable for which no data came.

    Args:
        names: The names that the specification does not know.
        unread: The variables that keep the value they had.
    """
    for name in names:
        if isinstance(name, str) and (near := nearest(name, unread)):
            _log.warning("the data of '%s' is ignored: no variable has that name%s", name, near)


def _head(name: str) -> str:
    return str(steps(name)[0])
