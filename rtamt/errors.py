"""Errors of the toolkit: what was expected, what came, where, and how to correct it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = [
    "InputError",
    "InputTypeError",
    "ParseError",
    "RtamtError",
    "SpecificationError",
    "StateError",
    "alternatives",
    "brief",
    "is_one_of",
    "name_text",
    "nearest",
]


class RtamtError(Exception):
    """Base class of every error that a user of the toolkit can cause."""


class SpecificationError(RtamtError, ValueError):
    """A specification that has no meaning, or that a monitor cannot run.

    Examples are a bound that is no multiple of the period, and a future without end in `Monitor`.
    """


class ParseError(SpecificationError):
    """Text that is not a specification.

    The message reads ``STL:LINE:COLUMN: what is wrong``, then the line, a caret, and a hint.

    Attributes:
        reason: The message without its place.
        line: Line in the text, from 1.
        column: Column in the line, from 1.
        text: The whole text.
        hint: How to correct the text, or an empty string.
    """

    def __init__(self, reason: str, text: str, line: int, column: int, hint: str = "") -> None:
        source = text.split("\n")[line - 1].rstrip("\r")
        # Tabs stay tabs, so that the caret stands below its column; of a long line only the part
        # around the caret is shown.
        start = max(0, column - 1 - _CONTEXT)
        shown = source[start : column - 1 + _CONTEXT]
        indent = "".join("\t" if c == "\t" else " " for c in source[start : column - 1])
        parts = [f"STL:{line}:{column}: {reason}", f"  {shown}", f"  {indent}^"]
        if hint:
            parts.append(f"  hint: {hint}")
        super().__init__("\n".join(parts))
        self.reason = reason
        self.text = text
        self.line = line
        self.column = column
        self.hint = hint

    def __reduce__(self) -> tuple[type[ParseError], tuple[str, str, int, int, str]]:
        return type(self), (self.reason, self.text, self.line, self.column, self.hint)


_CONTEXT = 60


class InputError(RtamtError, ValueError):
    """Signals that a monitor cannot take: nan, a missing or unknown variable, a wrong shape."""


class InputTypeError(RtamtError, TypeError):
    """Signals of a type that is not a real number: text, complex, object."""


class StateError(RtamtError, RuntimeError):
    """A call that the object's state does not allow, such as ``update`` after ``finish``."""


def alternatives(names: Iterable[str]) -> str:
    """The names that may be given: ``'a', 'b' or 'c'``."""
    *others, last = map(repr, names)
    return f"{', '.join(others)} or {last}"


def is_one_of(value: object, names: Iterable[str]) -> bool:
    """Whether a value is one of the names; an array or a list, which ``in`` cannot take, is not."""
    return isinstance(value, str) and value in names


def brief(value: object, most: int = 60) -> str:
    """What was given, for an error: its repr in one line, cut to a length; its type if it has none.

    An integer of 5,000 digits has no repr, and an object of the caller's may raise anything in its
    own.
    """
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - whatever the repr of an object raises
        return f"<{type(value).__name__}>"
    return text if len(text) <= most else f"{text[: most - 3]}..."


def name_text(name: object) -> str:
    """The text of a name, which may be anything that a mapping takes: a column may be a number."""
    return name if isinstance(name, str) else brief(name)


def nearest(name: str, names: Iterable[object]) -> str:
    """A hint with the most similar name, or an empty string."""
    if len(name) > _CONTEXT:  # the search takes the square of the length
        return ""
    # Names of columns may be numbers, or anything else that a mapping takes.
    known = [n for n in names if isinstance(n, str) and len(n) <= _CONTEXT]
    close = difflib.get_close_matches(name, known, 1)
    return f"; did you mean '{close[0]}'?" if close else ""
