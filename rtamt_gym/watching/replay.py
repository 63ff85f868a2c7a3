"""A replay of a recording as a stream, at the speed of its times."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from time import monotonic, sleep

_STEP = 0.05
"""The longest pause in seconds, after which an empty block is yielded."""


def paced(
    blocks: Iterable[bytes],
    seconds: Callable[[], float | None],
    speed: float,
    clock: Callable[[], float] = monotonic,
    pause: Callable[[float], None] = sleep,
) -> Iterator[bytes]:
    r"""Yield the lines of a recording one by one, each when it is due, and empty blocks between.

    Args:
        blocks: The bytes of the recording.
        seconds: Returns the time of the last judged row; None before the first.
        speed: Seconds of the recording in a second.
        clock: Returns the time in seconds.
        pause: Waits for some seconds.

    Example:
        >>> now, times = [0.0], iter([None, 5.0, 5.2])
        >>> def wait(step):
        ...     now[0] += step
        >>> blocks = paced([b"a\nb\n", b"c\n"], lambda: next(times), 2, lambda: now[0], wait)
        >>> [block for block in blocks if block], round(now[0], 6)
        ([b'a\n', b'b\n', b'c\n'], 0.1)
    """
    begin = first = None
    for block in blocks:
        for line in block.splitlines(keepends=True):
            yield line
            if not line.endswith(b"\n"):
                continue
            at = seconds()
            if at is None:
                continue
            if begin is None or first is None:
                begin, first = clock(), at
            due = begin + (at - first) / speed
            while (left := due - clock()) > 1e-9:
                pause(min(left, _STEP))
                yield b""
