"""Catalogues of errors: a call, and the exact text of its error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rtamt

__all__ = ["check", "entries"]


def entries(path: Path) -> list[tuple[str, str]]:
    """Return the call of each block after ``> ``, and the class and the text of its error.

    Empty lines separate blocks; a block that starts with ``#`` is a heading.
    """
    blocks = (block.splitlines() for block in path.read_text(encoding="utf-8").split("\n\n"))
    return [(first[2:], "\n".join(said)) for first, *said in blocks if not first.startswith("#")]


def check(call: str, said: str, **own: object) -> None:
    """Compare the error of a call, which may use names of its own, with the catalogue."""
    names = {name: getattr(rtamt, name) for name in rtamt.__all__}  # loaded at their first use
    with pytest.raises(rtamt.RtamtError) as caught:
        eval(call, {**names, "rtamt": rtamt, "np": np, **own})  # noqa: S307 - our own catalogue
    assert f"{type(caught.value).__name__}: {caught.value}" == said
