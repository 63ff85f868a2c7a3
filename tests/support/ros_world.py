"""Nodes in processes of their own that tests control, and their end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import TracebackType
from typing import Self

from ros_peer import Peer
from ros_processes import Ros

__all__ = ["World"]


class World:
    """Creates nodes in processes of their own, and ends them.

    Args:
        ros: The master or domain of the nodes.
        simulated: The master or domain of nodes with a simulated clock; it may be the same.
        simulating: The arguments of these nodes, next to remappings.
    """

    def __init__(self, ros: Ros, simulated: Ros, simulating: Sequence[str] = ()) -> None:
        self.ros = ros
        self._simulated = simulated
        self._simulating = simulating
        self._peers: list[Peer] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for peer in self._peers:  # all at once, because each takes half a second to end
            peer.process.terminate()
        for peer in self._peers:
            peer.end()

    @cached_property
    def talker(self) -> Peer:
        """Return a node that exists for all tests."""
        return self.peer("talker")

    @cached_property
    def listener(self) -> Peer:
        """Return another node."""
        return self.peer("listener")

    @cached_property
    def clock(self) -> Peer:
        """Return a node that publishes the simulated clock."""
        clock = self.peer("clock", ticking=True)
        clock.ask("publisher", "clock", "/clock", "rosgraph_msgs", "Clock")
        return clock

    @cached_property
    def simulated(self) -> Peer:
        """Return a node with the simulated clock."""
        return self.peer("simulated", simulated=True)

    def peer(
        self,
        name: str,
        remappings: Mapping[str, str] | None = None,
        *,
        simulated: bool = False,
        ticking: bool = False,
    ) -> Peer:
        """Start a node.

        Args:
            name: Its name.
            remappings: Remappings of names.
            simulated: Whether its clock is simulated.
            ticking: Whether it publishes the simulated clock.
        """
        ros = self._simulated if simulated or ticking else self.ros
        arguments = [f"{name}:={other}" for name, other in (remappings or {}).items()]
        if ros.generation == 2:
            arguments = [word for each in arguments for word in ("-r", each)]
            arguments = ["--ros-args", *arguments, *(self._simulating if simulated else ())]
        peer = Peer(ros, name, arguments, len(self._peers))
        self._peers.append(peer)
        return peer
