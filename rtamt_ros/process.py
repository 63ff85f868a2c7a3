"""The end of a node, which signals, callbacks and other threads ask for, and of its program.

The pauses of a program that samples.
"""

from __future__ import annotations

import gc
import signal
import threading
from importlib import import_module
from queue import SimpleQueue
from typing import Any


class Ending:
    """Whether a node shall end; once it is asked to, for good.

    Where a signal would end the process at once (`run_module`), it asks from now on: the node ends
    in good order, also before anybody waits.

    Attributes:
        asked: Whether it is asked to.
    """

    def __init__(self) -> None:
        self.asked = False
        # A signal may come while it is waited for: of what waits, only this can be told by a
        # handler that interrupts it, where the lock of an event would wait for itself.
        self._told: SimpleQueue[None] = SimpleQueue()
        quiet = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
        if quiet and threading.current_thread() is threading.main_thread():
            self._listen()

    def ask(self) -> None:
        """Asks it to."""
        self.asked = True
        self._told.put(None)

    def wait(self) -> None:
        """Waits until it is asked to, in the main thread also by SIGINT or SIGTERM."""
        if threading.current_thread() is not threading.main_thread():
            self._wait()
            return
        before = self._listen()
        try:
            self._wait()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _listen(self) -> dict[signal.Signals, Any]:
        """Takes signals for questions; what handled them before."""
        numbers = (signal.SIGINT, signal.SIGTERM)
        return {number: signal.signal(number, lambda *_: self.ask()) for number in numbers}

    def _wait(self) -> None:
        self._told.get()
        self._told.put(None)  # for whoever waits too


def run_module(name: str, *arguments: object) -> int:
    """Runs the `main` of a module; Ctrl-C ends the process at once until there is a node.

    Python would show a traceback wherever it is, and modules in C make other errors of an
    interrupt while they are loaded.

    Returns:
        The exit code.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return int(import_module(name).main(*arguments) or 0)


def shorten_pauses() -> None:
    """Take what is loaded out of the searches for garbage, which stop all threads.

    A search of all objects takes 40 ms to 150 ms, as ten samples at 200 Hz do; from here on it is
    one of those that were made later.
    """
    gc.collect()
    gc.freeze()
