"""The outputs of a view, a file and a viewer in its own process, and the samples that they get."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid
import warnings
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final, TypeVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_cli
from numpy.typing import NDArray

from rtamt import InputError, StateError, Verdict
from rtamt_gym.live.track import CURVES, HEAD, PackedPicture, Track, VerdictLine

_LEVELS: Final = {
    Verdict.VIOLATED: "ERROR",
    Verdict.UNDECIDED: "WARN",
    Verdict.SATISFIED: "INFO",
}

_PALETTE: Final = (
    *((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167)),
    *((213, 94, 0), (86, 180, 233), (140, 120, 20), (110, 110, 110)),
)
"""Okabe and Ito's colours, for signals."""

_COLOURS: Final = {
    "robustness": (0, 158, 115),
    "lower": (86, 180, 233),
    "upper": (230, 159, 0),
}

_Item = TypeVar("_Item")

_SHOWN: Final = 4
"""Tracks that the layout shows; others are in the list of entities."""


_WAITING_LINES: Final = 10_000
"""Verdicts that may wait for the viewer."""

_WAITING_BYTES: Final = 1 << 28
"""Bytes that may wait for the viewer."""

_PATIENCE: Final = 30.0
"""Seconds that the viewer may take to start."""

_GUARD: Final = """
import os, subprocess, sys, threading
viewer = subprocess.Popen(sys.argv[2:])
os.close(0)
def end():
    os.read(int(sys.argv[1]), 1)
    viewer.terminate()
threading.Thread(target=end, daemon=True).start()
sys.exit(viewer.wait())
"""
"""A program that runs the viewer, and ends it when the monitored program ends in any way: a pipe
between them closes then."""

APPLICATION: Final = "rtamt"


