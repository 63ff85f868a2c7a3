"""Notes on ends that an option may set: of environments, and long before ``--duration``."""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from rtamt_gym.judging.end_warnings import CutWindowWarning, OpenEndWarning
from rtamt_gym.results.warnings import VerdictWarning
from rtamt_gym.tables import number

if TYPE_CHECKING:
    from rtamt_gym.play.record import Record

_SHORT: Final = 100
"""The ratio of ``--duration`` to the longest simulation from which on a unit may be wrong."""


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


def short_warnings(record: Record, options: argparse.Namespace) -> list[VerdictWarning]:
    """Return the warning on simulations that the system ended long before ``--duration``."""
    duration, ended = options.duration, {trial.ended for trial in record if not trial.error}
    if duration is None or duration == math.inf or not ended & {"terminated", "truncated"}:
        return []
    longest = max(trial.simulated for trial in record)
    if "duration" in ended or longest * _SHORT > duration:
        return []
    text = (
        f"no simulation lasts longer than {number(longest)} s of the {number(duration)} s in "
        "--duration, because the system ends by itself; a number without a unit is in seconds"
    )
    period = "" if options.period is None else f", and --period {options.period} is a step"
    return [VerdictWarning(text + period)]
