"""A progress bar for work that takes longer than a second."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["progress", "silence"]

DELAY = 1.0
"""Seconds before the bar is shown."""

_outermost = [True]
"""Whether the next bar stands inside no other, and in a process that shows bars."""


def silence() -> None:
    """Shows no bar in this process from now on."""
    _outermost[0] = False


@contextmanager
def progress(what: str, total: int, unit: str) -> Iterator[Callable[[int], None]]:
    """Shows a bar on stderr after a second, if stderr is a terminal and tqdm is installed.

    Of bars inside each other the outermost is shown.

    Args:
        what: Names the work.
        total: The amount of work.
        unit: The unit of the amount.

    Yields:
        A function to call with the amount done since its last call.
    """
    if not (_outermost[0] and sys.stderr is not None and sys.stderr.isatty()):
        yield lambda _: None
        return
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        yield lambda _: None
        return
    scaled = total > 9999  # 12.3M is shorter than 12345678, but 10.0 no better than 10
    with tqdm(
        desc=what, total=total, unit=unit, unit_scale=scaled, delay=DELAY, leave=False
    ) as bar:
        _outermost[0] = False
        try:
            yield lambda done: bar.update(done) and None
        finally:
            _outermost[0] = True
