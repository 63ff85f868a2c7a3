"""The program of a worker process: it makes a runner and runs tasks."""

from __future__ import annotations

import faulthandler
import os
import pickle
import select
import signal
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final

from rtamt_gym.recorded.progress import silence

_EVERY: Final = 0.05
"""Seconds between messages with rows; if the process dies, later rows run again."""


class Making:
    """Whether this process is making its runner, which may import modules of the user."""

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
    with runner, suppress(EOFError):  # the pipe may end before `alive` does
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
