"""`RecordViolations`: videos of the episodes that violate a requirement."""

from __future__ import annotations

import json
import math
import re
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from rtamt import InputError, Verdict
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.results.outcome import violated_by_end
from rtamt_gym.signals.periods import read_period
from rtamt_gym.wrappers.monitoring import check_pictures
from rtamt_gym.wrappers.overlay import monitor_inside

Keep = Literal["violation"] | Callable[[dict[str, Any]], bool]
"""Which episodes are kept."""


class RecordViolations(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Writes a video of every episode that violates a specification, when the episode has ended.

    Gymnasium's ``RecordVideo`` decides at the start of an episode. This wrapper renders every step
    and holds the newest :attr:`capacity` frames until the episode ends. The video of a violated
    episode starts ``before`` seconds before the sample that showed the violation and ends ``after``
    seconds after it; the video of another episode that ``keep`` chooses has its last frames. A
    :meth:`reset` or :meth:`close` ends a running episode.

    A video is an MP4, written with moviepy (the extra ``video``), as ``RecordVideo`` does. Its name
    has the prefix, the seed, the specification that was violated first and the number of the
    episode: ``violation-seed-3-upright-episode-7.mp4``. A JSON file next to it has

    * ``episode``: its number, from 0; ``seed``, ``resets``: the last seed of a reset, or null, and
      the number of resets after that one
    * ``violated_by``, ``violated_at``, ``sample``: the specification that was violated first, the
      time in seconds and the number of the sample that showed it; null if none was
    * ``robustness``, ``verdict``: of every specification, at the end; infinite values are ``"inf"``
      and ``"-inf"``
    * ``by_end``, if there are any: the specifications that the end alone violates
      (``at_termination="failure"``); ``of_instant``, with ``view="step"``: true, the robustness of
      the newest instant
    * ``ended``: ``"terminated"``, ``"truncated"``, ``"reset"`` or ``"closed"``
    * ``first_step``, ``frames``, ``fps``: the step after which the first frame was rendered (0 is
      the reset), the number of frames, and frames per second

    The environment needs a :class:`StlMonitor` or :class:`StlReward` inside, and
    ``render_mode="rgb_array"``. With a :class:`RobustnessOverlay` inside, frames have its panel.

    Attributes:
        capacity: The maximum number of frames in memory: a frame of 480 x 480 pixels takes 0.7 MB.
        videos: The paths of the videos.

    Change logs:
     * v0.5.0 - Initially added
    """

    def __init__(
        self,
        env: gym.Env[ObsType, ActType],
        video_folder: str,
        *,
        keep: Keep = "violation",
        before: float = 5.0,
        after: float = 1.0,
        name_prefix: str = "violation",
        fps: float | None = None,
    ) -> None:
        """Find the monitor inside, and make the folder.

        Args:
            env: The environment to apply the wrapper
            video_folder: The folder of the videos; a video of the same name is overwritten
            keep: ``"violation"`` keeps the episodes that end with a true ``stl_violated``; a
                function of the last info selects the episodes to keep, such as
                ``lambda info: info["robustness"] < 0.1``
            before: Seconds shown before the violation, 0 or more
            after: Seconds shown after it, 0 or more, as far as the episode goes on
            name_prefix: The start of the names
            fps: Frames per second of a video; ``None``: the environment's steps per second of its
                own time, or its ``render_fps`` if that is unknown

        Raises:
            InputError: If the environment lacks a monitor or does not render single pictures, or if
                an argument is wrong
            ModuleNotFoundError: If moviepy is not installed; names the extra
        """
        RecordConstructorArgs.__init__(
            self,
            video_folder=video_folder,
            keep=keep,
            before=before,
            after=after,
            name_prefix=name_prefix,
            fps=fps,
        )
        name = type(self).__name__
        self._monitor = monitor_inside(env, name)
        gym.Wrapper.__init__(self, env)
        check_pictures(env, name, lists=False)
        if keep != "violation" and not callable(keep):
            raise InputError(
                f'expected keep="violation" or a function of the last info, got {keep!r}'
            )
        rate = 1.0 / (self._period() or 1.0 / env.metadata.get("render_fps", 30))
        self._before = _frames("before", before, rate)
        self._after = _frames("after", after, rate)
        self._fps = rate if fps is None else check_number("fps", fps)
        try:
            import moviepy  # noqa: F401 - Gymnasium writes with it
        except ModuleNotFoundError as error:
            raise naming_extra(error, name) from error
        self._keep: Keep = keep
        self._prefix = name_prefix
        self._folder = Path(video_folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self.capacity = self._before + 1 + self._after
        self.videos: list[Path] = []
        self._frames: deque[NDArray[np.uint8]] = deque(maxlen=self.capacity)
        self._left: int | None = None  # frames to show after the violation; None before it
        self._info: dict[str, Any] | None = None  # the newest of a running episode
        self._steps = 0
        self._last = 0  # the step of the newest frame
        self._episode, self._resets = -1, 0
        self._seed: int | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsType, dict[str, Any]]:
        """Reset the environment; a running episode ends as it is."""
        self._finish("reset")
        obs, info = self.env.reset(seed=seed, options=options)
        self._frames.clear()
        self._left = None
        self._steps = 0
        self._episode += 1
        self._seed, self._resets = (self._seed, self._resets + 1) if seed is None else (seed, 0)
        self._store(info)
        return obs, info

    def step(self, action: ActType) -> tuple[ObsType, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment; write the video at the end of an episode that is kept."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        self._store(info)
        if terminated or truncated:
            self._finish("terminated" if terminated else "truncated")
        return obs, reward, terminated, truncated, info

    def close(self) -> None:
        """Close the environment; a running episode ends as it is."""
        self._finish("closed")
        super().close()

    def _period(self) -> float | None:
        """Return the seconds between two steps; with sub-steps the monitor has a shorter period."""
        period = read_period(self.env)
        if period is None and self._monitor.period is not None:
            return float(self._monitor.period)
        return period

    def _store(self, info: dict[str, Any]) -> None:
        """Store the newest frame, if the video may show it."""
        self._info = info
        if self._left is None or self._left > 0:
            self._frames.append(self.env.render())  # type: ignore[arg-type]  # checked: pictures
            self._last = self._steps
        if self._left is not None:
            self._left -= 1
        elif info["stl_violated"]:
            self._left = self._after
            while len(self._frames) > self._before + 1:
                self._frames.popleft()

    def _finish(self, ended: str) -> None:
        """Write the frames of the episode, if it is kept."""
        info, self._info = self._info, None
        if info is None:
            return
        if info["stl_violated"] if self._keep == "violation" else self._keep(info):
            self._write(ended)
        self._frames.clear()

    def _write(self, ended: str) -> None:
        from gymnasium.utils.save_video import save_video

        parts = [self._prefix]
        if self._seed is not None:
            parts.append(f"seed-{self._seed}")
        violation = self._monitor.first_violation
        if violation is not None:
            parts.append(re.sub(r"[^\w.-]+", "_", violation[0]))
        name = "-".join(parts)
        save_video(
            # moviepy 2 rounds the number of frames down and would lose the last, important frame.
            [*self._frames, self._frames[-1]],
            str(self._folder),
            lambda _: True,
            name_prefix=name,
            episode_index=self._episode,
            fps=self._fps,
        )
        path = self._folder / f"{name}-episode-{self._episode}.mp4"
        facts = {"episode": self._episode, "seed": self._seed, "resets": self._resets}
        facts |= self._outcome() | {
            "ended": ended,
            "first_step": self._last - len(self._frames) + 1,
            "frames": len(self._frames),
            "fps": self._fps,
        }
        path.with_suffix(".json").write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n")
        self.videos.append(path)

    def _outcome(self) -> dict[str, Any]:
        monitor = self._monitor
        violation, states = monitor.first_violation, monitor.describe()
        name, sample = violation or (None, None)
        of_instant = any(state.get("of_instant", False) for state in states.values())
        by_end = [
            spec
            for spec, state in states.items()
            if not of_instant and violated_by_end(Verdict[state["verdict"]], state["robustness"])
        ]
        time = None if sample is None or monitor.period is None else float(sample * monitor.period)
        return {
            "violated_by": name,
            "violated_at": time,
            "sample": sample,
            "robustness": {spec: _strict(state["robustness"]) for spec, state in states.items()},
            "verdict": {spec: state["verdict"] for spec, state in states.items()},
            **({"of_instant": True} if of_instant else {}),
            **({"by_end": by_end} if by_end else {}),
        }


def _frames(name: str, time: float, rate: float) -> int:
    """Return the number of frames in a time."""
    return 0 if time == 0 else round(check_number(name, time) * rate)


def _strict(value: float) -> float | str:
    """Return a number as strict JSON allows it."""
    return float(value) if math.isfinite(value) else str(float(value))
