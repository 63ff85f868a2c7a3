"""A progress bar for work that takes longer than a second."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

DELAY = 1.0
"""Seconds before the bar is shown."""

_outermost = [True]
"""Whether the next bar stands inside no other, and in a process that shows bars."""


class Advance(Protocol):
    """A function that shows additional work done, and a note."""

    def __call__(self, done: int, note: str = "", /) -> None: ...  # noqa: D102 - as the class says


def silence() -> None:
    """Show no bar in this process from now on."""
    _outermost[0] = False


@contextmanager
def progress(title: str, total: int, unit: str) -> Iterator[Advance]:
    """Show a bar on stderr after a second, if stderr is a terminal and tqdm is installed.

    Only the outermost of nested bars is shown.

    Yields:
        A function to call with the amount done since its last call, and with a note to show after
        the numbers.
    """
    if not (_outermost[0] and sys.stderr is not None and sys.stderr.isatty()):
        yield _silent
        return
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        yield _silent
        return

    class Bar(tqdm):  # type: ignore[misc]  # not typed
        monitor_interval = 0  # its thread would prevent forks

    scaled = total > 9999  # 12.3M is shorter than 12345678, but 10.0 is not shorter than 10
    with Bar(
        desc=title, total=total, unit=unit, unit_scale=scaled, delay=DELAY, leave=False
    ) as bar:
        _outermost[0] = False

        def advance(done: int, note: str = "", /) -> None:
            if note:
                bar.set_postfix_str(note, refresh=False)
            bar.update(done)

        try:
            yield advance
        finally:
            _outermost[0] = True


def _silent(_done: int, _note: str = "", /) -> None:
    """Show nothing."""
