"""The process of a node: its start, its end, and its pauses."""

from __future__ import annotations

import gc
import signal
import threading
from importlib import import_module
from queue import SimpleQueue
from typing import Any


class Ending:
    """A request to end a node, from a caller or a signal.

    After `run_module`, SIGINT and SIGTERM would end the process at once. From now on they are
    requests, even before `wait`, so the node can close everything.

    Attributes:
        requested: Whether there was a request.
    """

    def __init__(self) -> None:
        self.requested = False
        # A signal handler may interrupt the wait and put into this queue; it would deadlock with
        # the lock of an event.
        self._requests: SimpleQueue[None] = SimpleQueue()
        quiet = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
        if quiet and threading.current_thread() is threading.main_thread():
            self._listen()

    def request(self) -> None:
        """Ask the node to end."""
        self.requested = True
        self._requests.put(None)

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
        return {number: signal.signal(number, lambda *_: self.request()) for number in numbers}

    def _wait(self) -> None:
        self._requests.get()
        self._requests.put(None)  # for other waiting threads


def run_module(name: str, *arguments: object) -> int:
    """Run the `main` of a module; until there is a node, Ctrl-C ends the process at once.

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
