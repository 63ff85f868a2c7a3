"""What a mutant changes, the same in Python and in C++, and what names it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

# An operator, and what stands for it in a mutant.
ARITHMETIC: Final = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "/", "%": "*", "**": "*"}
BITS: Final = {"&": "|", "|": "&", "<<": ">>", ">>": "<<", "^": "&"}
COMPARISONS: Final = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="}
PYTHON_COMPARISONS: Final = {"is": "is not", "is not": "is", "in": "not in", "not in": "in"}
PYTHON_LOGIC: Final = {"and": "or", "or": "and"}
NATIVE_LOGIC: Final = {"&&": "||", "||": "&&"}


@dataclass(frozen=True, order=True)
class Site:
    """One change of one place: from a line and column (of 1 and 0) to others."""

    line: int
    column: int
    end_line: int
    end_column: int
    change: str


def told_apart(sites: Iterable[Site]) -> dict[Site, Site]:
    """Each site, in the order of the source, with a change that says which one of its line it is.

    Of two that are alike on one line the second is ``0 to 1 at 2``.
    """
    times: Counter[tuple[int, str]] = Counter()
    told = {}
    for site in sorted(set(sites)):
        change = site.change.partition(" at ")[0]
        times[site.line, change] += 1
        place = times[site.line, change]
        told[site] = replace(site, change=f"{change} at {place}" if place > 1 else change)
    return told


@dataclass(frozen=True)
class Mutant:
    """A site in a file, with the number that turns it on.

    Attributes:
        path: Of the file, from the root of the checkout.
        text: The line of the source, without indentation.
    """

    number: int
    folder: str
    path: str
    site: Site
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.site.line}: {self.site.change}: {self.text}"
