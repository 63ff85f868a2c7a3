"""Where a stream comes from: standard input, a file, a socket on loopback, or a replay."""

from __future__ import annotations

import ipaddress
import os
import select
import socket
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Final

from rtamt import InputError
from rtamt.errors import shown

_BLOCK: Final = 1 << 16
"""The most bytes of a block: what a pipe of Linux holds, and little enough to be judged at once."""

_POLL: Final = 0.02
"""Seconds between two looks at a file that may grow."""


@dataclass(frozen=True, slots=True)
class StreamSource:
    """A stream of bytes.

    Attributes:
        name: ``-`` for standard input, the path of a file, ``tcp:PORT``, ``tcp:HOST:PORT`` or
            ``unix:PATH``.
        follow: Whether a file is read on after its end, because it grows.
        idle: Seconds without a new byte after which such a file has ended; None: never.
        beat: Seconds after which an empty block is yielded if nothing comes; None: never.
    """

    name: str
    follow: bool = False
    idle: float | None = None
    beat: float | None = None

    @property
    def title(self) -> str:
        """The name of the stream in messages."""
        return "stdin" if self.name == "-" else shown(self.name)

    def blocks(self) -> Iterator[bytes]:
        """Yield what has come, in blocks as large as what is there; empty ones as a beat."""
        kind, _, address = self.name.partition(":")
        if self.name == "-":
            yield from self._of_stdin()
        elif kind in ("tcp", "unix") and address:
            yield from self._of_socket(kind, address)
        else:
            yield from self._of_file()

    def leave(self) -> None:
        """Close standard input, if it is the source, so that its writer ends at its next write."""
        if self.name == "-":
            with suppress(OSError, ValueError), open(os.devnull, "rb") as nothing:  # noqa: PTH123
                os.dup2(nothing.fileno(), sys.stdin.fileno())

    def check(self) -> None:
        """Refuse options that a source of this kind does not have."""
        is_file = self.name != "-" and self.name.partition(":")[0] not in ("tcp", "unix")
        if self.follow and not is_file:
            raise InputError(f"--follow reads a file that grows, got {self.title}. Leave it out.")
        if self.idle is not None and not self.follow:
            raise InputError("--idle ends a file that --follow reads. Add --follow, or leave it.")
        if is_file and not Path(self.name).exists():
            raise InputError(f"{self.title}: no such file")

    def _of_stdin(self) -> Iterator[bytes]:
        try:
            descriptor = sys.stdin.fileno()
        except (OSError, ValueError, AttributeError):  # a stream of Python's own
            buffer: Any = sys.stdin.buffer
            yield from iter(lambda: buffer.read1(_BLOCK), b"")
            return
        yield from self._of_descriptor(descriptor)

    def _of_descriptor(self, descriptor: int) -> Iterator[bytes]:
        while True:
            if self.beat is not None and not select.select([descriptor], [], [], self.beat)[0]:
                yield b""
                continue
            block = os.read(descriptor, _BLOCK)
            if not block:
                return
            yield block

    def _of_file(self) -> Iterator[bytes]:
        with Path(self.name).open("rb", buffering=0) as file:
            last = monotonic()
            beat = last
            while True:
                block = file.read(_BLOCK)
                if block:
                    last = beat = monotonic()
                    yield block
                    continue
                if not self.follow:
                    return
                self._check_same_file(os.fstat(file.fileno()))
                if os.fstat(file.fileno()).st_size < file.tell():
                    raise InputError(
                        f"{self.title}: expected a file that grows, but it has become shorter. "
                        "Start again to read it from its first line."
                    )
                now = monotonic()
                if self.idle is not None and now - last >= self.idle:
                    return
                if self.beat is not None and now - beat >= self.beat:
                    beat = now
                    yield b""
                sleep(_POLL)

    def _check_same_file(self, opened: os.stat_result) -> None:
        """Refuse a file in place of which there is another one, as after a rotation of logs."""
        try:
            now = Path(self.name).stat()
        except FileNotFoundError:
            return  # the process that writes it may still go on
        if (now.st_ino, now.st_dev) != (opened.st_ino, opened.st_dev):
            raise InputError(
                f"{self.title}: expected a file that grows, but another file has its name now. "
                "Start again to read it from its first line."
            )

    def _of_socket(self, kind: str, address: str) -> Iterator[bytes]:
        with closing(_listener(kind, address)) as listener:
            where = listener.getsockname()
            text = where if isinstance(where, str) else f"{where[0]}, port {where[1]}"
            print(f"waiting for a client at {text}", file=sys.stderr, flush=True)  # noqa: T201
            try:
                client, _ = listener.accept()
            finally:
                if kind == "unix":
                    with suppress(OSError):
                        Path(address).unlink()
        with closing(client):
            yield from self._of_descriptor(client.fileno())


def _listener(kind: str, address: str) -> socket.socket:
    """Return a socket that listens for one client, on loopback only."""
    if kind == "unix":
        listener = socket.socket(socket.AF_UNIX)
        where: str | tuple[str, int] = address
    else:
        host, _, port = address.rpartition(":")
        host = (host or "127.0.0.1").strip("[]").replace("localhost", "127.0.0.1")
        try:
            loopback = ipaddress.ip_address(host).is_loopback
            where = host, int(port)
        except ValueError:
            raise InputError(
                f"expected tcp:PORT or tcp:HOST:PORT with an address of loopback, got "
                f"tcp:{shown(address)}"
            ) from None
        if not loopback:
            raise InputError(
                f"expected an address of loopback, such as 127.0.0.1, got {shown(host)}. Forward "
                "the port of another machine with ssh -R."
            )
        listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    try:
        listener.bind(where)
        listener.listen(1)
    except OSError as error:
        listener.close()
        raise InputError(f"cannot listen at {kind}:{shown(address)}: {error.strerror}") from None
    return listener


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
