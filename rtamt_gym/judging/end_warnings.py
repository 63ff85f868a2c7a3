"""Warnings about the end of an episode."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence

from rtamt_gym.checks.callers import caller_level


class OpenEndWarning(UserWarning):
    """An environment decided an open specification by ending an episode.

    Attributes:
        name: The specification that counts as satisfied.
    """

    _TEXT = (
        "the environment ended an episode while specification {!r} was open, which counts as "
        'satisfied. Set at_termination="complete" to confirm this, "failure" if the environment '
        'ends failed episodes, such as a fall, or "cut" if the episode could have gone on'
    )

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(self._TEXT.format(name))


class CutWindowWarning(OpenEndWarning):
    """An environment decided a specification by ending an episode inside a bounded window.

    ``eventually(always[0:0.5](done > 0))`` is satisfied by the first sample with ``done > 0`` if
    the environment ends the episode there and the end counts as complete.
    """

    _TEXT = (
        "the environment ended an episode inside a bounded window of specification {!r}, which "
        "counts as satisfied without the rest of the window. Set "
        'at_termination="cut" to leave it open, "failure" to violate it, or "complete" to confirm '
        "this. An environment that goes on after a success records the rest of the window"
    )


class UnseenEndWarning(UserWarning):
    """A wrapper around a monitor reset an episode before the monitor saw its end."""

    def __init__(self, monitor: str, wrapper: str) -> None:
        super().__init__(
            f"{wrapper} around {monitor} reset an episode that had not ended for the monitor. If "
            f"{wrapper} ended it, the last info had no is_success, and success rates leave the "
            f"episode out: put {wrapper} inside of {monitor}. stl_episodes has the episode as "
            "truncated"
        )


def assumed(satisfied: Sequence[str], windows: Collection[str]) -> tuple[str, bool] | None:
    """Return what to warn of at an end without `at_termination`, or None.

    It is the first specification that the end satisfied, and whether its bounded window reached
    past the end; specifications with such windows come first.
    """
    cut = [name for name in satisfied if name in windows]
    return next(((name, bool(cut)) for name in cut or satisfied), None)


def warn_of_open_end(name: str, *, window: bool = False) -> None:
    """Warn that the end of an episode satisfied a specification, or its open ``window``."""
    kind = CutWindowWarning if window else OpenEndWarning
    warnings.warn(kind(name), stacklevel=caller_level())
