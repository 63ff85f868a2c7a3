"""The panel that `RobustnessOverlay` draws: robustness bars, verdicts, signals and the time.

Pillow draws it, in 1 to 2 ms, a fifth of what Matplotlib takes. Nothing is told by colour alone: a
negative bar lies left of the line in the middle and is hatched, and every number has its sign.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

__all__ = ["Gauge", "OverlayPanel", "PanelPlace", "Pixels", "Sight"]

Pixels = NDArray[np.uint8]
"""A picture, of shape (height, width, 3)."""

PanelPlace = Literal["below", "over"]
"""Where the panel is: below the picture, which grows, or over its lower part."""

_GROUND = (24, 26, 30)
_WHITE = (240, 240, 240)
_GREY = (165, 170, 175)
_FAINT = (105, 110, 115)
# Okabe and Ito's colours, which colour-blind readers can tell apart, lighter on the dark ground.
_HOLDS = (0, 178, 130)
_VIOLATES = (235, 110, 40)
_BOUNDS = (155, 208, 240)
_VERDICTS = {"SATISFIED": _HOLDS, "VIOLATED": _VIOLATES}
_CLEAR = 5
"""A panel over a picture lets this part of its light through: one of 5."""


class Gauge(NamedTuple):
    """What is shown of a specification.

    Attributes:
        robustness: The robustness, if the episode ended now.
        lower: The least that it can still become.
        upper: The greatest that it can still become.
        verdict: ``"VIOLATED"``, ``"UNDECIDED"`` or ``"SATISFIED"``.
        scale: The robustness at the right end of the bar; at the left end it is the same below 0.
        by_end: Whether the end alone violates it: its robustness holds.
    """

    robustness: float
    lower: float
    upper: float
    verdict: str
    scale: float
    by_end: bool = False

    @property
    def words(self) -> str:
        """The verdict as the panel shows it."""
        return f"{self.verdict} at end" if self.by_end else self.verdict


class Sight(NamedTuple):
    """What is shown of one sample.

    Attributes:
        sample: Its number in the episode.
        time: Its time, as a text.
        gauges: One for every specification.
        values: A value of every signal.
    """

    sample: int
    time: str
    gauges: tuple[Gauge, ...]
    values: tuple[float, ...]


class OverlayPanel:
    """Draws panels on frames of one size.

    Args:
        specs: The names of the specifications.
        signals: The names of the signals.
        width: The width of the frames, in pixels.
        height: The height of the frames, in pixels.
        place: Where the panel is.
    """

    def __init__(
        self,
        specs: Sequence[str],
        signals: Sequence[str],
        width: int,
        height: int,
        place: PanelPlace,
    ) -> None:
        self._specs, self._signals, self._place = specs, signals, place
        self._columns = 2 if len(signals) > 1 and width >= 300 else 1
        rows = 1 + len(specs) + -(-len(signals) // self._columns)
        size = min(max(round(width / 42), 10), 22)
        if place == "over":
            size = min(size, max(round(height / rows / 1.5), 8))
        self._font = _font(size)
        self._row = round(1.5 * size)
        self._gap = size // 2
        self._width = width
        self.height = rows * self._row + self._gap
        self.height += (height + self.height) % 2  # encoders of videos ask for an even height
        if place == "over":
            self.height = min(self.height, height)

    def draw(self, frame: Pixels, sights: Sequence[Sight]) -> Pixels:
        """The frame with the panel of the last of these samples; the others are its past."""
        if self._place == "below":
            picture = Image.new("RGB", (self._width, self.height), _GROUND)
        else:
            ground = [part - part // _CLEAR for part in _GROUND]
            picture = Image.fromarray(frame[-self.height :] // _CLEAR + np.array(ground, np.uint8))
        self._draw(ImageDraw.Draw(picture), sights)
        panel = np.asarray(picture)
        if self._place == "below":
            return np.concatenate([frame, panel])
        drawn = frame.copy()
        drawn[-self.height :] = panel
        return drawn

    def _draw(self, draw: ImageDraw.ImageDraw, sights: Sequence[Sight]) -> None:
        now, gap, y = sights[-1], self._gap, self._gap // 2
        left, right = gap, self._width - gap
        self._text(draw, left, y, now.time, _WHITE)
        words = _summary(now.gauges)
        self._text(draw, right, y, words, _VERDICTS.get(words.split()[0], _GREY), "r")
        longest = max(("UNDECIDED", *(gauge.words for gauge in now.gauges)), key=len)
        verdicts = self._font.getlength(f"-0.00000 {longest}")
        names = min(0.3 * self._width, max(map(self._font.getlength, self._specs), default=0.0))
        if names + verdicts > 0.75 * self._width:  # too narrow for numbers beside their verdicts
            verdicts = self._font.getlength(longest)
        wide = verdicts > self._font.getlength(longest)
        for name, gauge in zip(self._specs, now.gauges, strict=True):
            y += self._row
            self._text(draw, left, y, self._fitted(name, names), _WHITE)
            bar = left + names + gap, y, right - verdicts - gap, y + self._row
            self._bar(draw, bar, gauge)
            colour = _VERDICTS.get(gauge.verdict, _GREY)
            if wide:
                self._text(draw, right - verdicts, y, _number(gauge.robustness), _WHITE)
            shown = gauge.words if wide or gauge.verdict in _VERDICTS else None
            self._text(draw, right, y, shown or _number(gauge.robustness), colour, "r")
        cell = (self._width - gap) / self._columns
        names = min(0.35 * cell, max(map(self._font.getlength, self._signals), default=0.0))
        for at, name in enumerate(self._signals):
            y += self._row if at % self._columns == 0 else 0
            begin = left + cell * (at % self._columns)
            self._text(draw, begin, y, self._fitted(name, names), _GREY)
            values = [each.values[at] for each in sights[-int(cell) :]]
            self._curve(draw, begin + names, y, cell - names - 2 * gap, values)

    def _bar(
        self, draw: ImageDraw.ImageDraw, box: tuple[float, float, float, float], gauge: Gauge
    ) -> None:
        """A bar from 0 in the middle to the robustness, between marks at the bounds."""
        x0, y0, x1, y1 = box
        top, bottom, middle = y0 + 0.22 * self._row, y1 - 0.22 * self._row, (x0 + x1) / 2

        def place(value: float) -> float:
            share = min(max(value / gauge.scale, -1.0), 1.0)
            return middle + share * (x1 - x0) / 2

        draw.rectangle((x0, top, x1, bottom), outline=_FAINT)
        holds = math.copysign(1.0, gauge.robustness) > 0.0
        ends = sorted((middle, place(gauge.robustness)))
        draw.rectangle((ends[0], top, ends[1], bottom), fill=_HOLDS if holds else _VIOLATES)
        if not holds:
            for left in range(math.ceil(ends[0]), math.floor(ends[1]), 5):
                draw.line((left, bottom, min(left + 3, ends[1]), top), fill=_GROUND)
        low, high, centre = place(gauge.lower), place(gauge.upper), (top + bottom) / 2
        draw.line((low, centre, high, centre), fill=_BOUNDS)
        reach = (y1 - y0) * 0.36
        for x in (low, high):
            draw.line((x, centre - reach, x, centre + reach), fill=_BOUNDS, width=2)
        draw.line((middle, y0 + 1, middle, y1 - 1), fill=_WHITE)

    def _curve(
        self, draw: ImageDraw.ImageDraw, x: float, y: float, width: float, values: Sequence[float]
    ) -> None:
        """The last value, and the curve of those before it: as many as there are pixels for."""
        number = self._gap + self._font.getlength("-0.00000")
        self._text(draw, x + number, y, _number(values[-1]), _WHITE, "r")
        begin, room = x + number + self._gap, width - number - self._gap
        kept = list(enumerate(values[-max(int(room), 2) :]))
        finite = [value for _, value in kept if math.isfinite(value)]
        if len(finite) < 2:
            return
        low, high = min(finite), max(finite)
        span, tall = (high - low) or 1.0, 0.7 * self._row
        base = y + (0.85 if high > low else 0.5) * self._row
        step = min(room / (len(kept) - 1), 4.0)
        line = [
            (begin + step * at, base - tall * (value - low) / span)
            for at, value in kept
            if math.isfinite(value)
        ]
        draw.line(line, fill=_BOUNDS)

    def _text(
        self,
        draw: ImageDraw.ImageDraw,
        x: float,
        y: float,
        text: str,
        colour: tuple[int, int, int],
        side: Literal["l", "r"] = "l",
    ) -> None:
        draw.text((x, y + self._row / 2), text, fill=colour, font=self._font, anchor=f"{side}m")

    def _fitted(self, text: str, width: float) -> str:
        """The text, with its middle cut out if it is wider."""
        cut, kept = text, len(text)
        while kept > 2 and self._font.getlength(cut) > width + 1.0:
            kept -= 1
            cut = f"{text[: kept - kept // 2]}..{text[-(kept // 2) :]}"
        return cut


def _summary(gauges: Sequence[Gauge]) -> str:
    """The worst verdict of all specifications, and how many have it."""
    verdicts = [gauge.verdict for gauge in gauges]
    for verdict in ("VIOLATED", "UNDECIDED"):
        count = verdicts.count(verdict)
        if count:
            return f"{verdict} {count} of {len(verdicts)}" if len(verdicts) > 1 else verdict
    return "SATISFIED"


def _number(value: float) -> str:
    """A number in at most 7 characters, with its sign."""
    text = f"{value:+.3g}"
    return text if len(text) <= 7 else f"{value:+.1g}"


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    return cast("ImageFont.FreeTypeFont", ImageFont.load_default(size))  # of a size no other is
