"""Runs tasks in watched processes: a run may end its process or hang in it.

The worker of joblib that has the tasks watches the process: a thread on this machine, a process on
a cluster. Therefore a run that kills its process does not end a worker. `main` is the program of
such a process.
"""

from __future__ import annotations

import faulthandler
import os
import pickle
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe
from threading import Lock
from typing import Any, Final

from rtamt import InputError
from rtamt_gym.play.loop import Task
from rtamt_gym.recorded.progress import silence
from rtamt_gym.results.trial import Trial

_IDLE: Final = 60.0
"""Seconds without tasks after which a process ends by itself: workers of a cluster live on."""

_LOOK: Final = 0.5
"""Seconds between checks of a silent process: its children can keep the pipe open."""

_THREADS: Final = (
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""The environment variables that set how many threads libraries start."""


_EVERY: Final = 0.05
"""Seconds between messages with rows; if the process dies, later rows run again."""


@dataclass(frozen=True)
class Setup:
    """The data that a worker needs to run tasks of a campaign."""

    name: str
    recipe: bytes = field(repr=False)
    timeout: float | None
    threads: int
    path: tuple[str, ...] = ()
    above: Mapping[str, float] | None = None


def run_chunk(setup: Setup, tasks: Sequence[Task]) -> list[tuple[int, Trial]]:
    """Run tasks; return their rows with the task numbers.

    If a process dies, its unfinished tasks run again, each alone. A task whose process dies again
    has an error in its row.
    """
    rows: dict[int, Trial] = {}
    begin = time.monotonic()
    why = _deal(setup, tasks, rows)
    for task in tasks:
        number, case, seed = task
        if number in rows:
            continue
        if len(tasks) > 1 or not why.startswith("TimeoutError"):  # it has hung alone already
            begin = time.monotonic()
            why = _deal(setup, [task], rows)
        if number not in rows:
            wall = time.monotonic() - begin
            rows[number] = Trial(case, seed, {}, "error", 0.0, wall, why)
    return list(rows.items())


def end_processes(name: str) -> None:
    """End the processes of a campaign; no more are started."""
    with _lock:
        _over.add(name)
        idle = _idle.pop(name, [])
        busy = _all.pop(name, set()).difference(idle)
    for process in busy:  # the threads that watch them free them
        process.kill()
    for process in idle:
        process.end()


def _deal(setup: Setup, tasks: Sequence[Task], rows: dict[int, Trial]) -> str:
    """Let a process run tasks, and collect their rows; return why it ended, or an empty text."""
    process = _take(setup)
    try:
        process.connection.send(([task[1:] for task in tasks], setup.above))
        while True:
            if not process.speaks(setup.timeout):
                _drop(setup.name, process)
                return f"TimeoutError: the run was ended after timeout={setup.timeout:g} s"
            done, over = process.connection.recv()
            rows.update((tasks[index][0], row) for index, row in done)
            if over:
                break
    except (EOFError, OSError):
        ending = process.ending()
        _drop(setup.name, process)
        return f"ChildProcessError: the run ended its process {ending}, twice"
    except BaseException:
        _drop(setup.name, process)
        raise
    with _lock:
        if setup.name not in _over:
            _idle.setdefault(setup.name, []).append(process)
    return ""


class _Process:
    """A process that runs tasks, and the pipe to it."""

    def __init__(self, setup: Setup) -> None:
        self.connection, theirs = Pipe()
        alive, self._alive = os.pipe()  # nothing is written: it ends with this process
        passed = (theirs.fileno(), alive)
        path = list(dict.fromkeys([*setup.path, *sys.path]))
        code = (
            f"import sys; sys.path[:] = {path!r}\n"
            f"from rtamt_gym.play.workers import main; main{(*passed, _IDLE)!r}"
        )
        threads = dict.fromkeys(_THREADS, str(setup.threads))
        try:
            self._process = subprocess.Popen(  # noqa: S603 - our own code
                [sys.executable, "-c", code],
                stdin=subprocess.DEVNULL,
                env={**threads, **os.environ},
                pass_fds=passed,
                # This process handles Ctrl-C: it ends the other process and its children.
                start_new_session=True,
            )
        finally:
            theirs.close()
            os.close(alive)

    def speaks(self, timeout: float | None) -> bool:
        """Wait for a message or the end of the process; return False after the timeout."""
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = _LOOK if end is None else min(_LOOK, max(0.0, end - time.monotonic()))
            if self.connection.poll(left):
                return True
            if self._process.poll() is not None:
                if self.connection.poll():
                    return True
                raise EOFError
            if end is not None and time.monotonic() >= end:
                return False

    def start(self, recipe: bytes) -> None:
        """Wait until the process has made its runner; raise InputError if it cannot."""
        try:
            self.connection.send_bytes(recipe)
            self.speaks(None)
            refused = self.connection.recv()
        except (EOFError, OSError):
            refused = f"it ended {self.ending()}"
        if refused:
            raise InputError(
                f"another process cannot make the system: {refused}; give the id of a registered "
                "environment, or a function that can be imported or pickled"
            )

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def ending(self) -> str:
        """Describe how the process has ended."""
        with suppress(subprocess.TimeoutExpired):  # it has closed its pipe, and ends soon
            self._process.wait(1.0)
        self.kill()
        code = self._process.returncode
        return f"with exit status {code}" if code >= 0 else f"by {signal.Signals(-code).name}"

    def kill(self) -> None:
        """End the process and everything that it has started."""
        with suppress(ProcessLookupError, PermissionError):  # all have ended
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def free(self) -> None:
        """End the process, and close its pipes."""
        self.kill()
        self.connection.close()
        os.close(self._alive)

    def end(self) -> None:
        """End an idle process in the regular way, which closes its simulations."""
        with suppress(subprocess.TimeoutExpired, OSError):
            self.connection.send(([], None))
            self._process.wait(5.0)
        self.free()


_lock: Final = Lock()
_all: Final[dict[str, set[_Process]]] = {}
"""The processes of each campaign."""
_idle: Final[dict[str, list[_Process]]] = {}
"""The idle processes of each campaign."""
_over: Final[set[str]] = set()
"""The campaigns that start no more processes."""


def _take(setup: Setup) -> _Process:
    """Return an idle process of a campaign, or a new one."""
    with _lock:
        if setup.name in _over:
            raise InputError("the campaign is over")
        for name, waiting in _idle.items():
            for process in [item for item in waiting if item.ended]:
                waiting.remove(process)
                _all[name].discard(process)
                process.free()
        if _idle.get(setup.name):
            return _idle[setup.name].pop()
        process = _Process(setup)
        _all.setdefault(setup.name, set()).add(process)
    try:
        process.start(setup.recipe)
    except BaseException:
        _drop(setup.name, process)
        raise
    return process


def _drop(name: str, process: _Process) -> None:
    """End a process and forget it."""
    process.free()
    with _lock:
        _all.get(name, set()).discard(process)


class Making:
    """A mark of processes that create their runner, which may import modules of the user."""

    now = False


def main(pipe: int, alive: int, idle: float) -> None:
    """Run tasks until there are no more; ``pipe`` and ``alive`` are file descriptors."""
    _end_with(alive)
    faulthandler.enable()  # prints on stderr where a simulation crashed
    silence()
    connection = Connection(pipe)
    Making.now = True
    try:
        recipe: Any = pickle.loads(connection.recv_bytes())  # noqa: S301 - of our own parent
        runner = recipe.runner()
    except Exception as error:  # noqa: BLE001 - the parent raises it
        connection.send(f"{type(error).__name__}: {error}")
        return
    Making.now = False
    connection.send("")
    with closing(runner), suppress(EOFError):  # the pipe may end before `alive` does
        while connection.poll(idle):
            tasks, above = connection.recv()
            if not tasks:
                break
            cases, seeds = zip(*tasks, strict=True)
            own_seeds = None if seeds[0] is None else seeds  # of a system that takes seeds
            rows: list[Any] = []
            sent = time.monotonic()
            for over in runner.run(cases, own_seeds, above=above):
                rows.append(over)
                if (now := time.monotonic()) - sent >= _EVERY:
                    connection.send((rows, False))
                    rows, sent = [], now
            connection.send((rows, True))


def _end_with(alive: int) -> None:
    """End this process and its children as soon as its parent ends.

    The operating system sends a signal, because no Python code runs while a simulation hangs in C.
    """
    import fcntl

    signal.signal(signal.SIGIO, signal.SIG_DFL)
    fcntl.fcntl(alive, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(alive, fcntl.F_SETFL, fcntl.fcntl(alive, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([alive], [], [], 0)[0]:  # the parent has ended already
        sys.exit(1)
