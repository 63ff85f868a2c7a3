"""The note that commands print if no option sets what the end of an environment means."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rtamt_gym.judging.end_warnings import CutWindowWarning, OpenEndWarning


@contextmanager
def noted_ends() -> Iterator[list[str]]:
    """Yield a list that receives the note on ends that satisfied open windows, once."""
    notes: list[str] = []
    show = warnings.showwarning

    def note(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:  # noqa: ANN401
        if issubclass(category, OpenEndWarning):
            if notes[:] != _CUT_WINDOW:  # that note is the more detailed one
                notes[:] = _CUT_WINDOW if issubclass(category, CutWindowWarning) else _OPEN_END
        else:
            show(message, category, *where, **more)

    with warnings.catch_warnings():
        warnings.simplefilter("always", OpenEndWarning)
        warnings.showwarning = note
        yield notes


_OPEN_END = [
    "note: the environment ended an episode while a specification was open, which",
    "counts as satisfied. --at-termination sets what its end means: complete for",
    "this, failure for a fall or a crash, cut where the episode could have gone on.",
]

_CUT_WINDOW = [
    "note: the environment ended an episode inside a bounded window, and what the",
    "window had not seen counts as satisfied. --at-termination sets what its end",
    "means: cut leaves it open, failure violates it, complete is for this.",
]
