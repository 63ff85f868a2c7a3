"""`RequirementId`: what a requirement is called where requirements are kept, with a link to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from rtamt.errors import InputTypeError, SpecificationError

__all__ = ["LINKS", "RequirementId"]

LINKS: Final = ("https://", "http://")
"""What a link begins with: other addresses could run code in a page."""


@dataclass(frozen=True, slots=True)
class RequirementId:
    """The id of a requirement, and where it can be read; ``@ id(NAME, "ID", "LINK")`` in a text.

    Attributes:
        id: The id, such as ``SYS-REQ-7``: any characters but quotes and ends of lines.
        link: The address of the requirement, which begins with ``https://`` or ``http://``;
            ``{id}`` in it has become the id, as addresses write it. Empty if there is none.

    Raises:
        SpecificationError: If the id is empty, or one of the two cannot stand in a text.

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
                f"expected a link that begins with {' or '.join(LINKS)}, got {self.link!r}"
            )
        object.__setattr__(self, "link", self.link.replace("{id}", quote(self.id, safe="")))

    def __str__(self) -> str:
        return self.id
