"""The process of a node: its start, its end, and its pauses."""

from __future__ import annotations

import gc
import signal
import threading
from importlib import import_module
from queue import SimpleQueue
from typing import Any


class Ending:
    """Whether a node has been asked to end.

    If signals would end the process at once (`run_module`), it handles them from now on: the node
    ends in good order, even before anybody waits.

    Attributes:
        asked: Whether it has been asked to.
    """

    def __init__(self) -> None:
        self.asked = False
        # A signal handler may interrupt the wait and put into this queue; it would deadlock with
        # the lock of an event.
        self._told: SimpleQueue[None] = SimpleQueue()
        quiet = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
        if quiet and threading.current_thread() is threading.main_thread():
            self._listen()

    def ask(self) -> None:
        """Ask the node to end."""
        self.asked = True
        self._told.put(None)

    def wait(self) -> None:
        """Wait for the request; in the main thread SIGINT and SIGTERM are requests too."""
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
        """Handle signals as requests; return the handlers before."""
        numbers = (signal.SIGINT, signal.SIGTERM)
        return {number: signal.signal(number, lambda *_: self.ask()) for number in numbers}

    def _wait(self) -> None:
        self._told.get()
        self._told.put(None)  # for other waiting threads


def run_module(name: str, *arguments: object) -> int:
    """Run the `main` of a module; Ctrl-C ends the process at once until there is a node.

    Otherwise, Python would show a traceback, and modules in C would turn an interrupt during their
    import into other errors.

    Returns:
        The exit code.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return int(import_module(name).main(*arguments) or 0)


def shorten_pauses() -> None:
    """Exclude loaded objects from garbage collections, which stop all threads.

    A collection of all objects takes 40 ms to 150 ms, as long as ten samples at 200 Hz.
    """
    gc.collect()
    gc.freeze()
