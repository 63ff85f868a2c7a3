"""Errors of the toolkit: the expected and the actual value, the place, and the fix.

To add an error message:

- State the wrong value, the expected value and the fix. ``tests/rtamt/language/parse_errors.txt``
  lists the exact texts of the language, ``tests/rtamt/program/errors.txt`` the texts for periods,
  bounds, interfaces, exports, patterns and formulas, three in ``tests/rtamt/monitors`` those for
  arguments. Other tests assert the class and one key word, so that words can change.
- Pass an argument as a piece, ``InputError("give ", Argument("period"))``: a Python caller reads
  ``period=``, and a command shows its own option. Use `Advice` for a part that only helps callers
  who have the option. `rtamt_gym.commands.errors` lists the options with another name.
- Quote text from files, such as the name of a column, with `shown`. `Message` does so for all
  errors; readers, tables, JUnit, Markdown and pages call it for everything else that they print.
"""

from __future__ import annotations

import difflib
import heapq
import re
import unicodedata
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from errno import ENOENT
from os import PathLike, fspath
from typing import Self

__all__ = [
    "Advice",
    "Argument",
    "InputError",
    "InputTypeError",
    "Message",
    "MissingFileError",
    "ParseError",
    "RtamtError",
    "SpecificationError",
    "StateError",
    "alike",
    "alternatives",
    "brief",
    "closest",
    "hint_line",
    "is_one_of",
    "name_text",
    "near_name",
    "nearest",
    "no_such",
    "shown",
    "shown_lines",
]


@dataclass(frozen=True)
class Argument:
    """An argument in the text of an error.

    Its text is Python code, ``name=`` or ``name=value``, or its words.

    Attributes:
        name: The name of the argument in Python.
        value: The actual or the expected value; ``...`` without a value.
        words: Another text for Python callers, such as a function to call; empty: the code.

    Example:
        >>> print(Argument("period"), Argument("end", "cut"))
        period= end='cut'
    """

    name: str
    value: object = ...
    words: str = ""

    def __str__(self) -> str:
        return self.words or f"{self.name}={'' if self.value is ... else repr(self.value)}"


class Message(str):
    """The text of an error, with the arguments in it.

    It is the text for Python callers; `worded` returns the text for a program with other options.

    Args:
        pieces: Texts, arguments, messages and errors, in reading order. An error stands for its
            message.

    Example:
        >>> message = Message("variable 'x' is nan", Advice("; pass ", Argument("nan", "hold")))
        >>> print(message)
        variable 'x' is nan; pass nan='hold'
        >>> message.arguments
        ('nan',)
        >>> message.worded(lambda argument: f"--{argument.name} {argument.value}")
        "variable 'x' is nan; pass --nan hold"
        >>> message.worded(lambda argument: None)  # a program without such an option
        "variable 'x' is nan"
    """

    __slots__ = ("pieces",)

    pieces: tuple[object, ...]

    def __new__(cls, *pieces: object) -> Self:
        """Join the pieces."""
        result = tuple(
            piece.message if isinstance(piece, RtamtError) else _safe(piece) for piece in pieces
        )
        self = super().__new__(cls, "".join(map(str, result)))
        self.pieces = result
        return self

    @property
    def arguments(self) -> tuple[str, ...]:
        """The names of the arguments in the text, once each."""
        names: dict[str, None] = {}
        for piece in self.pieces:
            if isinstance(piece, Argument):
                names[piece.name] = None
            elif isinstance(piece, Message):
                names |= dict.fromkeys(piece.arguments)
        return tuple(names)

    def worded(self, option: Callable[[Argument], str | None]) -> str:
        """Return the text for a program with its own options.

        Args:
            option: Returns the option for an argument, or None without an option. The text omits
                an `Advice` with an argument that has no option.
        """
        texts = []
        for piece in self.pieces:
            if isinstance(piece, Argument):
                texts.append(option(piece) or str(piece))
            elif isinstance(piece, Message):
                texts.append(piece.worded(option))
            else:
                texts.append(str(piece))
        return "".join(texts)

    def __reduce__(self) -> tuple[type[Self], tuple[object, ...]]:
        return type(self), self.pieces


