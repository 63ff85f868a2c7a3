"""`RobustnessOverlay`: what the monitors of an environment say, drawn on its frames."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any, SupportsFloat, get_args

import gymnasium as gym
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import RenderCollection

from rtamt import InputError, InputTypeError, Verdict
from rtamt.errors import nearest
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.results.outcome import violated_by_end
from rtamt_gym.wrappers.monitor import StlMonitor
from rtamt_gym.wrappers.monitoring import single_env
from rtamt_gym.wrappers.overlay_panel import Gauge, OverlayPanel, PanelPlace, Pixels, Sight

__all__ = ["RobustnessOverlay", "check_pictures", "monitor_inside"]

_PAST = 1024
"""How many samples of the past a curve can show: more than a panel has pixels for."""


class RobustnessOverlay(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Draws on the frames of :meth:`render` what the monitors inside say of the newest sample.

    The panel has the time, and what the verdicts say together; for every specification its name, a
    bar from 0 in the middle to the robustness, marks at the bounds of what that can still become,
    the number, and the verdict; for every signal its name, its value and the curve of its past.
    Nothing is told by colour alone: a negative bar is hatched and lies left of the middle, and
    every number has its sign.

    Bars have scales of their own: the next of 1, 2, 5, 10, ... above every finite robustness and
    bound that was shown, so that they only grow. An infinite value ends at the edge.

    Observations, actions, rewards and infos pass through unchanged. The environment needs a
    :class:`StlMonitor` or :class:`StlReward` inside, and renders pictures: ``render_mode`` is
    ``"rgb_array"``, or ``"rgb_array_list"``, where every frame shows its own sample. Wrappers that
    record, such as Gymnasium's ``RecordVideo`` and ``RenderCollection`` and our
    :class:`RecordViolations`, go around it. In a vector environment every environment is wrapped.

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
        """Finds the monitor inside.

        Args:
            env: The environment to apply the wrapper
            place: ``"below"`` adds the panel to the frame, which grows in height; ``"over"`` draws
                it over the lower part of the frame, translucent, with smaller letters if need be
            signals: The names of the signals to draw, ``()`` for none; ``None``: all

        Raises:
            InputError: If there is no monitor inside, if the environment renders no pictures, or if
                there is no signal of a name
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
                    f"signals= names {name!r}, which is no signal of the monitor; they are "
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
        """Resets the environment, and looks at sample 0."""
        result = self.env.reset(seed=seed, options=options)
        if self._clears:
            self._sights.clear()
        self._look()
        return result

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, dict[str, Any]]:
        """Steps through the environment, and looks at the new sample."""
        result = self.env.step(action)
        self._look()
        return result

    def render(self) -> Any:  # noqa: ANN401 - a frame, or a list of frames
        """The frames of the environment with the panel."""
        frames: Any = self.env.render()
        sights = list(self._sights)
        if not isinstance(frames, list):
            return self._drawn(frames, sights) if sights else frames
        # The last frame shows the newest sample.
        seen = [len(sights) - len(frames) + at + 1 for at in range(len(frames))]
        return [
            self._drawn(frame, sights[max(at - _PAST, 0) : at]) if at > 0 else frame
            for frame, at in zip(frames, seen, strict=True)
        ]

    def _drawn(self, frame: Pixels, sights: Sequence[Sight]) -> Pixels:
        height, width = frame.shape[:2]
        if self._panel is None or self._panel[0] != (height, width):
            specs = list(self._scales)
            panel = OverlayPanel(specs, self._shown, width, height, self._place)
            self._panel = (height, width), panel
        begun = max(at for at, sight in enumerate(sights) if at == 0 or sight.sample == 0)
        return self._panel[1].draw(frame, sights[begun:])

    def _look(self) -> None:
        """Keeps what is to be shown of the newest sample."""
        monitor, gauges, of_instant = self._monitor, [], False
        for name, state in monitor.describe().items():
            robustness, lower, upper = state["robustness"], state["lower"], state["upper"]
            sizes = [abs(each) for each in (robustness, lower, upper) if math.isfinite(each)]
            if (most := max(sizes, default=0.0)) > self._scales[name]:
                self._scales[name] = _rounded(most)
            scale = self._scales[name] or 1.0
            verdict, of_instant = state["verdict"], state.get("of_instant", False)
            by_end = not of_instant and violated_by_end(Verdict[verdict], robustness)
            gauges.append(Gauge(robustness, lower, upper, verdict, scale, by_end))
        values = tuple(self._newest[name] for name in self._shown)
        sample = monitor.samples - 1
        time = self._time(sample) + ", robustness of the instant" * of_instant
        self._sights.append(Sight(sample, time, tuple(gauges), values))

    def _time(self, sample: int) -> str:
        period = self._monitor.period
        if period is None:
            return f"sample {sample}"
        return f"{float(sample * period):.{_decimals(float(period))}f} s"


def monitor_inside(env: gym.Env[Any, Any], name: str) -> StlMonitor[Any, Any]:
    """Finds the monitor inside of an environment.

    Args:
        env: The environment.
        name: The wrapper that needs it, for the message.

    Raises:
        InputTypeError: If it is no environment of Gymnasium, or many.
        InputError: If there is none.
    """
    if isinstance(env, VectorEnv):
        raise InputTypeError(
            f"expected one environment for {name}, got {env}; wrap each one: "
            "gym.make_vec(..., vectorization_mode='sync', wrappers=[...])"
        )
    within = single_env(env)
    while isinstance(within, gym.Wrapper):
        if isinstance(within, StlMonitor):
            return within
        within = within.env
    raise InputError(
        f"{name} shows what a StlMonitor or a StlReward inside of it says, got none in {env}; "
        f'wrap the environment first: {name}(StlMonitor(env, "always(x > 0)", {{"x": "obs[0]"}}))'
    )


def check_pictures(env: gym.Env[Any, Any], name: str, *, lists: bool = True) -> None:
    """Refuses an environment that renders no pictures.

    Args:
        env: The environment.
        name: The wrapper that needs them, for the message.
        lists: Whether it may render lists of them.

    Raises:
        InputError: If it renders none.
    """
    if env.render_mode != "rgb_array" and not (lists and env.render_mode == "rgb_array_list"):
        raise InputError(
            f"{name} needs pictures, got render_mode={env.render_mode!r} of {env}; make it with "
            'gym.make(..., render_mode="rgb_array")'
        )


def _clears_at_reset(env: gym.Env[Any, Any]) -> bool:
    """Whether the frames of an environment are forgotten when it is reset."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, RenderCollection):
            return env.reset_clean
        env = env.env
    return True


def _rounded(size: float) -> float:
    """The next of ..., 0.5, 1, 2, 5, 10, ... that is not below a size.

    Example:
        >>> _rounded(0.209), _rounded(1.0), _rounded(37.0)
        (0.5, 1.0, 50.0)
    """
    power = 10.0 ** math.floor(math.log10(size))
    return next(round(step * power, 12) for step in (1, 2, 5, 10) if step * power >= size)


def _decimals(period: float) -> int:
    """How many decimals tell the times of two samples apart: at most 4."""
    return next((n for n in range(4) if period * 10**n >= 1.0 - 1e-9), 4)
