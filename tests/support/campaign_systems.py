"""Systems of campaigns: a tank, and runs that end their process, hang, or record their start."""

from __future__ import annotations

import ctypes
import math
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Self

from rtamt_gym import Runner
from rtamt_gym.play.runner import CaseLike

__all__ = ["Alive", "noted", "program", "tank", "tank_runner", "tank_tasks", "troubled"]

System = Callable[..., Iterator[dict[str, float]]]
Tasks = list[tuple[CaseLike, int | None]]


def rest(seconds: float) -> None:
    """Wait without using the processor."""
    Event().wait(seconds)


def tank(inflow: float) -> Iterator[dict[str, float]]:
    """A tank that overflows from some inflow on."""
    level = 1.0
    for _ in range(20):
        yield {"level": level}
        level += inflow - 0.1 * level


def tank_runner(system: object = tank) -> Runner:
    """Return a runner of a tank, or of another system with a level."""
    return Runner(system, {"dry": "always(level < 2)"}, period=1, stop="violation")


def tank_tasks(count: int) -> Tasks:
    """Return inflows from a drop on."""
    return [({"inflow": (1 + i) / count}, None) for i in range(count)]


def troubled(folder: Path) -> System:
    """A tank whose parameter ``trouble`` selects the fault of a run.

    Args:
        folder: The folder in which runs with trouble 6 record that they have ended a process.
    """

    def system(inflow: float, trouble: float = 0) -> Iterator[dict[str, float]]:
        yield {"level": 0.0}
        mark = folder / f"{inflow}"
        if trouble == 1:
            os._exit(3)
        elif trouble == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        elif trouble == 3:
            while True:
                rest(1)
        elif trouble == 4:
            ctypes.PyDLL(None).sleep(100)  # this call holds the lock of the interpreter
        elif trouble == 5:
            _ = 1 / 0
        elif trouble == 6 and not mark.exists():
            mark.touch()
            os._exit(4)
        yield from tank(inflow)

    return system


class Alive:
    """A named pipe that the processes of a campaign hold open while they run."""

    def __init__(self, path: Path) -> None:
        os.mkfifo(path)
        self._reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._reader)

    def is_written(self) -> bool:
        """Wait until a process writes into it; return False after a time limit."""
        for _ in range(10_000):
            if self._read():
                return True
            rest(0.01)  # no process holds it now
        return False

    def is_over(self) -> bool:
        """Wait until no process holds it any more; return False after a time limit."""
        while self._read():
            pass
        return True

    def _read(self) -> bytes:
        assert select.select([self._reader], [], [], 100)[0], "processes hold the pipe"
        return os.read(self._reader, 1)


_INTERRUPTIBLE = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""Makes a program receive an interrupt, which background processes of the tests ignore."""


@contextmanager
def program(text: str, *arguments: object) -> Iterator[subprocess.Popen[str]]:
    """Run a program with the modules of the tests, and end it afterwards."""
    running = subprocess.Popen(
        [sys.executable, "-c", _INTERRUPTIBLE + text, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    with running:
        try:
            yield running
        finally:
            running.kill()


def noted(file: Path, alive: Path, hangs: float = math.inf) -> System:
    """A tank that appends its inflow to a file, and takes some time.

    Args:
        file: The file.
        alive: A named pipe that each process of a run holds open.
        hangs: The inflow from which on a run starts a process of its own, and never ends.
    """

    def system(inflow: float) -> Iterator[dict[str, float]]:
        held = os.open(alive, os.O_WRONLY)
        with file.open("a", encoding="utf-8") as opened:
            opened.write(f"{inflow!r}\n")
        if inflow >= hangs:
            while not list(alive.parent.glob("*/part-*")):  # wait until other runs are on the disk
                rest(0.01)
            os.write(held, b".")
            subprocess.Popen(["sleep", "1000"], pass_fds=[held])  # noqa: S607 - any sleep does
            ctypes.PyDLL(None).sleep(1000)
        rest(0.002)
        yield from tank(inflow)
        os.close(held)

    return system
