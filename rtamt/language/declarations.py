"""Declarations of a text: names, types, ranges and defaults of variables; ids of requirements."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, Literal
from urllib.parse import quote

from rtamt.errors import InputTypeError, SpecificationError
from rtamt.language.interval import number_text

PRIMITIVES = (
    *("bool", "int", "uint", "long", "float", "double", "float32", "float64"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
)
"""Types of variables and constants that need no import; every value becomes a double."""

PathStep = str | int
"""The name of a field, or the index of an element, from 0."""

_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[(0|[1-9]\d*)\])*", re.ASCII)
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def is_name(text: str) -> bool:
    """Return whether a text has the form of a variable's name, as reserved words also have."""
    return _NAME.fullmatch(text) is not None


def is_field(name: str) -> bool:
    """Return whether a name leads into a message, to a field or an element."""
    return "." in name or "[" in name


def steps(name: str) -> tuple[PathStep, ...]:
    """Return the fields and elements in a name, the outermost first.

    Example:
        >>> steps("scan.ranges[0]")
        ('scan', 'ranges', 0)
    """
    if "[" not in name:
        return tuple(name.split("."))
    return tuple(field or int(element) for field, element in _STEP.findall(name))


def joined(path: Iterable[PathStep]) -> str:
    """Return the name with these `steps`."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def lineage(name: str) -> Iterator[str]:
    """Yield a name and everything that it belongs to: ``a.b[0]``, ``a.b``, ``a``."""
    while name:
        yield name
        name = name[: max(name.rfind("."), name.rfind("["), 0)]


@dataclass(frozen=True, slots=True)
class Declaration:
    """The declaration of a variable.

    Attributes:
        type: A primitive type or the name of an imported one.
        io: ``"input"`` if the system reads the variable, ``"output"`` if it sets it, or None.
        default: The value before the first sample with a value; None without a default.
        range: The declared minimum and maximum, or None. Monitors ignore it.
    """

    type: str
    io: Literal["input", "output"] | None = None
    default: float | None = None
    range: tuple[float, float] | None = None


def is_whole(kind: str) -> bool:
    """Return whether the values of a type are whole numbers.

    Example:
        >>> is_whole("uint8"), is_whole("float")
        (True, False)
    """
    return kind.rstrip("0123456789") in ("bool", "int", "uint", "long")


def range_of_type(kind: str) -> tuple[float, float] | None:
    """Return the minimum and maximum of a type; None if unknown, as for ``int`` and ``long``.

    Example:
        >>> range_of_type("uint8"), range_of_type("int16"), range_of_type("uint")
        ((0.0, 255.0), (-32768.0, 32767.0), (0.0, inf))
        >>> range_of_type("bool"), range_of_type("int"), range_of_type("float")
        ((0.0, 1.0), None, None)
    """
    if kind == "bool":
        return 0.0, 1.0
    bits = kind.removeprefix("u").removeprefix("int")
    if kind.startswith("uint"):
        return 0.0, float(2 ** int(bits) - 1) if bits else math.inf
    if kind.startswith("int") and bits:
        return -(2.0 ** (int(bits) - 1)), float(2 ** (int(bits) - 1) - 1)
    return None


def range_text(values: tuple[float, float]) -> str:
    """Return a range as text: ``[0, 120]``."""
    return f"[{number_text(values[0])}, {number_text(values[1])}]"


LINKS: Final = ("https://", "http://")
"""The starts of links: other addresses could run code in a page."""


@dataclass(frozen=True, slots=True)
class RequirementId:
    """The id of a requirement and a link to it; ``@ id(NAME, "ID", "LINK")`` in a text.

    Attributes:
        id: The id, such as ``SYS-REQ-7``: any characters except quotes and line ends.
        link: The address of the requirement, which starts with ``https://`` or ``http://``; the id
            replaces ``{id}`` in it, as addresses write it. Empty without a link.

    Raises:
        SpecificationError: If the id is empty, or the id or the link cannot stand in a text.

    Example:
        >>> RequirementId("SYS-REQ-7", "https://reqs.example/{id}").link
        'https://reqs.example/SYS-REQ-7'
    """

    id: str
    link: str = ""

    def __post_init__(self) -> None:
        """Check both texts and put the id into the link."""
        for text in (self.id, self.link):
            if not isinstance(text, str):
                raise InputTypeError(f"expected id and link as text, got {text!r}")
            if any(character in text for character in '"\r\n'):
                raise SpecificationError(f"expected no quote and no end of a line, got {text!r}")
        if not self.id.strip():
            raise SpecificationError("expected an id, got an empty text")
        if self.link and not self.link.startswith(LINKS):
            raise SpecificationError(
                f"expected a link that starts with {' or '.join(LINKS)}, got {self.link!r}"
            )
        object.__setattr__(self, "link", self.link.replace("{id}", quote(self.id, safe="")))

    def __str__(self) -> str:
        return self.id