class Advice(Message):
    """A part of a message that only helps callers who can pass its arguments."""

    __slots__ = ()

    def worded(self, option: Callable[[Argument], str | None]) -> str:
        """Return the text; empty if an argument has no option."""
        arguments = (piece for piece in self.pieces if isinstance(piece, Argument))
        return super().worded(option) if all(map(option, arguments)) else ""


def hint_line(hint: str) -> Message:
    """Return the last line of an error; empty without a hint."""
    if isinstance(hint, Advice):
        return Advice("\n  hint: ", *hint.pieces)
    return Message("\n  hint: ", hint) if hint else Message()


class RtamtError(Exception):
    """Base class of every error that a user of the toolkit can cause.

    Args:
        pieces: The arguments of `Message`; usually one text.
    """

    def __init__(self, *pieces: object) -> None:
        plain = len(pieces) == 1 and isinstance(pieces[0], str)
        super().__init__(_safe(pieces[0]) if plain else Message(*pieces))

    @property
    def message(self) -> Message:
        """The text, with the arguments in it."""
        text = self.args[0]
        return text if isinstance(text, Message) else Message(text)

    @property
    def arguments(self) -> tuple[str, ...]:
        """The names of the arguments in the text, once each."""
        return self.message.arguments

    def at(self, place: str) -> RtamtError:
        """Return the same error with a place in front, such as ``trace 3``."""
        return type(self)(f"{place}: ", self)


class SpecificationError(RtamtError, ValueError):
    """A specification without a meaning, or that a monitor cannot run.

    Examples are a bound that is not a multiple of the period, and an unbounded future operator in
    `Monitor`.
    """


class ParseError(SpecificationError):
    """Text that is not a specification.

    The message is ``STL:LINE:COLUMN: REASON``, then the line, a caret, and a hint.

    Attributes:
        reason: The message without its place.
        line: Line in the text, from 1.
        column: Column in the line, from 1.
        text: The whole text.
        hint: How to correct the text, or an empty string.
        place: The part of the input with this text, such as ``trace 3``, or an empty string.
    """

    def __init__(
        self, reason: str, text: str, line: int, column: int, hint: str = "", place: str = ""
    ) -> None:
        source = text.split("\n")[line - 1].rstrip("\r")
        # Tabs stay tabs, so that the caret is below its column. A long line is cut around the
        # caret.
        start = max(0, column - 1 - _CONTEXT)
        context = shown_lines(source[start : column - 1 + _CONTEXT])
        before = shown_lines(source[start : column - 1])
        indent = "".join("\t" if c == "\t" else " " for c in before)
        parts = [f"STL:{line}:{column}: ", reason, f"\n  {context}\n  {indent}^"]
        super().__init__(f"{place}: " if place else "", *parts, hint_line(hint))
        self.place = place
        self.reason = reason
        self.text = text
        self.line = line
        self.column = column
        self.hint = hint

    def at(self, place: str) -> RtamtError:
        """Return the same error with a place in front, such as ``trace 3``."""
        return type(self)(self.reason, self.text, self.line, self.column, self.hint, place)

    def __reduce__(self) -> tuple[type[ParseError], tuple[str, str, int, int, str, str]]:
        return type(self), (
            *(self.reason, self.text, self.line, self.column, self.hint),
            self.place,
        )


_CONTEXT = 60


class InputError(RtamtError, ValueError):
    """Input that a monitor cannot read: nan, a missing or unknown variable, a wrong shape."""


