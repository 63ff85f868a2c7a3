"""The state of every requirement, for programs that act on it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rtamt import InputError
from rtamt_ros.core.publishing import Statuses, exact_values
from rtamt_ros.core.report import RequirementReport
from rtamt_ros.middleware import Level, Middleware, Publisher

_SECOND = 1_000_000_000


def lease_of(period: int) -> int:
    """Return the nanoseconds after which a silent monitor is not alive: 1 s, or five periods."""
    return max(_SECOND, 5 * period)


class States:
    """Publishes level, verdict and bounds of each requirement on ``TOPIC/state``.

    A message is a ``diagnostic_msgs/DiagnosticArray`` with one status. On ROS 2 the publishers
    offer liveliness by topic, so a subscriber hears that the monitor hangs or is dead.

    Args:
        middleware: The node of ROS.
        topics: The topic of each requirement.
        period: The nanoseconds between looks.
    """

    def __init__(self, middleware: Middleware, topics: Mapping[str, str], period: int) -> None:
        self._publishers: dict[str, Publisher] = {}
        try:
            self._statuses = Statuses(middleware)
        except InputError:  # `Diagnostics` logs it
            return
        for name, topic in topics.items():
            self._publishers[name] = middleware.publisher(
                f"{topic}/state", self._statuses.array, latched=False, lease=lease_of(period)
            )

    def publish(self, reports: Iterable[RequirementReport], now: int | None = None) -> None:
        """Publish reports with the time of their samples, or of a look at ``now``."""
        for report in reports:
            publisher = self._publishers.get(report.name)
            time = report.time if now is None else now
            if publisher is not None and time > 0:
                level = Level(report.level)
                row = report.name, level, report.text, exact_values(report)
                publisher.publish(self._statuses.message(time, [row]))

    def assert_alive(self) -> None:
        """Inform subscribers that the monitor runs."""
        for publisher in self._publishers.values():
            publisher.assert_alive()

    def close(self) -> None:
        """Close every publisher."""
        while self._publishers:
            self._publishers.popitem()[1].close()
