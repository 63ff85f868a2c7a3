"""The changes of mutants, the same in Python and in C++, and their names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

# An operator, and its replacements in mutants.
ARITHMETIC: Final = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "/", "%": "*", "**": "*"}
BITS: Final = {"&": "|", "|": "&", "<<": ">>", ">>": "<<", "^": "&"}
COMPARISONS: Final = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="}
PYTHON_COMPARISONS: Final = {"is": "is not", "is not": "is", "in": "not in", "not in": "in"}
PYTHON_LOGIC: Final = {"and": "or", "or": "and"}
NATIVE_LOGIC: Final = {"&&": "||", "||": "&&"}


@dataclass(frozen=True, order=True)
class Site:
    """A change of a place: from a line and column (counted from 1 and 0) to another."""

    line: int
    column: int
    end_line: int
    end_column: int
    change: str


def told_apart(sites: Iterable[Site]) -> dict[Site, Site]:
    """Return the sites in the order of the source, with changes that are unique on a line.

    The second of two equal changes on a line is ``0 to 1 at 2``.
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
    """A site in a file, with the number that activates it.

    Attributes:
        path: The path of the file from the root of the checkout.
        text: The line of the source, without indentation.
    """

    number: int
    folder: str
    path: str
    site: Site
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.site.line}: {self.site.change}: {self.text}"
