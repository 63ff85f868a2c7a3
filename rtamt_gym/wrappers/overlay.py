"""`RobustnessOverlay`: robustness, verdicts and signals of a monitor, drawn on frames.

Pillow draws the panel in 1 to 2 ms, a fifth of the time of Matplotlib. Nothing depends on colour
alone: a negative bar lies left of the line in the middle and is hatched, and every number has its
sign.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from functools import cache
from typing import Any, Literal, NamedTuple, SupportsFloat, cast, get_args

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import RenderCollection
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rtamt import InputError, InputTypeError, Verdict
from rtamt.errors import nearest
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.results.outcome import violated_by_end
from rtamt_gym.wrappers.monitor import StlMonitor, monitor_of, single_env
from rtamt_gym.wrappers.monitoring import check_pictures

Pixels = NDArray[np.uint8]
"""A picture, of shape (height, width, 3)."""

PanelPlace = Literal["below", "over"]
"""Where the panel is: below the picture, which grows, or over its lower part."""

_PAST = 1024
"""The number of past samples for curves: more than a panel has pixels for."""


class RobustnessOverlay(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Draws the state of the monitors inside on the frames of :meth:`render`.

    The panel shows the time and the worst verdict; for every specification its name, a bar from 0
    in the middle to the robustness, marks at its bounds, the number, and the verdict; for every
    signal its name, its value and the curve of its past. A negative bar is hatched and lies left of
    the middle.

    The scale of a bar is the next of 1, 2, 5, 10, ... above every finite robustness and bound so
    far, so it only grows. An infinite value ends at the edge.

    Observations, actions, rewards and infos do not change. The environment needs a
    :class:`StlMonitor` or :class:`StlReward` inside, and ``render_mode="rgb_array"`` or
    ``"rgb_array_list"``, where every frame shows its own sample. Wrappers that record, such as
    Gymnasium's ``RecordVideo`` and ``RenderCollection`` and our :class:`RecordViolations`, go
    around it. In a vector environment, wrap every environment.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import RobustnessOverlay, StlMonitor
        >>> env = gym.make("CartPole-v1", render_mode="rgb_array")
        >>> env = StlMonitor(env, "always(abs(angle) < 0.1)", {"angle": "obs[2]"})
        >>> env = RobustnessOverlay(env)
        >>> _ = env.reset(seed=123)
        >>> env.render().shape
        (470, 600, 3)

    Change logs:
     * v0.5.0 - Initially added
    """

    def __init__(
        self,
        env: gym.Env[ObsType, ActType],
        *,
        place: PanelPlace = "below",
        signals: Sequence[str] | None = None,
    ) -> None:
        """Find the monitor inside.

        Args:
            env: The environment to apply the wrapper
            place: ``"below"`` adds the panel to the frame, which grows in height; ``"over"`` draws
                it over the lower part of the frame, translucent, with smaller letters if necessary
            signals: The names of the signals to draw, ``()`` for none; ``None``: all

        Raises:
            InputError: If the environment lacks a monitor or does not render pictures, or if a
                signal is unknown
        """
        RecordConstructorArgs.__init__(self, place=place, signals=signals)
        self._monitor = monitor_inside(env, type(self).__name__)
        gym.Wrapper.__init__(self, env)
        check_choice("place", place, get_args(PanelPlace))
        check_pictures(env, type(self).__name__)
        known = self._monitor.signal_names
        if isinstance(signals, str):
            raise InputTypeError(
                f'expected signals= as a sequence of names, got {signals!r}; such as ["{signals}"]'
            )
        for name in () if signals is None else signals:
            if name not in known:
                raise InputError(
                    f"signals= names an unknown signal {name!r}; the signals of the monitor are "
                    f"{listing(known)}{nearest(name, known)}"
                )
        self._place: PanelPlace = place
        self._shown = tuple(known if signals is None else signals)
        self._newest = self._monitor.newest_signals()
        self._scales = dict.fromkeys(self._monitor.monitors, 0.0)
        self._lists, self._clears = str(env.render_mode).endswith("_list"), _clears_at_reset(env)
        self._sights: deque[Sight] = deque(maxlen=None if self._lists else _PAST)
        self._panel: tuple[tuple[int, int], OverlayPanel] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsType, dict[str, Any]]:
        """Reset the environment, and record sample 0."""
        result = self.env.reset(seed=seed, options=options)
        if self._clears:
            self._sights.clear()
        self._record()
        return result

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment, and record the new sample."""
        result = self.env.step(action)
        self._record()
        return result

    def render(self) -> Any:
        """Return the frames of the environment with the panel."""
        frames: Any = self.env.render()
        sights = list(self._sights)
        if not isinstance(frames, list):
            return self._drawn(frames, sights) if sights else frames
        # The last frame shows the newest sample.
        counts = [len(sights) - len(frames) + index + 1 for index in range(len(frames))]
        return [
            self._drawn(frame, sights[max(count - _PAST, 0) : count]) if count > 0 else frame
            for frame, count in zip(frames, counts, strict=True)
        ]

    def _drawn(self, frame: Pixels, sights: Sequence[Sight]) -> Pixels:
        height, width = frame.shape[:2]
        if self._panel is None or self._panel[0] != (height, width):
            specs = list(self._scales)
            panel = OverlayPanel(specs, self._shown, width, height, self._place)
            self._panel = (height, width), panel
        start = max(index for index, sight in enumerate(sights) if index == 0 or sight.sample == 0)
        return self._panel[1].draw(frame, sights[start:])

    def _record(self) -> None:
        """Record the newest sample."""
        monitor, gauges, of_instant = self._monitor, [], False
        for name, state in monitor.describe().items():
            robustness, lower, upper = state["robustness"], state["lower"], state["upper"]
            sizes = [abs(number) for number in (robustness, lower, upper) if math.isfinite(number)]
            if (most := max(sizes, default=0.0)) > self._scales[name]:
                self._scales[name] = _rounded(most)
            scale = self._scales[name] or 1.0
            verdict, of_instant = state["verdict"], state.get("of_instant", False)
            by_end = not of_instant and violated_by_end(Verdict[verdict], robustness)
            gauges.append(Gauge(robustness, lower, upper, verdict, scale, by_end))
        values = tuple(self._newest[name] for name in self._shown)
        sample, period = monitor.samples - 1, monitor.period
        time = f"sample {sample}"
        if period is not None:
            time = f"{float(sample * period):.{_decimals(float(period))}f} s"
        time += ", robustness of the instant" * of_instant
        self._sights.append(Sight(sample, time, tuple(gauges), values))


def monitor_inside(env: gym.Env[Any, Any], name: str) -> StlMonitor[Any, Any]:
    """Return the monitor inside an environment, or raise an error of the wrapper ``name``."""
    if isinstance(env, VectorEnv):
        raise InputTypeError(
            f"expected one environment for {name}, got {env}; wrap each one: "
            "gym.make_vec(..., vectorization_mode='sync', wrappers=[...])"
        )
    monitor = monitor_of(single_env(env))
    if monitor is not None:
        return monitor
    raise InputError(
        f"{name} needs an StlMonitor or StlReward inside of it, got none in {env}; "
        f'wrap the environment first: {name}(StlMonitor(env, "always(x > 0)", {{"x": "obs[0]"}}))'
    )


def _clears_at_reset(env: gym.Env[Any, Any]) -> bool:
    """Whether a reset of an environment clears its frames."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, RenderCollection):
            return env.reset_clean
        env = env.env
    return True


