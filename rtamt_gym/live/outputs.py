"""The outputs of a view: a file, and a viewer in a process of its own."""

from __future__ import annotations

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
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Final

import rerun as rr
import rerun_cli

from rtamt import InputError, StateError

_WAITING_LINES: Final = 10_000
"""Verdicts that may wait for the viewer."""

_WAITING_BYTES: Final = 1 << 28
"""Bytes that may wait for the viewer."""

_PATIENCE: Final = 30.0
"""Seconds in which the viewer must start."""

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
"""A program that runs the viewer and ends it with the program that writes to it, however that
ends: it reads a pipe that is closed then."""

APPLICATION: Final = "rtamt"


class FileOutput:
    """A ``.rrd`` file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        Path(path).write_bytes(b"")  # an error here, and not in a thread
        self.stream.save(path)

    def deliver(self, lines: int) -> None:
        """Write what was sent to the stream."""
        del lines
        self.stream.flush()

    def close(self) -> None:
        """Complete the file."""
        self.stream.flush()
        self.stream.disconnect()


class ViewerOutput:
    """The viewer of Rerun in a browser, which reads a pipe.

    A pipe shows how much waits: a connection of Rerun blocks its sender when the viewer stops.

    Args:
        ports: The ports of the page and of the data; None: free ports.

    Attributes:
        address: The address of the page.

    Raises:
        StateError: If the viewer does not start.
    """

    def __init__(self, ports: tuple[int, int] | None) -> None:
        page, data = (free_port(), free_port()) if ports is None else map(checked_port, ports)
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
        """Write the head of the recording, for which the viewer waits, and wait for its ports."""
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
        """Pass on what was sent to the stream; detach the viewer if too much waits.

        Args:
            lines: The verdicts in it.
        """
        block = self._bytes.read(flush=True)
        if self.detached or not block:
            return
        with self._waiting:
            behind = self._lines > _WAITING_LINES or self._size > _WAITING_BYTES
            self._lines += lines
            self._size += len(block)
        if behind or self._process.poll() is not None:
            self._detach("has ended" if self._process.poll() is not None else "is too far behind")
        else:
            self._queue.put((block, lines))

    def close(self) -> None:
        """Let the viewer read what waits for a moment, and end it."""
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
        with suppress(OSError):  # what waits has no reader
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
    found = [folder / name for name in names if (folder / name).is_file()]
    if not found:
        raise StateError(f"rerun-sdk has no viewer in {folder}; install it again")
    return str(found[0])


def free_port() -> int:
    """Return a free port of 127.0.0.1."""
    return checked_port(0)


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
