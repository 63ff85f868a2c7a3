"""A bar of progress, for those who watch a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["progress"]

DELAY = 1.0
"""Seconds before a bar is shown."""


@contextmanager
def progress(what: str, total: int, unit: str) -> Iterator[Callable[[int], None]]:
    """A bar on stderr, after a second, if that is a terminal and tqdm is installed.

    Args:
        what: What goes on.
        total: How much there is to do.
        unit: Of what.

    Yields:
        A function that is told how much has been done since it was last called.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        yield lambda _: None
        return
    with tqdm(desc=what, total=total, unit=unit, unit_scale=True, delay=DELAY, leave=False) as bar:
        yield lambda done: bar.update(done) and None
