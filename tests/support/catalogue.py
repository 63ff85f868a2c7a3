"""Catalogues of errors: a call, and the error that it raises, word for word."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rtamt

__all__ = ["check", "entries"]


def entries(path: Path) -> list[tuple[str, str]]:
    """The call of each block, behind ``> ``, and the class and the text of its error.

    Blocks are separated by empty lines; one that begins with ``#`` is a heading.
    """
    blocks = (block.splitlines() for block in path.read_text(encoding="utf-8").split("\n\n"))
    return [(first[2:], "\n".join(said)) for first, *said in blocks if not first.startswith("#")]


def check(call: str, said: str) -> None:
    """Compares what a call raises with what the catalogue says."""
    names = {name: getattr(rtamt, name) for name in rtamt.__all__}  # loaded when first used
    with pytest.raises(rtamt.RtamtError) as caught:
        eval(call, {**names, "rtamt": rtamt, "np": np})  # noqa: S307 - the catalogue is our own
    assert f"{type(caught.value).__name__}: {caught.value}" == said
