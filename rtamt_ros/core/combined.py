"""One message for each sample, with what is known of all requirements."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter

from rtamt_ros.core.report import RequirementReport
from rtamt_ros.core.statuses import Statuses
from rtamt_ros.middleware import Middleware

__all__ = ["Combined"]


class Combined:
    """Publishes ``diagnostic_msgs/DiagnosticArray``: a header with a time, and rows with names.

    It is the type of message with both that every ROS has, and that nobody has to build. The stamp
    is the time of the sample, and each field what is known then: robustness that is late says what
    it is about, and lies within bounds of the same message.

    Args:
        middleware: The node of ROS.
        topic: Where they are published; the last is kept.

    Raises:
        InputError: If ``diagnostic_msgs`` is not installed, or ROS refuses the topic.
    """

    def __init__(self, middleware: Middleware, topic: str) -> None:
        self._statuses = Statuses(middleware)
        self._publisher = middleware.publisher(topic, self._statuses.array)

    def publish(self, reports: Sequence[RequirementReport]) -> None:
        """Publish the reports of samples, a message for each; all of a sample are neighbours."""
        for time, its in groupby(reports, attrgetter("time")):
            rows = [(each.name, each.level, each.text, _values(each)) for each in its]
            if time > 0:
                self._publisher.publish(self._statuses.made(time, rows))

    def close(self) -> None:
        """Close the publisher."""
        self._publisher.close()


def _values(report: RequirementReport) -> dict[str, str]:
    """What is known of a requirement, with numbers that read back as they were."""
    return {
        "robustness": _number(report.robustness),
        "at": "" if report.about is None else _seconds(report.about),
        "lower": _number(report.lower),
        "upper": _number(report.upper),
        "verdict": "" if report.verdict is None else report.verdict.name,
        "asked": "" if report.asked is None else " ".join(map(str, report.asked)),
    }


def _number(value: float | None) -> str:
    return "" if value is None else repr(float(value))


def _seconds(time: int) -> str:
    """A time to the nanosecond."""
    return "{}.{:09d}".format(*divmod(time, 1_000_000_000))
