"""Numbers, times and tables as text for a terminal of 80 columns."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from shutil import get_terminal_size
from textwrap import wrap
from typing import Final, Self

from rtamt.errors import shown, shown_lines


def counted(count: int, what: str) -> str:
    """Return a count with its noun; the plural ends in s.

    Example:
        >>> counted(1, "trace"), counted(0, "trace")
        ('1 trace', '0 traces')
    """
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def number(value: float) -> str:
    """Return a number in at most six digits.

    Example:
        >>> number(2.0), number(-1 / 3), number(float("inf"))
        ('2', '-0.333333', 'inf')
    """
    return f"{value:.6g}"


def p_text(p: float) -> str:
    """Return a p-value in words, with two significant digits, not below 0.001.

    Example:
        >>> p_text(0.0213), p_text(0.00001), p_text(0.73), p_text(1.0)
        ('p = 0.021', 'p < 0.001', 'p = 0.73', 'p = 1')
    """
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def short(value: float, digits: int = 3) -> str:
    """Return a number in a few digits.

    Example:
        >>> short(0.21345), short(-12.0), short(-0.0), short(float("inf")), short(0.21345, 2)
        ('0.213', '-12', '0', 'inf', '0.21')
    """
    return f"{value + 0.0:.{digits}g}"


def time_text(time: float, step: float | None) -> str:
    """Return a time in seconds, with enough digits to distinguish it from the time a step later.

    Without a step, the time is the number of a sample.

    Example:
        >>> time_text(1 / 3, 0.1), time_text(1.7e9 + 0.1, 0.1), time_text(3, None)
        ('0.333333 s', '1700000000.1 s', 'sample 3')
    """
    if step is None:
        return f"sample {time:.0f}"
    digits = int(math.log10(max(abs(time) / step, 1.0))) + 3
    return f"{time:.{max(digits, 6)}g} s"


def sample_text(sample: int, period: Fraction | None, start: float = 0.0) -> str:
    """Return the time of a sample in seconds, or its number if there is no period.

    Example:
        >>> sample_text(3, Fraction(1, 2)), sample_text(3, None)
        ('1.5 s', 'sample 3')
    """
    if period is None:
        return time_text(sample, None)
    return time_text(start + float(sample * period), float(period))


def wrapped(text: str) -> list[str]:
    """Break a text into lines of 80 columns at most; all but the first are indented."""
    return wrap(shown_lines(text), 80, subsequent_indent="    ", break_on_hyphens=False)


def shorten(text: str, width: int) -> str:
    """Cut a text to a width, with three dots at the end.

    Example:
        >>> shorten("always(x > 0)", 9)
        'always...'
    """
    return text if len(text) <= width else text[: width - 3] + "..."


class Coloured(str):
    """A text in a colour, for tables on a terminal with colours."""

    __slots__ = ("style",)

    style: str

    def __new__(cls, text: str, style: str = "") -> Self:
        """Return the text with a style."""
        coloured = super().__new__(cls, text)
        coloured.style = style
        return coloured


_CODES: Final = {"red": 31, "yellow": 33, "green": 32, "bold": 1}


@dataclass(frozen=True, slots=True)
class Terminal:
    """The width of lines, and whether they have colours."""

    width: int = 80
    colours: bool = False

    @classmethod
    def present(cls) -> Self:
        """Return the terminal of standard output: 80 columns without colours if it is a file."""
        if not sys.stdout.isatty():
            return cls()
        plain = "NO_COLOR" in os.environ or os.environ.get("TERM") == "dumb"
        return cls(get_terminal_size().columns, not plain)

    def cut(self, text: str, style: str = "") -> str:
        """Return a line that is cut at the width."""
        return self.painted(shorten(shown(text), self.width), style)

    def wrapped(self, text: str, style: str = "") -> list[str]:
        """Return a text in lines of the width."""
        return [self.painted(line, style) for line in wrap(shown_lines(text), self.width)]

    def painted(self, text: str, style: str) -> str:
        """Return a text in a colour, if the terminal has colours."""
        return f"\x1b[{_CODES[style]}m{text}\x1b[0m" if self.colours and style else text

    def table(self, rows: Sequence[Sequence[str]], align: str) -> list[str]:
        """Return the lines of `table`, with a bold heading, names that fit, and coloured cells."""
        head, *others = table(rows, align, self.width, self)
        return [self.painted(head, "bold"), *others]


def table(
    rows: Sequence[Sequence[str]],
    align: str,
    width: int | None = None,
    terminal: Terminal | None = None,
) -> list[str]:
    r"""Arrange cells in columns, two blanks apart; omit a column that is empty below its name.

    Example:
        >>> cells = [("ep", "spec", "steps"), ("", "upright", "50")]
        >>> print(*table(cells, "><>"), sep="\n")
        spec     steps
        upright     50
        >>> print(*table([("spec", "steps"), ("upright_at_all_times", "50")], "<>", 16), sep="\n")
        spec       steps
        uprigh...     50
    """
    columns = [
        (tuple(map(_shown, column)), side)
        for column, side in zip(zip(*rows, strict=True), align, strict=True)
        if any(column[1:])
    ]
    if width is not None and columns:
        first, side = columns[0]
        room = width - sum(2 + max(map(len, column)) for column, _ in columns[1:])
        columns[0] = tuple(shorten(cell, max(room, 8)) for cell in first), side
    widths = [max(map(len, column)) for column, _ in columns]
    padded = [
        [_padded(cell, side, width, terminal) for cell in column]
        for (column, side), width in zip(columns, widths, strict=True)
    ]
    return ["  ".join(cells).rstrip() for cells in zip(*padded, strict=True)]


def _shown(cell: str) -> str:
    """Return a cell without control characters, in its colour."""
    text = shown(cell)
    return cell if text == cell else Coloured(text, getattr(cell, "style", ""))


def _padded(cell: str, side: str, width: int, terminal: Terminal | None) -> str:
    style = cell.style if terminal is not None and isinstance(cell, Coloured) else ""
    shown = cell if terminal is None else terminal.painted(str(cell), style)
    blanks = " " * (width - len(cell))
    return f"{shown}{blanks}" if side == "<" else f"{blanks}{shown}"
