"""Streams that a judge of `rtamt watch` gets in blocks."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import NamedTuple

from rtamt import RtamtError
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.watch import StreamWatch, WatchOptions


class Played(NamedTuple):
    """A stream after its end: its lines, its error or an empty text, its exit code, its judge."""

    lines: list[Line]
    error: str
    code: int
    watch: StreamWatch

    @property
    def finals(self) -> list[Line]:
        """The final lines."""
        return [line for line in self.lines if line.final]


def play(options: WatchOptions, text: str | bytes, blocks: int | Sequence[int] = 1 << 20) -> Played:
    """Play a stream in blocks of some bytes, or cut at some places, until ``--stop`` ends it."""
    raw = text.encode() if isinstance(text, str) else text
    if isinstance(blocks, int):
        bounds = [*range(0, len(raw), blocks), len(raw)]
    else:
        bounds = [0, *sorted(place % (len(raw) + 1) for place in blocks), len(raw)]
    lines: list[Line] = []
    watch, error = StreamWatch(options, "stream", lines.append), ""
    try:
        for begin, end in pairwise(bounds):
            for block in (raw[begin:end], b""):
                if not watch.stopped:
                    watch.add(block)
        if not watch.stopped:
            watch.end_of_input()
        watch.finish(early=watch.stopped)
    except RtamtError as refused:
        error = str(refused)
        with suppress(RtamtError):
            watch.finish(early=True)
    return Played(lines, error, 2 if error else watch.exit_code(), watch)
