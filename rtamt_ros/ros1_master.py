"""The connection of a node to the master of ROS 1, which may restart without its state."""

from __future__ import annotations

from collections.abc import Sequence
from http.client import HTTPConnection, HTTPException
from typing import Any
from xmlrpc.client import Error, ServerProxy, Transport

import rosgraph
import rospy
from rospy.impl import registration

from rtamt_ros.middleware import Level

_UNKNOWN = "the master at {} did not know this node"
PATIENCE = 2.0
"""Seconds for an answer: a master may hang, and a node that ends waits for none."""


class Displaced(Exception):  # noqa: N818
    """Another node has the name of this one."""


class Refused(Exception):  # noqa: N818
    """A master does not register the node."""


class MasterLink:
    """Checks whether the master knows a node, and registers the node again if not.

    rospy registers what it opens once. A restarted master knows nothing of it, and new nodes do not
    find the node, although its connections stay. So this class repeats all registrations with the
    new master, by the API of masters, and informs the node of publishers, by the API of nodes.

    Args:
        name: The name of the node, which rospy has registered.

    Attributes:
        state: The state since the first problem; None before.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._own = str(rospy.get_node_uri())
        self._address = str(rosgraph.get_master_uri())
        self._process: int | None = None  # of the master with all registrations
        self._gone = self._partly = False
        self._again = 0
        self.state: tuple[Level, str] | None = None

    def look(self) -> None:
        """Check the master, and repair what is wrong.

        Raises:
            Displaced: If the master knows another node by the name.
            Refused: If the master does not register the node.
        """
        try:
            with _proxy(self._address) as master:
                process = _taken(master.getPid(self._name))
                known, _, address = _answer(master.lookupNode(self._name, self._name))
                if rospy.core.is_shutdown_requested():  # it may have left the master
                    return
                if known == 1 and address != self._own:
                    raise Displaced(f"another node has the name {self._name}")
                if known != 1 or self._partly or self._process not in (None, process):
                    self._partly = True
                    self._register(master)
                    self._partly = False
                    self._again += 1
                    self._say(Level.OK, f"registered again ({self._again}): {_UNKNOWN}")
                elif self._gone:
                    self._say(Level.OK, "the master at {} answers again")
                self._process, self._gone = process, False
        except (OSError, HTTPException, Error):
            self._gone = True
            self._say(
                Level.WARN, "no master answers at {}: nodes that start now do not find this one"
            )

    def _say(self, level: Level, text: str) -> None:
        self.state = level, text.format(self._address)

    def _register(self, master: ServerProxy) -> None:
        """Repeat the registrations of rospy with a master."""
        topics, services = registration.get_topic_manager(), registration.get_service_manager()
        for topic, kind in topics.get_publications():
            _taken(master.registerPublisher(self._name, topic, kind, self._own))
        for service, address in services.get_services():
            _taken(master.registerService(self._name, service, address, self._own))
        with _proxy(self._own) as node:
            for topic, kind in topics.get_subscriptions():
                publishers = _taken(master.registerSubscriber(self._name, topic, kind, self._own))
                _taken(node.publisherUpdate("/master", topic, publishers))


class _Patient(Transport):
    """A transport that gives up after `PATIENCE`."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = PATIENCE
        return connection


def _proxy(address: str) -> ServerProxy:
    """Return the functions at an address."""
    return ServerProxy(address, transport=_Patient())


def _answer(answer: Any) -> Sequence[Any]:
    """Return a code, a text and a value, the answer of every function of ROS."""
    code, text, value = answer
    return code, text, value


def _taken(answer: Any) -> Any:
    """Return the value of an answer; raise Refused if its code is not 1."""
    code, text, value = _answer(answer)
    if code != 1:
        raise Refused(str(text))
    return value
