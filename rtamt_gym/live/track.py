"""The samples of one monitored trace on their way to a view."""

from __future__ import annotations

import io
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt import Verdict

CURVES: Final = ("robustness", "lower", "upper")
"""The curves of a requirement."""

HEAD: Final = 3
"""The numbers of a row before its values: sample, time and episode."""

_MANY: Final = 50_000
"""The number of waiting rows that the monitored program sends itself, to bound memory."""

_QUALITY: Final = 85
"""The quality of pictures, as Pillow counts it."""


TrackPlace = tuple[float, float, float]
"""Sample, time and episode."""


class VerdictLine(NamedTuple):
    """A line of the text log: a verdict that has changed, or a verdict at the end."""

    place: TrackPlace
    requirement: str
    verdict: Verdict
    text: str


class PackedPicture(NamedTuple):
    """A picture as JPEG."""

    place: TrackPlace
    picture: bytes


class Track:
    """Collects the samples of one trace after the other; the view sends them.

    Appending to a deque needs no lock, so a sample never waits for the thread that sends.
    """

    def __init__(
        self,
        prefix: str,
        signals: Sequence[str],
        requirements: Sequence[str],
        period: float | None,
        send: Callable[[], None],
    ) -> None:
        self.prefix, self.period = prefix, period
        self.signals, self.requirements = tuple(signals), tuple(requirements)
        self._send = send
        self.rows: deque[tuple[float, ...]] = deque()
        self.lines: deque[VerdictLine] = deque()
        self.frames: deque[PackedPicture] = deque()
        self.sample_count = self.episode = 0
        self._monitors: Sequence[tuple[Any, Any]] = ()
        self._newest: tuple[float, ...] | None = None
        self._open: list[int] = []
        self._running = False
        self._render: Callable[[], Any] | None = None
        self._every = 0
        self.samples, self.has_pictures = 0, False

    def follow(self, monitors: Mapping[str, tuple[Any, Any]]) -> None:
        """Read the curves of these monitors, ``(robustness source, judge)`` by requirement."""
        self._monitors = list(monitors.values())

    def draw(self, render: Callable[[], Any] | None, every: int) -> None:
        """Take a picture of every ``every``-th sample of an episode, the first included.

        ``render`` returns a picture of shape (height, width, 3); None: the caller takes pictures.
        """
        self.has_pictures = True
        self._render, self._every = render, every

    def begin(self) -> None:
        """Start an episode at the next sample."""
        self._commit()
        self._running = False

    def sample(self, values: Sequence[float]) -> None:
        """Take the values of a sample, after the update of the monitors."""
        if not self._running:
            self._start()
        curves: list[float] = []
        for source, judge in self._monitors:
            curves += (source.robustness, judge.lower, judge.upper)
        self._add(values, curves)
        for index in self._open:
            if self._monitors[index][1].verdict:
                self._note_decisions()
                break
        if self._render is not None and not self.samples % self._every:
            self.picture(self._render())
        self.samples += 1

    def add(
        self,
        values: Iterable[float],
        curves: Sequence[float],
        verdicts: Sequence[Verdict] | None,
        place: tuple[float, float] | None = None,
    ) -> None:
        """Take a sample with values that the caller has read from the monitors."""
        if not self._running:
            self._start()
        self._add(values, curves, place)
        if verdicts is None:
            self._open = []
        for index in [index for index in self._open if verdicts and verdicts[index]]:
            self._open.remove(index)
            self._log(index, verdicts[index], curves[3 * index], "")  # type: ignore[index]
        self.samples += 1

    def end(self, states: Mapping[str, Mapping[str, Any]]) -> None:
        """End the episode: the newest sample gets the states after the end, by requirement."""
        curves = [float(states[name][curve]) for name in self.requirements for curve in CURVES]
        self.finish(curves, [Verdict[states[name]["verdict"]] for name in self.requirements])

    def finish(self, curves: Sequence[float], verdicts: Sequence[Verdict]) -> None:
        """End the episode as `end` does, with curves and verdicts as for `add`."""
        newest = self._newest
        if newest is None:
            return
        self._newest = (*newest[: HEAD + len(self.signals)], *curves)
        for index in self._open:
            self._log(index, verdicts[index], curves[3 * index], "the end")
        self.begin()

    def picture(self, frame: NDArray[np.uint8]) -> None:
        """Take a picture of the newest sample, of shape (height, width, 3)."""
        from PIL import Image

        packed = io.BytesIO()
        Image.fromarray(frame).save(packed, "jpeg", quality=_QUALITY)
        self.frames.append(PackedPicture(self._place, packed.getvalue()))

    def change(self, name: str, curves: tuple[float, float, float]) -> None:
        """Change robustness and bounds of a requirement at the newest sample."""
        if self._newest is None:
            return
        start = HEAD + len(self.signals) + 3 * self.requirements.index(name)
        newest = self._newest
        self._newest = (*newest[:start], *curves, *newest[start + 3 :])

    def log(self, name: str, verdict: Verdict, text: str, place: TrackPlace | None = None) -> None:
        """Add a line about a requirement to the log, by default at the newest sample."""
        self.lines.append(VerdictLine(place or self._place, name, verdict, text))

    def _commit(self) -> None:
        if self._newest is not None:
            self.rows.append(self._newest)
            self._newest = None

    def _start(self) -> None:
        self.episode += 1
        self._running, self.samples = True, 0
        self._open = [*range(len(self.requirements))]

    def _add(
        self,
        values: Iterable[float],
        curves: Iterable[float],
        place: tuple[float, float] | None = None,
    ) -> None:
        before = self._newest
        if place is None:
            sample = self.sample_count
            place = sample, math.nan if self.period is None else sample * self.period
        self.sample_count += 1
        self._newest = (*place, self.episode, *values, *curves)
        if before is not None:
            self.rows.append(before)
            if len(self.rows) >= _MANY:
                self._send()

    def _note_decisions(self) -> None:
        for index in [*self._open]:
            source, judge = self._monitors[index]
            if judge.verdict:
                self._open.remove(index)
                self._log(index, judge.verdict, source.robustness, "")

    def _log(self, index: int, verdict: Verdict, robustness: float, by: str) -> None:
        when = f"sample {self.samples}"
        if self.period is not None:
            when = f"{self.samples * self.period:.6g} s"
        text = f"{self.requirements[index]} {verdict.name} at {by or when}"
        robust = "" if math.isnan(robustness) else f", robustness {robustness:.6g}"
        self.log(self.requirements[index], verdict, f"{text}, episode {self.episode}{robust}")

    @property
    def _place(self) -> TrackPlace:
        newest = self._newest
        assert newest is not None, "a sample came before"  # noqa: S101 - for mypy
        return newest[0], newest[1], newest[2]
