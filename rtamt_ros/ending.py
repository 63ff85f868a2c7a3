"""The end of a node, which signals, callbacks and other threads ask for, and of its program."""

from __future__ import annotations

import signal
import threading
from importlib import import_module
from queue import SimpleQueue

__all__ = ["Ending", "run_module"]


class Ending:
    """Whether a node shall end; once it is asked to, for good.

    Attributes:
        asked: Whether it is asked to.
    """

    def __init__(self) -> None:
        self.asked = False
        # A signal may come while it is waited for: of what waits, only this can be told by a
        # handler that interrupts it, where the lock of an event would wait for itself.
        self._told: SimpleQueue[None] = SimpleQueue()

    def ask(self) -> None:
        """Asks it to."""
        self.asked = True
        self._told.put(None)

    def wait(self) -> None:
        """Waits until it is asked to, in the main thread also by SIGINT or SIGTERM."""
        if threading.current_thread() is not threading.main_thread():
            self._wait()
            return
        numbers = (signal.SIGINT, signal.SIGTERM)
        before = [signal.signal(number, lambda *_: self.ask()) for number in numbers]
        try:
            self._wait()
        finally:
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)

    def _wait(self) -> None:
        self._told.get()
        self._told.put(None)  # for whoever waits too


def run_module(name: str) -> int:
    """Runs the `main` of a module; Ctrl-C ends it quietly, also while modules are loaded.

    Returns:
        The exit code.
    """
    # Modules in C make other errors of an interrupt while they are loaded: it ends the process.
    handler = signal.signal(signal.SIGINT, signal.SIG_DFL)
    module = import_module(name)
    signal.signal(signal.SIGINT, handler)
    try:
        return int(module.main() or 0)
    except KeyboardInterrupt:  # before the node spins
        return 130