class MissingFileError(InputError, FileNotFoundError):
    """A file of a specification that does not exist.

    Attributes:
        filename: The path, as the caller passed it.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        from pathlib import Path  # 5 ms of every import of the package

        absent = Path(path)
        # The common suffix would make all names similar.
        close = closest(absent.stem, sorted(other.stem for other in absent.parent.glob("*.stl")))
        near = f"; did you mean '{close}.stl'?" if close else ""
        super().__init__(f"cannot open {fspath(path)}: No such file or directory{near}")
        self.filename = fspath(path)
        self.errno, self.strerror = ENOENT, f"No such file or directory{near}"

    def __str__(self) -> str:
        return str(self.args[0])  # OSError would build its text from attributes

    def at(self, place: str) -> RtamtError:
        """Return the error with a place in front, without its file name."""
        return InputError(f"{place}: ", self)

    def __reduce__(self) -> tuple[type[MissingFileError], tuple[str]]:
        return type(self), (self.filename,)


class InputTypeError(RtamtError, TypeError):
    """Signals of a type that is not a real number: text, complex, object."""


class StateError(RtamtError, RuntimeError):
    """A call that the object's state does not allow, such as ``update`` after ``finish``."""


def alternatives(names: Iterable[str]) -> str:
    """Return names as a text: ``'a', 'b' or 'c'``."""
    *others, last = map(repr, names)
    return f"{', '.join(others)} or {last}"


def is_one_of(value: object, names: Iterable[str]) -> bool:
    """Return whether a value is among the names; arrays and lists are not."""
    return isinstance(value, str) and value in names


def brief(value: object, most: int = 60) -> str:
    """Return a value for an error: its repr in one line, cut to a length, or its type.

    An integer of 5,000 digits has no repr, and the repr of a caller's object may raise any error.
    """
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - whatever the repr of an object raises
        return f"<{type(value).__name__}>"
    return text if len(text) <= most else f"{text[: most - 3]}..."


def shown(text: str) -> str:
    r"""Return a foreign text that is safe to print, in one line.

    Python escapes replace control characters, direction marks, single surrogates and line ends.
    They also replace the first character of texts that CI systems read as commands in a log.

    Example:
        >>> print(shown("speed [km/h]"), shown("a\x1b[31mb\n::error::c"), shown("\udcff.csv"))
        speed [km/h] a\x1b[31mb\n::error::c \udcff.csv
        >>> print(shown("::error::c"))
        \x3a:error::c
    """
    if not text.isprintable():
        text = "".join(map(_escaped, text))
    return _COMMAND.sub(_escaped_begin, text) if "::" in text or "##" in text else text


def shown_lines(text: str) -> str:
    r"""Return a foreign text of several lines that is safe to print; line ends and tabs stay.

    Example:
        >>> print(shown_lines("expected text\n  got \x07"))
        expected text
          got \x07
    """
    if not text.isprintable():
        text = "".join(c if c in "\n\t" else _escaped(c) for c in text)
    return _COMMAND.sub(_escaped_begin, text) if "::" in text or "##" in text else text


_COMMAND = re.compile(r"(?<!\S)(?=::|##\[|##vso\[)(.)")
"""The start of a command for GitHub or Azure, at the start of a line or after a blank."""


def _escaped(character: str) -> str:
    hidden = unicodedata.category(character) in {"Cc", "Cf", "Cs", "Zl", "Zp"}
    return character.encode("unicode_escape").decode() if hidden else character


def _escaped_begin(match: re.Match[str]) -> str:
    return f"\\x{ord(match[0]):02x}"


def _safe(piece: object) -> object:
    """Return a piece of a message that is safe to print: it may quote a file or a caller."""
    return shown_lines(piece) if type(piece) is str else piece


def name_text(name: object) -> str:
    """Return the text of a name, which may be any key of a mapping: a column may be a number."""
    return name if isinstance(name, str) else brief(name)


