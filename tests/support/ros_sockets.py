"""The addresses on which processes listen, from the kernel."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

LISTENING = "0A"


class Address(NamedTuple):
    """An address that receives data.

    Attributes:
        protocol: ``"tcp"`` or ``"udp"``.
        host: The bound address; 0.0.0.0 is every interface.
        port: Its port.
    """

    protocol: str
    host: str
    port: int


def _host(digits: str) -> str:
    """Read an address of /proc/net: words of four bytes, each in the byte order of the machine."""
    words = [bytes.fromhex(digits[i : i + 8])[::-1] for i in range(0, len(digits), 8)]
    return str(ipaddress.ip_address(b"".join(words)))


def listening(pids: Iterable[int]) -> list[Address]:
    """Return the sockets of processes that accept connections (TCP) or datagrams (UDP)."""
    own = {str(handle.readlink()) for pid in pids for handle in Path(f"/proc/{pid}/fd").iterdir()}
    found = []
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path("/proc/net", table).read_text(encoding="ascii").splitlines()[1:]:
            _, local, remote, state, *_, inode = line.split()[:10]
            takes = state == LISTENING if table[:3] == "tcp" else set(remote) <= set("0:")
            if f"socket:[{inode}]" in own and takes:
                host, port = local.split(":")
                found.append(Address(table[:3], _host(host), int(port, 16)))
    return sorted(found)
