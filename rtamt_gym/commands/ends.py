"""Arguments that say how the end of an episode is read, and the note where one needs them."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, get_args

from rtamt_gym.judging.ends import AtTermination, AtTruncation, OpenEndWarning

__all__ = ["add_ends", "noted_ends"]


def add_ends(parser: argparse.ArgumentParser) -> None:
    """Adds ``--at-termination`` and ``--at-truncation``."""
    parser.add_argument(
        "--at-termination",
        choices=get_args(AtTermination),
        help="how an end of the environment itself is read: complete, the episode is all there is, "
        "so that an invariant that held is satisfied and a goal not reached violated; failure, "
        "what is open is violated, as after a fall; cut, as a time limit (default: complete, and "
        "a note where that satisfies what was open)",
    )
    parser.add_argument(
        "--at-truncation",
        choices=get_args(AtTruncation),
        default="cut",
        help="how a time limit is read: cut, an invariant that held is satisfied, a goal not "
        "reached violated, and a window not seen to its end stays open; complete; or open, all "
        "that is open stays so (default: cut)",
    )


@contextmanager
def noted_ends() -> Iterator[list[str]]:
    """Gives the list of lines that tell, once, that an end has satisfied what was open."""
    notes: list[str] = []
    show = warnings.showwarning

    def note(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:  # noqa: ANN401
        if issubclass(category, OpenEndWarning):
            notes[:] = _OPEN_END
        else:
            show(message, category, *where, **more)

    with warnings.catch_warnings():
        warnings.simplefilter("always", OpenEndWarning)
        warnings.showwarning = note
        yield notes


_OPEN_END = [
    "note: the environment ended an episode while a specification was open, which",
    "counts as satisfied. --at-termination says what its end means: complete for this,",
    "failure for a fall or a crash, cut where the episode could have gone on.",
]
