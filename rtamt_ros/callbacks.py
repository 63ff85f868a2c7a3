"""Callbacks that can be closed, answers of services, and a timer on a grid."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from rtamt import InputError


class Callback:
    """A callback until it is closed; calls never overlap, and an exception only ends its call.

    ``log`` gets the traceback of an exception.
    """

    def __init__(self, callback: Callable[..., None], log: Callable[[str], object]) -> None:
        self._callback: Callable[..., None] | None = callback
        self._log = log
        self._lock = threading.RLock()  # a callback may close itself

    def __call__(self, *arguments: object) -> None:
        """Call the callback, unless it is closed."""
        with self._lock:
            if self._callback is not None:
                try:
                    self._callback(*arguments)
                except Exception:  # noqa: BLE001 - it would end the thread or the node
                    self._log(traceback.format_exc())

    def close(self) -> None:
        """End the callback; wait for a call that runs in another thread."""
        with self._lock:
            self._callback = None


def answered(act: Callable[[], str], log: Callable[[str], object]) -> tuple[bool, str]:
    """Return the answer of a service: whether ``act`` succeeded, and its text.

    An exception becomes the text; ``log`` gets its traceback unless it is an InputError.
    """
    try:
        return True, act()
    except InputError as error:
        return False, str(error)
    except Exception as error:  # noqa: BLE001 - the caller would get no answer
        log(traceback.format_exc())
        return False, f"{type(error).__name__}: {error}"


class NodeClock(Protocol):
    """The clock of a node of ROS."""

    def now(self) -> int:
        """Return the time in nanoseconds; 0 before a simulated clock starts."""
        ...

    def is_simulated(self) -> bool:
        """Return whether the clock is simulated."""
        ...

    def wait_for_another(self, now: int) -> None:
        """Wait until a simulated clock leaves ``now``, at most half a second."""
        ...


class GridTimer(threading.Thread):
    """A thread that calls back on a grid of a clock; the grid stays when the clock jumps.

    After several missed points there is one call, with the last point. The timer of rospy moves its
    grid by every delay, rounds its period and ends at the first exception. The timer of rclpy waits
    for an executor, which looks for other work for half a millisecond.
    """

    def __init__(self, clock: NodeClock, period: int, callback: Callback) -> None:
        super().__init__(daemon=True)
        self._clock = clock
        self._period = period
        self._callback: Callable[[int], None] = callback
        self._close = callback.close
        self._closed = threading.Event()
        # A wait for a lock takes a quarter of the time of a wait for an event.
        self._sleep = threading.Lock()
        self._sleep.acquire()
        self._begin = clock.now()
        self.start()

    def run(self) -> None:
        """Call back until it is closed."""
        clock, closed = self._clock, self._closed
        while not self._begin and not closed.is_set():  # a simulated clock has not started
            self._wait(0, 0)
            self._begin = clock.now()
        due = self._begin + self._period
        while not closed.is_set():
            now = clock.now()
            if due - self._period <= now < due:
                self._wait(now, due - now)
                continue
            late = now >= due  # otherwise, the clock has jumped back
            due = now + self._period - (now - self._begin) % self._period
            if late:
                self._callback(due - self._period)

    def _wait(self, now: int, duration: int) -> None:
        """Wait for a duration of the wall clock, or for another time of a simulated clock."""
        if self._clock.is_simulated():
            self._clock.wait_for_another(now)
        else:
            self._sleep.acquire(timeout=duration / 1e9)

    def close(self) -> None:
        """End the calls; wait for a call that runs in another thread."""
        self._close()
        self._closed.set()
        with suppress(RuntimeError):  # another thread closes it too
            self._sleep.release()
