"""A callback of a subscription or a timer, until it is closed."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable

__all__ = ["Callback"]


class Callback:
    """A callback until it is closed; calls never overlap, and an exception ends one call only.

    Args:
        callback: What is called.
        log: Takes the traceback of an exception: the thread that calls goes on.
    """

    def __init__(self, callback: Callable[..., None], log: Callable[[str], object]) -> None:
        self._callback: Callable[..., None] | None = callback
        self._log = log
        self._lock = threading.RLock()  # a callback may close itself

    def __call__(self, *arguments: object) -> None:
        """Calls it, unless it is closed."""
        with self._lock:
            if self._callback is not None:
                try:
                    self._callback(*arguments)
                except Exception:  # noqa: BLE001 - the thread would end, or the node
                    self._log(traceback.format_exc())

    def close(self) -> None:
        """Calls it no more; waits for a call in another thread."""
        with self._lock:
            self._callback = None
