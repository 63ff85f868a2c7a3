"""`RerunView`: a view of monitored runs in Rerun, while they run or in a file."""

from __future__ import annotations

import atexit
import os
import sys
import threading
from collections.abc import Collection, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, NoReturn, Self

from rtamt import InputError, StateError
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.live.track import Track

_PAUSE: Final = 0.05
"""Seconds between two deliveries."""


class RerunView:
    """A view of monitored runs in Rerun: in a browser while they run, as a ``.rrd`` file, or both.

    Pass it as ``live=`` to `StlMonitor`, `VectorStlMonitor`, `StepMonitor` or `simulate`. It shows
    the signals, robustness and bounds of each requirement, a log of verdicts, and pictures. A
    thread sends new samples every 50 ms: the monitored program never waits for the view. If 10,000
    verdicts wait for the viewer, the viewer is detached with a warning; the file holds all.

    The newest sample of an episode is sent with the next one, or at the end of the episode, because
    the end may change its bounds. Copies of a monitor have no view. The page *Live view,
    pictures and videos* describes the entities and timelines. It needs ``rerun-sdk``, the extra
    ``rerun``.

    Args:
        path: The ``.rrd`` file to write. Default: none.
        viewer: Whether to start a viewer. Default: only without ``path``.
        pictures: Take a rendered picture every so many samples, 1 or more. Default: no pictures.
        environments: The environments of a `VectorStlMonitor` to show, from 0.
        ports: The ports of the viewer on 127.0.0.1: of the page, and of the data. Default: two
            free ports.

    Attributes:
        address: The address of the page; None without a viewer.

    Raises:
        InputError: If the file does not end in ``.rrd``, a number is out of range, or a port is in
            use.
        StateError: If the viewer does not start.
        ModuleNotFoundError: If rerun-sdk is not installed.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import StlMonitor
        >>> from rtamt_gym.live import RerunView
        >>> with RerunView("cart.rrd") as view:
        ...     env = gym.make("CartPole-v1")
        ...     env = StlMonitor(env, "always(abs(a) < 0.1)", {"a": "obs[2]"}, live=view)
        ...     _, info = env.reset(seed=123)
        ...     while not info["stl_violated"]:
        ...         *_, info = env.step(1)
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        viewer: bool | None = None,
        pictures: int | None = None,
        environments: Collection[int] = (0,),
        ports: tuple[int, int] | None = None,
    ) -> None:
        if path is not None and Path(path).suffix != ".rrd":
            raise InputError(f"RerunView writes .rrd files, got {os.fspath(path)!r}")
        viewer = path is None if viewer is None else viewer
        if path is None and not viewer:
            raise InputError("RerunView shows nothing without a file and with viewer=False")
        if pictures is not None and pictures < 1:
            raise InputError(f"pictures= is a number of samples, 1 or more, got {pictures!r}")
        self.pictures = pictures
        self.environments = tuple(environments)
        try:
            from rtamt_gym.live.outputs import FileOutput, Packer, ViewerOutput
        except ModuleNotFoundError as error:
            raise naming_extra(error, "RerunView", "rerun") from error
        self.address: str | None = None
        outputs: list[FileOutput | ViewerOutput] = []
        if viewer:
            output = ViewerOutput(ports)
            self.address = output.address
            outputs.append(output)
        if path is not None:
            outputs.append(FileOutput(path))
        self._packer = Packer(outputs)
        self._tracks: dict[str, Track] = {}
        self._process = os.getpid()
        self._sending = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rtamt view", daemon=True)
        self._thread.start()
        atexit.register(self.close)
        if self.address is not None:
            print(f"live view: {self.address}", file=sys.stderr)  # noqa: T201 - to open it

    def track(
        self,
        signals: Sequence[str],
        requirements: Sequence[str],
        period: float | None,
        prefix: str = "",
    ) -> Track:
        """Return the track of a trace; the track of an earlier trace with equal names continues.

        Raises:
            InputError: If the view has a track of other names.
            StateError: If the view is closed, or belongs to another process.
        """
        if self._over.is_set():
            raise StateError("expected an open view, got a closed one; make another RerunView")
        if os.getpid() != self._process:
            raise StateError(
                "expected a view of this process, got a view of another process. Give live= to "
                "VectorStlMonitor instead of monitors in processes"
            )
        names = tuple(signals), tuple(requirements), period
        track = self._tracks.get(prefix)
        if track is None:
            track = Track(prefix, *names, self.send)
            self._tracks[prefix] = track
        elif (track.signals, track.requirements, track.period) != names:
            raise InputError(
                f"live= shows {', '.join(track.requirements)} of {', '.join(track.signals)} "
                f"already, got {', '.join(names[1])} of {', '.join(names[0])} with a period of "
                f"{period}; make another RerunView"
            )
        return track

    def send(self) -> None:
        """Send all samples, except the newest of a running episode."""
        with self._sending:
            self._packer.send([*self._tracks.values()])

    def close(self) -> None:
        """Send everything, end the viewer and complete the file; once."""
        if self._over.is_set() or os.getpid() != self._process:
            return
        atexit.unregister(self.close)
        self._over.set()
        self._thread.join()
        for track in self._tracks.values():
            track.begin()
        self.send()
        self._packer.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a RerunView cannot be copied: it has a thread and a viewer. Give live= to "
            "VectorStlMonitor instead of monitors in processes"
        )

    def _run(self) -> None:
        while not self._over.wait(_PAUSE):
            self.send()