def closest(name: str, names: Iterable[object], cutoff: float = 0.6) -> str | None:
    """Return the most similar name; None without a similar name, or for a long name.

    A name that differs only in upper and lower case is the most similar.

    Args:
        name: The name.
        names: The known names. Names of columns may be numbers or other keys of a mapping; only
            texts are compared.
        cutoff: The minimum similarity, from 0 to 1.
    """
    if len(name) > _CONTEXT:  # the time grows with the square of the length
        return None
    known = [n for n in names if isinstance(n, str) and len(n) <= _CONTEXT]
    folded = name.casefold()
    for other in known:
        if other.casefold() == folded:
            return other
    if len(known) > _MANY:  # a file may have hundreds of thousands of columns
        known = alike(name, known, _MANY)
    return next(iter(difflib.get_close_matches(name, known, 1, cutoff)), None)


_MANY = 1000
"""The maximum number of names to compare letter by letter."""


_ALIKE = 0.8
"""The minimum similarity of a name and its typo."""


def near_name(variable: str, names: Iterable[str]) -> str | None:
    """Return the name that equals a variable apart from case, blanks, a unit or a typo, or None.

    Example:
        >>> near_name("speed", ["time", "Speed [km/h]"]), near_name("limit", ["limti"])
        ('Speed [km/h]', 'limti')
        >>> near_name("x1", ["x2"]), near_name("limit", ["speed"])
        (None, None)
    """
    plain = {name: _plain(name) for name in names}
    wanted = _plain(variable)
    for name, other in plain.items():
        if other == wanted:
            return name
    near = closest(wanted, plain.values(), _ALIKE) if len(wanted) > 2 else None
    if near is None or re.sub(r"\d", "", near) == re.sub(r"\d", "", wanted):
        return None  # x1 and x2 are two signals
    return next(name for name, other in plain.items() if other == near)


def _plain(name: str) -> str:
    """Return a name without case, marks between words, and a unit in brackets."""
    return re.sub(r"\s*[\[(].*[\])]$|[\s_./-]", "", name).lower()


def alike(name: str, names: Iterable[str], count: int) -> list[str]:
    """Return the names that share most pairs of adjacent letters with a name, best first.

    Example:
        >>> alike("speed", ["time", "speed2", "spend", "Speed"], 3)
        ['Speed', 'speed2', 'spend']
    """
    wanted = _pairs(name)

    def unlike(other: str) -> float:
        pairs = _pairs(other)
        return -2 * len(wanted & pairs) / (len(wanted) + len(pairs))

    return heapq.nsmallest(count, names, unlike)


def _pairs(name: str) -> set[str]:
    text = f" {name.lower()} "
    return {text[i : i + 2] for i in range(len(text) - 1)}


def nearest(name: object, names: Iterable[object]) -> str:
    """Return a hint with the most similar name; empty without a similar name, or for other types.

    Example:
        >>> nearest("levle", ["level", "inflow", 3]), nearest("x", ["level"]), nearest(3, ["level"])
        ("; did you mean 'level'?", '', '')
    """
    close = closest(name, names) if isinstance(name, str) else None
    return f"; did you mean {close!r}?" if close else ""


def no_such(kind: str, name: str, names: Iterable[object]) -> str:
    """Return the text of an error for an unknown name.

    Args:
        kind: The word for the named objects, such as ``"column"``.
        name: The name.
        names: The known names. Names of columns may be anything that a mapping takes.

    Example:
        >>> no_such("column", "speed", ["Speed", "rpm"])
        "No column 'speed'. The columns are 'Speed', 'rpm'. Did you mean 'Speed'?"
    """
    known = [*names]
    if not known:
        return f"No {kind} '{name}'. There are no {kind}s."
    listed = ", ".join(f"'{name_text(other)}'" for other in known[:_LISTED])
    more = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    close = closest(name, known)
    meant = f" Did you mean '{close}'?" if close else ""
    return f"No {kind} '{name}'. The {kind}s are {listed}{more}.{meant}"


_LISTED = 20
"""The maximum number of names in an error."""