class FileOutput:
    """A ``.rrd`` file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        Path(path).write_bytes(b"")  # an error here, and not in a thread
        self.stream.save(path)

    def deliver(self, lines: int) -> None:
        """Write the content of the stream."""
        del lines
        self.stream.flush()

    def close(self) -> None:
        """Complete the file."""
        self.stream.flush()
        self.stream.disconnect()


class ViewerOutput:
    """The viewer of Rerun in a browser, which reads a pipe.

    A pipe shows how much data waits; a connection of Rerun blocks its sender when the viewer stops.
    """

    def __init__(self, ports: tuple[int, int] | None) -> None:
        page, data = map(checked_port, (0, 0) if ports is None else ports)
        self.stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        self._bytes = self.stream.binary_stream()
        self.address = (
            f"http://127.0.0.1:{page}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy"
        )
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115 - `close` closes it
        program = [
            *(viewer_program(), "--serve-web", "--bind", "127.0.0.1", "--port", str(data)),
            *("--web-viewer-port", str(page), "-"),
        ]
        lifeline, self._lifeline = os.pipe()
        self._process = subprocess.Popen(  # noqa: S603 - a program of rerun-sdk
            [sys.executable, "-I", "-S", "-c", _GUARD, str(lifeline), *program],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._messages,
            pass_fds=[lifeline],
            start_new_session=True,  # Ctrl-C ends the program, which ends the viewer
        )
        os.close(lifeline)
        assert self._process.stdin is not None  # noqa: S101 - for mypy
        self._pipe = self._process.stdin
        self._queue: SimpleQueue[tuple[bytes, int] | None] = SimpleQueue()
        self._lines = self._size = 0
        self._waiting = threading.Lock()
        self.detached = False
        self._begin(data, page)
        self._thread = threading.Thread(target=self._write, name="rtamt viewer", daemon=True)
        self._thread.start()

    def _begin(self, *ports: int) -> None:
        """Write the head of the recording, which the viewer needs first, and wait for its ports."""
        until = time.monotonic() + _PATIENCE
        with suppress(OSError):
            self._pipe.write(self._bytes.read(flush=True) or b"")
            self._pipe.flush()
        while self._process.poll() is None:
            try:
                for port in ports:
                    socket.create_connection(("127.0.0.1", port), 0.2).close()
            except OSError:
                if time.monotonic() > until:
                    os.killpg(self._process.pid, signal.SIGKILL)
                time.sleep(0.02)
            else:
                return
        self._messages.seek(0)
        text = self._messages.read().decode(errors="replace").strip().splitlines()
        self._release()
        raise StateError(
            f"the viewer of Rerun did not start, exit code {self._process.returncode}"
            f"{': ' if text else ''}{text[-1] if text else ''}"
        )

    def deliver(self, lines: int) -> None:
        """Pass on the content of the stream; detach the viewer if too much data waits."""
        block = self._bytes.read(flush=True)
        if self.detached or not block:
            return
        with self._waiting:
            overflows = self._lines > _WAITING_LINES or self._size > _WAITING_BYTES
            self._lines += lines
            self._size += len(block)
        if overflows or self._process.poll() is not None:
            self._detach("has ended" if self._process.poll() is not None else "is too far behind")
        else:
            self._queue.put((block, lines))

    def close(self) -> None:
        """Let the viewer read waiting data for two seconds, and end it."""
        self._queue.put(None)
        self._thread.join(0.0 if self.detached else 2.0)
        self._release()
        self._thread.join()
        self.stream.disconnect()

    def _release(self) -> None:
        """End the viewer, and with it the thread."""
        os.close(self._lifeline)
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        with suppress(OSError):  # waiting data has no reader
            self._pipe.close()
        self._messages.close()

    def _detach(self, why: str) -> None:
        self.detached = True
        self._queue.put(None)
        warnings.warn(
            f"the viewer of Rerun {why} and was detached; the run goes on", RuntimeWarning, 2
        )

    def _write(self) -> None:
        while (item := self._queue.get()) is not None:
            if self.detached:
                continue
            block, lines = item
            try:
                self._pipe.write(block)
                self._pipe.flush()
            except OSError:
                return  # `deliver` reports that the viewer has ended
            with self._waiting:
                self._lines -= lines
                self._size -= len(block)


def viewer_program() -> str:
    """Return the path of the viewer that rerun-sdk installs."""
    folder = Path(rerun_cli.__file__).parent
    names = ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun")
    paths = [folder / name for name in names if (folder / name).is_file()]
    if not paths:
        raise StateError(f"rerun-sdk has no viewer in {folder}; install it again")
    return str(paths[0])


def checked_port(port: int) -> int:
    """Return a port of 127.0.0.1, a free one for 0; raise InputError if it is in use."""
    with socket.socket() as tried:
        tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            tried.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"port {port} of 127.0.0.1: {error.strerror}") from None
        number: int = tried.getsockname()[1]
        return number


class Packer:
    """Makes columns of the samples of tracks, and sends them to outputs."""

    def __init__(self, outputs: Sequence[FileOutput | ViewerOutput]) -> None:
        self._outputs = outputs
        self._paths: dict[str, _Paths] = {}
        _warm_up()

    def send(self, tracks: Sequence[Track]) -> None:
        """Send all waiting samples."""
        if len(tracks) > len(self._paths):
            for track in tracks:
                if track.prefix not in self._paths:
                    self._paths[track.prefix] = paths = _Paths(track)
                    self._style(paths)
            layout = blueprint([*self._paths.values()])
            for output in self._outputs:
                output.stream.send_blueprint(layout)
        lines = sum(self._send(track, self._paths[track.prefix]) for track in tracks)
        for output in self._outputs:
            output.deliver(lines)

    def close(self) -> None:
        """Close the outputs."""
        for output in self._outputs:
            output.close()

    def _send(self, track: Track, paths: _Paths) -> int:
        """Send the waiting samples of a track; return the number of verdicts."""
        lines, frames, rows = taken(track.lines), taken(track.frames), taken(track.rows)
        if rows:
            table = np.array(rows, np.float64)
            indexes = _indexes(table[:, :HEAD])
            for path, column in zip(paths.columns, table[:, HEAD:].T, strict=True):
                self._columns(path, indexes, rr.Scalars.columns(scalars=column))
        by_name: dict[str, list[VerdictLine]] = {}
        for line in lines:
            by_name.setdefault(line.requirement, []).append(line)
        for name, some in by_name.items():
            self._columns(
                paths.verdicts[name],
                _indexes(np.array([line.place for line in some])),
                rr.TextLog.columns(
                    text=[paths.head + line.text for line in some],
                    level=[_LEVELS[line.verdict] for line in some],
                ),
            )
        if frames:
            self._pictures(paths.picture, frames)
        return len(lines)

    def _pictures(self, path: str, frames: Sequence[PackedPicture]) -> None:
        columns = rr.EncodedImage.columns(
            blob=[frame.picture for frame in frames], media_type=["image/jpeg"] * len(frames)
        )
        self._columns(path, _indexes(np.array([frame.place for frame in frames])), columns)

    def _columns(self, path: str, indexes: Sequence[Any], columns: Any) -> None:  # noqa: ANN401 - Rerun is not typed
        for output in self._outputs:
            output.stream.send_columns(path, indexes, columns)

    def _style(self, paths: _Paths) -> None:
        """Set the colours of the curves."""
        styles = [
            (path, _PALETTE[index % len(_PALETTE)], path.rsplit("/", 1)[1], 1.5)
            for index, path in enumerate(paths.signals)
        ]
        styles += [
            (path, _COLOURS[name], name, 2.5 if name == "robustness" else 1.0)
            for path, name in zip(paths.curves, paths.curve_names, strict=True)
        ]
        for path, colour, name, width in styles:
            lines = rr.SeriesLines(names=name, colors=[colour], widths=[width])
            for output in self._outputs:
                output.stream.log(path, lines, static=True)


class _Paths:
    """The entities of a track."""

    def __init__(self, track: Track) -> None:
        head = [track.prefix] if track.prefix else []
        self.root = rr.new_entity_path(head) if head else ""
        self.head = f"{track.prefix}: " if track.prefix else ""
        self.signals = [rr.new_entity_path([*head, "signals", name]) for name in track.signals]
        self.requirements = {
            name: rr.new_entity_path([*head, "requirements", name]) for name in track.requirements
        }
        self.curves = [f"{path}/{name}" for path in self.requirements.values() for name in CURVES]
        self.curve_names = [*CURVES] * len(self.requirements)
        self.columns = [*self.signals, *self.curves]
        self.verdicts = {name: f"{path}/verdict" for name, path in self.requirements.items()}
        self.has_pictures = track.has_pictures
        self.picture = rr.new_entity_path([*head, "picture"])


def blueprint(paths: Sequence[_Paths]) -> rrb.Blueprint:
    """Return the layout: curves next to picture and verdicts; several tracks get a column each."""
    columns = [rrb.encodings.TextLogColumn(kind) for kind in ("LogLevel", "Body")]
    log = rrb.TextLogView(
        name="verdicts", columns=rrb.TextLogColumns(text_log_columns=columns), contents="/**"
    )
    if len(paths) == 1:
        side = rrb.Vertical(*_pictures(paths[0]), log)
        views = rrb.Horizontal(rrb.Vertical(*_curves(paths[0])), side, column_shares=[4, 3])
    else:
        tracks = [rrb.Vertical(*_curves(track), *_pictures(track)) for track in paths[:_SHOWN]]
        views = rrb.Vertical(rrb.Horizontal(*tracks), log, row_shares=[3, 1])
    return rrb.Blueprint(views, collapse_panels=True)


def _curves(track: _Paths) -> list[rrb.TimeSeriesView]:
    """Return the views of signals and requirements."""
    origins = [("signals", f"{track.root}/signals"), *track.requirements.items()]
    return [rrb.TimeSeriesView(origin=path, name=f"{track.head}{name}") for name, path in origins]


def _pictures(track: _Paths) -> list[rrb.Spatial2DView]:
    """Return the view of pictures, if there are any."""
    if not track.has_pictures:
        return []
    return [rrb.Spatial2DView(origin=track.picture, name=f"{track.head}picture")]


def taken(items: deque[_Item]) -> list[_Item]:
    """Remove the present items of a deque and return them; another thread may append to it."""
    return [items.popleft() for _ in range(len(items))]


def _indexes(places: NDArray[np.float64]) -> list[Any]:
    """Return the timelines of samples: rows of sample, time and episode."""
    samples, times, episodes = places.T
    indexes = [
        rr.TimeColumn("sample", sequence=samples.astype(np.int64)),
        rr.TimeColumn("episode", sequence=episodes.astype(np.int64)),
    ]
    if not math.isnan(times[0]):
        nanoseconds = np.rint(times * 1e9).astype("timedelta64[ns]")
        indexes.insert(1, rr.TimeColumn("time", duration=nanoseconds))
    return indexes


def _warm_up() -> None:
    """Load the parts of Rerun that the first samples need."""
    stream = rr.RecordingStream(APPLICATION)
    pipe = stream.binary_stream()
    stream.send_blueprint(rrb.Blueprint(rrb.TextLogView()))
    indexes = _indexes(np.zeros((1, HEAD)))
    stream.send_columns("a", indexes, rr.Scalars.columns(scalars=[0.0]))
    stream.send_columns("b", indexes, rr.TextLog.columns(text=["a"], level=["INFO"]))
    pipe.read(flush=True)
    stream.disconnect()
