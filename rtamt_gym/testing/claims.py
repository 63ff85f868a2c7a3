"""A claim of a contract, and the error where it does not hold."""

from __future__ import annotations

__all__ = ["claim"]


def claim(holds: bool, what: str) -> None:  # noqa: FBT001 - the claim itself, not a switch
    """Raises an error in the words of the contract if it is not kept.

    It does so under ``python -O`` too, which drops ``assert``.

    Raises:
        AssertionError: If the claim does not hold.
    """
    if not holds:
        raise AssertionError(what)
