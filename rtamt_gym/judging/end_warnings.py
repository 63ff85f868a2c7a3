"""Warnings about the end of an episode."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence

from rtamt_gym.checks.callers import caller_level


class OpenEndWarning(UserWarning):
    """An environment ended an episode, and so decided an open specification.

    Attributes:
        name: The specification that counts as satisfied.
    """

    _TEXT = (
        "the environment ended an episode while specification {!r} was open, and counts "
        "it as satisfied: a terminated episode is taken for all there is. Say what its end "
        'means: at_termination="complete" for this, "failure" where an environment ends what '
        'has failed, such as a fall, or "cut" where an episode could have gone on'
    )

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(self._TEXT.format(name))


class CutWindowWarning(OpenEndWarning):
    """An environment ended an episode inside a bounded window, and so decided a specification.

    ``eventually(always[0:0.5](done > 0))`` is satisfied by the first sample that is done, if the
    environment ends the episode there and the end counts as complete.
    """

    _TEXT = (
        "the environment ended an episode inside a bounded window of specification {!r}, and "
        "counts it as satisfied: what the window had not seen is taken for nothing. Say what the "
        'end means: at_termination="cut" leaves it open, "failure" violates it, "complete" is '
        "for this; an environment that goes on after its success shows what the window needs"
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
    """Return the specification to name in a warning about an end without `at_termination`.

    Args:
        satisfied: The specifications that the end satisfied.
        windows: The specifications with a bounded window that reached past the end.

    Returns:
        The name, and whether a window of it did; None if there is nothing to warn of.
    """
    cut = [name for name in satisfied if name in windows]
    return next(((name, bool(cut)) for name in cut or satisfied), None)


def warn_of_open_end(name: str, *, window: bool = False) -> None:
    """Warn that a specification counts as satisfied because the environment ended the episode.

    Args:
        name: The specification.
        window: Whether a bounded window reached past the end.
    """
    kind = CutWindowWarning if window else OpenEndWarning
    warnings.warn(kind(name), stacklevel=caller_level())
