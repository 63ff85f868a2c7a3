"""Threads that take turns at points that a test sets, in every possible order.

One thread runs at a time. At each point (`Turns.point`, and before each acquisition of a lock from
`Turns.lock`) the next thread is chosen; `every_order` plays all choices, one run for each.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType

__all__ = ["Lock", "Turns", "every_order"]

_Semaphore = threading.Semaphore  # the real one, also while a test replaces locks
_Thread = threading.Thread
_PATIENCE = 30.0


class Turns:
    """The turns of threads in a list of choices; after its end the first thread continues.

    Args:
        choices: At each point, the index of the next thread among those that can continue.

    Attributes:
        options: At each point so far, the number of threads that could continue.
        order: The names of the threads, in the order of their turns.
    """

    def __init__(self, choices: Sequence[int] = ()) -> None:
        self.options: list[int] = []
        self.order: list[str] = []
        self._choices = choices
        self._threads: dict[int, _Turn] = {}
        self._done = _Semaphore(0)

    def run(self, **tasks: Callable[[], object]) -> None:
        """Run tasks, each in a thread, until all have ended; raise an error of any task."""
        turns = [_Turn(name, self, task) for name, task in tasks.items()]
        threads = [_Thread(target=each.run, daemon=True) for each in turns]
        for each, thread in zip(turns, threads, strict=True):
            thread.start()
            each.ready.acquire()
            self._threads[each.identity] = each
        self._next()
        assert self._done.acquire(timeout=_PATIENCE), "threads wait for each other"
        self._threads = {}
        for each in turns:
            if each.error is not None:
                raise each.error

    def point(self) -> None:
        """Let another thread or this one continue; no effect in threads outside `run`."""
        turn = self._threads.get(threading.get_ident())
        if turn is not None:
            self._next()
            turn.wait()

    def lock(self) -> Lock:
        """Return a reentrant lock; other threads wait for their turns until it is free."""
        return Lock(self)

    def _next(self) -> None:
        able = [each for each in self._threads.values() if each.can_go_on()]
        if not able:
            assert all(each.ended for each in self._threads.values()), "threads wait for each other"
            self._done.release()
            return
        at = len(self.options)
        choice = self._choices[at] if at < len(self._choices) else 0
        self.options.append(len(able))
        self.order.append(able[choice].name)
        able[choice].turn.release()


class _Turn:
    """A thread and its turn."""

    def __init__(self, name: str, turns: Turns, task: Callable[[], object]) -> None:
        self.name = name
        self.turns = turns
        self.task = task
        self.ready, self.turn = _Semaphore(0), _Semaphore(0)
        self.identity = 0
        self.wanted: Lock | None = None
        self.ended = False
        self.error: BaseException | None = None

    def can_go_on(self) -> bool:
        owner = None if self.wanted is None else self.wanted.owner
        return not self.ended and owner in (None, self.identity)

    def wait(self) -> None:
        assert self.turn.acquire(timeout=_PATIENCE), "no turn comes"

    def run(self) -> None:
        self.identity = threading.get_ident()
        self.ready.release()
        self.wait()
        try:
            self.task()
        except BaseException as error:  # noqa: BLE001 - it is raised by `Turns.run`
            self.error = error
        self.ended = True
        self.turns._next()


class Lock:
    """The lock of `Turns.lock`."""

    def __init__(self, turns: Turns) -> None:
        self.owner: int | None = None
        self._turns = turns
        self._count = 0

    def __enter__(self) -> None:
        turn = self._turns._threads.get(threading.get_ident())
        if turn is not None:
            turn.wanted = self
            self._turns.point()
            turn.wanted = None
        self.owner = threading.get_ident()
        self._count += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._count -= 1
        if not self._count:
            self.owner = None


def every_order() -> Iterator[Turns]:
    """Yield the turns of one run after another, until every order was played."""
    choices: list[int] = []
    while True:
        turns = Turns(choices)
        yield turns
        choices = [*choices, *[0] * (len(turns.options) - len(choices))]
        while choices and choices[-1] == turns.options[len(choices) - 1] - 1:
            choices.pop()
        if not choices:
            return
        choices[-1] += 1
