"""How the end of an episode is read, and what is told where nobody has said it."""

from __future__ import annotations

import warnings
from typing import Literal

from rtamt_gym.checks.callers import caller_level

__all__ = ["AtTermination", "OpenEndWarning", "warn_of_open_end"]

AtTermination = Literal["complete", "cut", "failure"]
"""How an environment's own end is read: as `rtamt.EpisodeMonitor.finish` does, or as a failure."""


class OpenEndWarning(UserWarning):
    """An environment ended an episode, and so settled what was open.

    Attributes:
        name: The specification that counts as satisfied.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(
            f"the environment ended an episode while specification {name!r} was open, and counts "
            "it as satisfied: a terminated episode is taken for all there is. Say what its end "
            'means: at_termination="complete" for this, "failure" where an environment ends what '
            'has failed, such as a fall, or "cut" where an episode could have gone on'
        )


def warn_of_open_end(name: str) -> None:
    """Warns that this specification counts as satisfied because the environment ended it."""
    warnings.warn(OpenEndWarning(name), stacklevel=caller_level())
