"""A callback of a subscription or a timer, until it is closed."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable

from rtamt import InputError

__all__ = ["Callback", "answered"]


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


def answered(act: Callable[[], str], log: Callable[[str], object]) -> tuple[bool, str]:
    """The answer of a service: whether it did what it is for, and a text.

    Args:
        act: Does it, and says what it has done; an InputError says why it could not.
        log: Takes the traceback of another exception, whose text is the answer.
    """
    try:
        return True, act()
    except InputError as error:
        return False, str(error)
    except Exception as error:  # noqa: BLE001 - who asks would wait, or hear nothing of it
        log(traceback.format_exc())
        return False, f"{type(error).__name__}: {error}"
