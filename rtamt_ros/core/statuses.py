"""Messages of ``diagnostic_msgs``, of which a row is the state of a requirement."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rtamt_ros.middleware import Level, Middleware

__all__ = ["Statuses"]


class Statuses:
    """Makes messages of ``diagnostic_msgs/DiagnosticArray``.

    Args:
        middleware: The node of ROS.

    Attributes:
        array: The class of the messages.

    Raises:
        InputError: If ``diagnostic_msgs`` is not installed.
    """

    def __init__(self, middleware: Middleware) -> None:
        self._middleware = middleware
        self.array, self._status, self._pair = (
            middleware.message_class("diagnostic_msgs", name)
            for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
        )

    def made(self, time: int, rows: Iterable[tuple[str, Level, str, Mapping[str, str]]]) -> Any:  # noqa: ANN401 - the classes of ROS have no types
        """A message with a time; a row is a name, a level, a text, and values by name."""
        array = self.array()
        self._middleware.set_stamp(array, time)
        array.status = [self._row(*row) for row in rows]
        return array

    def _row(self, name: str, level: Level, text: str, values: Mapping[str, str]) -> object:
        status = self._status()
        # A byte is a number in ROS 1, and bytes in ROS 2.
        status.level = bytes([level]) if self._middleware.generation == 2 else int(level)
        status.name, status.message, status.hardware_id = name, text, ""
        for key, value in values.items():
            pair = self._pair()
            pair.key, pair.value = key, value
            status.values.append(pair)
        return status