def _rounded(size: float) -> float:
    """Return the next of ..., 0.5, 1, 2, 5, 10, ... that is at least the size."""
    power = 10.0 ** math.floor(math.log10(size))
    return next(round(step * power, 12) for step in (1, 2, 5, 10) if step * power >= size)


def _decimals(period: float) -> int:
    """Return the number of decimals that distinguish the times of two samples: at most 4."""
    return next((n for n in range(4) if period * 10**n >= 1.0 - 1e-9), 4)


_GROUND = (24, 26, 30)
_WHITE = (240, 240, 240)
_GREY = (165, 170, 175)
_FAINT = (105, 110, 115)
# Okabe and Ito's colours, which colour-blind readers can distinguish, lighter on the dark ground.
_HOLDS = (0, 178, 130)
_VIOLATES = (235, 110, 40)
_BOUNDS = (155, 208, 240)
_VERDICTS = {"SATISFIED": _HOLDS, "VIOLATED": _VIOLATES}
_CLEAR = 5
"""A panel over a picture shows a fifth of the light of the picture."""


class Gauge(NamedTuple):
    """The state of a specification, if the episode ended now.

    ``scale`` is the robustness at the right end of the bar; ``by_end``: the end alone violates it.
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
    """The state of all monitors and the value of every signal at one sample of an episode."""

    sample: int
    time: str
    gauges: tuple[Gauge, ...]
    values: tuple[float, ...]


class OverlayPanel:
    """Draws panels on frames of one size, in pixels."""

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
        self.height += (height + self.height) % 2  # video encoders need an even height
        if place == "over":
            self.height = min(self.height, height)

    def draw(self, frame: Pixels, sights: Sequence[Sight]) -> Pixels:
        """Return the frame with the panel of the last sample; the others are its past."""
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
        if names + verdicts > 0.75 * self._width:  # too narrow for numbers next to verdicts
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
        for index, name in enumerate(self._signals):
            y += self._row if index % self._columns == 0 else 0
            x = left + cell * (index % self._columns)
            self._text(draw, x, y, self._fitted(name, names), _GREY)
            values = [sight.values[index] for sight in sights[-int(cell) :]]
            self._curve(draw, x + names, y, cell - names - 2 * gap, values)

    def _bar(
        self, draw: ImageDraw.ImageDraw, box: tuple[float, float, float, float], gauge: Gauge
    ) -> None:
        """Draw a bar from 0 in the middle to the robustness, between marks at the bounds."""
        x0, y0, x1, y1 = box
        top, bottom, middle = y0 + 0.22 * self._row, y1 - 0.22 * self._row, (x0 + x1) / 2

        def x_of(value: float) -> float:
            share = min(max(value / gauge.scale, -1.0), 1.0)
            return middle + share * (x1 - x0) / 2

        draw.rectangle((x0, top, x1, bottom), outline=_FAINT)
        holds = math.copysign(1.0, gauge.robustness) > 0.0
        ends = sorted((middle, x_of(gauge.robustness)))
        draw.rectangle((ends[0], top, ends[1], bottom), fill=_HOLDS if holds else _VIOLATES)
        if not holds:
            for left in range(math.ceil(ends[0]), math.floor(ends[1]), 5):
                draw.line((left, bottom, min(left + 3, ends[1]), top), fill=_GROUND)
        low, high, centre = x_of(gauge.lower), x_of(gauge.upper), (top + bottom) / 2
        draw.line((low, centre, high, centre), fill=_BOUNDS)
        reach = (y1 - y0) * 0.36
        for x in (low, high):
            draw.line((x, centre - reach, x, centre + reach), fill=_BOUNDS, width=2)
        draw.line((middle, y0 + 1, middle, y1 - 1), fill=_WHITE)

    def _curve(
        self, draw: ImageDraw.ImageDraw, x: float, y: float, width: float, values: Sequence[float]
    ) -> None:
        """Draw the last value, and the curve of as many values as there are pixels."""
        number = self._gap + self._font.getlength("-0.00000")
        self._text(draw, x + number, y, _number(values[-1]), _WHITE, "r")
        left, room = x + number + self._gap, width - number - self._gap
        recent = list(enumerate(values[-max(int(room), 2) :]))
        finite = [value for _, value in recent if math.isfinite(value)]
        if len(finite) < 2:
            return
        low, high = min(finite), max(finite)
        span, tall = (high - low) or 1.0, 0.7 * self._row
        base = y + (0.85 if high > low else 0.5) * self._row
        step = min(room / (len(recent) - 1), 4.0)
        line = [
            (left + step * sample, base - tall * (value - low) / span)
            for sample, value in recent
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
        """Return the text, with its middle cut out if it is wider."""
        cut, length = text, len(text)
        while length > 2 and self._font.getlength(cut) > width + 1.0:
            length -= 1
            cut = f"{text[: length - length // 2]}..{text[-(length // 2) :]}"
        return cut


def _summary(gauges: Sequence[Gauge]) -> str:
    """Return the worst verdict, and the number of specifications that have it."""
    verdicts = [gauge.verdict for gauge in gauges]
    for verdict in ("VIOLATED", "UNDECIDED"):
        count = verdicts.count(verdict)
        if count:
            return f"{verdict} {count} of {len(verdicts)}" if len(verdicts) > 1 else verdict
    return "SATISFIED"


def _number(value: float) -> str:
    """Return a number in at most 7 characters, with its sign."""
    text = f"{value:+.3g}"
    return text if len(text) <= 7 else f"{value:+.1g}"


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    return cast("ImageFont.FreeTypeFont", ImageFont.load_default(size))
