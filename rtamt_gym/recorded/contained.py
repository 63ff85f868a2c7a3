"""Files that another process reads, so that a library that crashes or hangs ends only that process.

The process protects against damaged files. It is not a sandbox, because it has the rights of this
process. It reads many files in turn, and returns only the wanted columns.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from pathlib import Path
from threading import Lock, Timer
from typing import Any, Final

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import file_of
from rtamt_gym.recorded.progress import silence
from rtamt_gym.recorded.recording import Recording, Rows, Wanted

LIMIT: Final = 60.0
"""The seconds that a file may take, and one more for each megabyte."""


@contextmanager
def open_file(module: str, path: str, columns: Columns) -> Iterator[Recording]:
    """Open a file of recorded values in another process."""
    limit = _limit(path)
    with _taken() as process:
        names, dates = process.ask(("open", Path.cwd(), module, path, columns), path, limit)
        try:
            yield _Contained(process, path, names, dates, limit)
        finally:
            process.tell(("close",))


def call(module: str, function: str, path: str) -> Any:  # noqa: ANN401 - of any function
    """Call a function of a module for a file in another process, and return the result."""
    with _taken() as process:
        return process.ask(("call", Path.cwd(), module, path, function), path, _limit(path))


def _limit(path: str) -> float:
    """Return the time limit of a file in seconds."""
    file = Path(file_of(path))
    return LIMIT + (file.stat().st_size if file.exists() else 0) / 1e6


class _Contained(Recording):
    """A recording that another process has opened."""

    def __init__(
        self, process: _Process, path: str, names: Sequence[str], dates: Sequence[str], limit: float
    ) -> None:
        self.source = shown(path)
        self.names = names
        self.dates = dates
        self._process, self._path, self._limit = process, path, limit

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns."""
        rows: Rows = self._process.ask(("read", wanted), self._path, self._limit)
        return rows


class _Process:
    """A process that reads files, and the pipes to it.

    It imports the same modules as this process, and no modules from the working directory. Its
    standard input ends whenever this process ends.
    """

    def __init__(self) -> None:
        self.owner = os.getpid()
        modules: dict[str, object] = {**sys.modules}
        absent = [name for name, module in modules.items() if module is None]
        code = (
            f"import sys; sys.path[:] = {sys.path!r}; sys.modules |= dict.fromkeys({absent!r})\n"
            "from rtamt_gym.recorded.contained import serve; serve()"
        )
        self._process = subprocess.Popen(  # noqa: S603 - our own code
            [sys.executable, "-P", "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def ask(self, request: object, path: str, limit: float) -> Any:  # noqa: ANN401
        """Return the answer of the process."""
        late: list[bool] = []

        def end() -> None:
            late.append(True)
            self._process.kill()

        watch = Timer(limit, end)
        watch.daemon = True
        watch.start()
        try:
            self.tell(request)
            fine, answer = pickle.load(self._process.stdout)  # type: ignore[arg-type]  # noqa: S301 - of our own process
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            ending = self._ending()
            if late:
                ending = f"took more than {limit:.0f} s"
            raise InputError(
                f"{shown(path)}: expected a whole file, but its reader {ending}"
            ) from None
        except BaseException:  # an interrupt leaves an unread answer
            self.end()
            raise
        finally:
            watch.cancel()
        if fine:
            return answer
        raise answer

    def tell(self, request: object) -> None:
        """Send a request without an answer; a process that has ended ignores it."""
        with suppress(OSError, ValueError):
            pickle.dump(request, self._process.stdin)  # type: ignore[arg-type]
            self._process.stdin.flush()  # type: ignore[union-attr]

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]

    def _ending(self) -> str:
        self.end()
        code = self._process.returncode
        if code >= 0:
            return f"ended with exit status {code}"
        name = signal.Signals(-code).name
        memory = ", perhaps for lack of memory" if name == "SIGKILL" else ""
        return f"crashed by {name}{memory}"


_lock: Final = Lock()
_idle: Final[list[_Process]] = []


@contextmanager
def _taken() -> Iterator[_Process]:
    """Reserve an idle process, or start one."""
    with _lock:
        # After a fork, processes of the parent do not belong to this one.
        own = [idle for idle in _idle if idle.owner == os.getpid() and not idle.ended]
        _idle[:] = own[:-1]
    process = own[-1] if own else _Process()
    try:
        yield process
    finally:
        if process.ended:
            process.end()
        else:
            with _lock:
                _idle.append(process)


@atexit.register
def _end_idle() -> None:
    for process in _idle:
        if process.owner == os.getpid():
            process.end()
    _idle.clear()


def serve() -> None:
    """Answer requests until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the parent handles Ctrl-C
    silence()
    requests = sys.stdin.buffer
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keep the output of libraries out of the answers
    with ExitStack() as opened:
        recording: Recording | None = None
        while True:
            try:
                request = pickle.load(requests)  # noqa: S301 - of the process that has started us
            except EOFError:
                return
            if request[0] == "close":
                recording = None
                opened.close()
                continue
            try:
                if request[0] in ("open", "call"):
                    _, folder, module, path, columns = request
                    os.chdir(folder)  # a path may be relative
                if request[0] == "call":
                    answer: Any = getattr(import_module(module), columns)(path)
                elif request[0] == "open":
                    recording = opened.enter_context(import_module(module).open_file(path, columns))
                    answer = [*recording.names], [*recording.dates]
                else:
                    answer = recording.read(request[1])  # type: ignore[union-attr]  # it was opened
            except Exception as error:  # noqa: BLE001 - the process that has asked raises it
                pickle.dump((False, _portable(error)), replies)
            else:
                pickle.dump((True, answer), replies, protocol=pickle.HIGHEST_PROTOCOL)
            replies.flush()


def _portable(error: Exception) -> Exception:
    """Return the error, or a RuntimeError with its text if it cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 - what was dumped
    except Exception:  # noqa: BLE001 - whatever an error of a library raises
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
