"""The samples and verdicts of a stream in a live view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from rtamt import Verdict
from rtamt_gym.tables import short
from rtamt_gym.watching.events import EventGroup
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.sampled import SampledGroup
from rtamt_gym.watching.states import RowValues

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView

SHOWN_GROUPS: Final = 100
"""The maximum number of groups in a view."""


class StreamView:
    """Shows the groups of a stream in a view.

    Args:
        view: The view.
        requirements: The names of the requirements.
        variables: The names of the values of a row.

    Attributes:
        hidden: Whether there are more groups than a view shows.
    """

    def __init__(
        self, view: RerunView, requirements: Sequence[str], variables: Sequence[str]
    ) -> None:
        self._view, self._requirements, self._variables = view, requirements, variables
        self._tracks: dict[str | None, Track | None] = {}
        self._verdicts: dict[tuple[str | None, str], Verdict] = {}
        self.hidden = False

    def sample(self, trace: SampledGroup | EventGroup, row: RowValues) -> None:
        """Show the newest row of a group."""
        track = self._track(trace.group)
        if track is None:
            return
        curves: list[float] = []
        for line in trace.newest():
            curves += (line.robustness, line.lower, line.upper)
        time = trace.seconds
        track.add(row, curves, None, (trace.samples - 1, math.nan if time is None else time))

    def line(self, line: Line) -> None:
        """Show a verdict that has changed or is final, and the bounds after the end."""
        track = self._track(line.group)
        if track is None:
            return
        if line.final:
            track.change(line.requirement, (line.robustness, line.lower, line.upper))
        key = line.group, line.requirement
        before = self._verdicts.get(key, Verdict.UNDECIDED)
        self._verdicts[key] = line.verdict
        if line.verdict is before and not (line.final and line.verdict is Verdict.UNDECIDED):
            return
        when = "the end" if line.final else _when(line)
        robustness = "" if math.isnan(line.robustness) else f", robustness {short(line.robustness)}"
        reason = f", {line.reason}" if line.reason and not line.final else ""
        text = f"{line.requirement} {line.verdict.name} at {when}{robustness}{reason}"
        sample = track.sample_count if line.sample is None else line.sample
        if line.final and line.sample is None:
            sample -= 1
        time = math.nan if line.time is None else line.time
        track.log(line.requirement, line.verdict, text, (sample, time, 1))

    def end(self) -> None:
        """Send the newest rows too, after the final lines."""
        for track in self._tracks.values():
            if track is not None:
                track.begin()

    def _track(self, group: str | None) -> Track | None:
        if group not in self._tracks:
            visible = len(self._tracks) < SHOWN_GROUPS
            self.hidden |= not visible
            self._tracks[group] = (
                self._view.track(self._variables, self._requirements, None, group or "")
                if visible
                else None
            )
        return self._tracks[group]


def _when(line: Line) -> str:
    return f"sample {line.sample}" if line.time is None else f"{line.time:.6g} s"
