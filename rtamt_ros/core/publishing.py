"""Reports as messages: robustness and bounds on topics, diagnostics, and combined messages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

from rtamt import InputError, Verdict
from rtamt_ros.core.report import RequirementReport, seconds
from rtamt_ros.core.requirements import Output
from rtamt_ros.middleware import Level, Middleware, Publisher


class Statuses:
    """Creates messages of ``diagnostic_msgs/DiagnosticArray``; ``array`` is their class."""

    def __init__(self, middleware: Middleware) -> None:
        self._middleware = middleware
        self.array, self._status, self._pair = (
            middleware.message_class("diagnostic_msgs", name)
            for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
        )

    def message(self, time: int, rows: Iterable[tuple[str, Level, str, Mapping[str, str]]]) -> Any:  # noqa: ANN401 - the classes of ROS have no types
        """Return a message; a row has a name, a level, a text, and values by name."""
        message = self.array()
        self._middleware.set_stamp(message, time)
        message.status = [self._row(*row) for row in rows]
        return message

    def _row(self, name: str, level: Level, text: str, values: Mapping[str, str]) -> object:
        status = self._status()
        # A byte is an int in ROS 1, and bytes in ROS 2.
        status.level = bytes([level]) if self._middleware.generation == 2 else int(level)
        status.name, status.message, status.hardware_id = name, text, ""
        for key, value in values.items():
            pair = self._pair()
            pair.key, pair.value = key, value
            status.values.append(pair)
        return status


class Combined:
    """Publishes one ``diagnostic_msgs/DiagnosticArray`` per sample with all requirements.

    Every ROS has this type, and nobody has to build it. The stamp is the time of the sample. Late
    robustness has its own time, and is within the bounds of the same message.
    """

    def __init__(self, middleware: Middleware, topic: str) -> None:
        self._statuses = Statuses(middleware)
        self._publisher = middleware.publisher(topic, self._statuses.array)

    def publish(self, reports: Sequence[RequirementReport]) -> None:
        """Publish the reports of samples; the reports of one sample are adjacent."""
        for time, group in groupby(reports, attrgetter("time")):
            rows = [
                (report.name, report.level, report.text, exact_values(report)) for report in group
            ]
            if time > 0:
                self._publisher.publish(self._statuses.message(time, rows))

    def close(self) -> None:
        """Close the publisher."""
        self._publisher.close()


def exact_values(report: RequirementReport) -> dict[str, str]:
    """Return the values of a report as text; numbers are exact."""
    return {
        "robustness": _exact(report.robustness),
        "at": "" if report.about is None else _exact_seconds(report.about),
        "lower": _exact(report.lower),
        "upper": _exact(report.upper),
        "verdict": "" if report.verdict is None else report.verdict.name,
        "asked": "" if report.asked is None else " ".join(map(str, report.asked)),
    }


def _exact(value: float | None) -> str:
    return "" if value is None else repr(float(value))


def _exact_seconds(time: int) -> str:
    """Return a time in seconds, exact to the nanosecond."""
    return "{}.{:09d}".format(*divmod(time, 1_000_000_000))


COMBINED = ("diagnostic_msgs", "DiagnosticArray")
"""The package and the name of the class of combined messages."""
BOUNDS = {"lower": "Float64", "upper": "Float64", "verdict": "Int8"}
"""The topics of a requirement besides robustness, with their classes in ``std_msgs``."""

_SECOND = 1_000_000_000
_MINUTE = 60 * _SECOND
_LINES = 10
"""The maximum number of log lines of a requirement per minute."""


class Publishing:
    """The publishers of robustness, bounds and verdict of all requirements."""

    def __init__(
        self,
        middleware: Middleware,
        outputs: Sequence[Output],
        bounds: Mapping[str, str],
        classes: Mapping[tuple[str, str], type],
        lateness: Mapping[tuple[str, str], int],
    ) -> None:
        self._middleware = middleware
        self._open: list[Publisher] = []
        self._topics: dict[str, list[_RobustnessTopic | _Bounds]] = {name: [] for name in bounds}
        try:
            for output in outputs:
                message = classes[output.package, output.message]
                fields = [*output.formulas.values()]
                publisher = self._publisher(output.topic, message, fields)
                topic_of_output = _RobustnessTopic(output, publisher, lateness)
                for name in dict.fromkeys(name for name, _ in output.formulas):
                    self._topics[name].append(topic_of_output)
            for name, topic in bounds.items():
                publishers = {
                    name_of_bound: self._publisher(
                        f"{topic}/{name_of_bound}", classes["std_msgs", message]
                    )
                    for name_of_bound, message in BOUNDS.items()
                }
                self._topics[name].append(_Bounds(publishers))
        except InputError:
            self.close()
            raise

    def publish(self, report: RequirementReport) -> None:
        """Publish a report; bounds and verdict only if they changed."""
        for topic in self._topics[report.name]:
            topic.publish(report)

    def close(self) -> None:
        """Close every publisher."""
        while self._open:
            self._open.pop().close()

    def _publisher(
        self, topic: str, message: type, fields: Sequence[Sequence[str]] = ()
    ) -> Publisher:
        publisher = self._middleware.publisher(topic, message, fields=fields)
        self._open.append(publisher)
        return publisher


class _Bounds:
    """The bounds and the verdict of a requirement, published only when they change.

    The topics are latched. A message costs as much as a hundred samples of a monitor.
    """

    def __init__(self, publishers: Mapping[str, Publisher]) -> None:
        self._bounds = [_Bound(name, publisher) for name, publisher in publishers.items()]
        self._last: tuple[float | None, float | None, Verdict | None] = None, None, None

    def publish(self, report: RequirementReport) -> None:
        last = self._last
        lower, upper = report.lower, report.upper
        # Equal numbers were published, except 0, which has two signs, and nan.
        if lower and upper and (lower, upper, report.verdict) == last:
            return
        self._last = lower, upper, report.verdict
        for bound in self._bounds:
            bound.publish(report)


class _Bound:
    """The topic of a bound or of the verdict."""

    def __init__(self, name: str, publisher: Publisher) -> None:
        self._value = attrgetter(name)
        self._publisher = publisher
        self._last = ""

    def publish(self, report: RequirementReport) -> None:
        value = self._value(report)
        if value is None:
            return
        text = float(value).hex()  # distinguishes -0.0 from 0.0, and equates nan
        if text != self._last:
            self._last = text
            message = self._publisher.message()
            message.data = int(value) if isinstance(value, Verdict) else value
            self._publisher.publish(message)


class _RobustnessTopic:
    """The topic of one or several formulas: a message for each time of their robustness.

    A field that is known earlier waits for the others. While an input is stale, unknown fields are
    nan, in the messages that wait and in the message of the sample.
    """

    def __init__(
        self,
        output: Output,
        publisher: Publisher,
        lateness: Mapping[tuple[str, str], int],
    ) -> None:
        self._publish = publisher.publish_numbers
        self._formulas = output.formulas
        self._late = {key: lateness[key] for key in output.formulas}
        self._longest = max(self._late.values())
        self._only = next(iter(output.formulas)) if len(output.formulas) == 1 else None
        self._waiting: dict[int, dict[tuple[str, str], float]] = {}
        self._last: int | None = None  # the last complete time

    def publish(self, report: RequirementReport) -> None:
        unknown = report.robustness is not None and math.isnan(report.robustness)
        if self._only is not None:  # no other field to wait for
            news = (report.time, math.nan) if unknown else self._new_value(self._only, report)
            if news is not None:
                self._send(news[0], (news[1],))
            return
        for key in self._formulas:
            if key[0] == report.name:
                self._add_nan(key, report.time) if unknown else self._add(key, report)
        for time in sorted(self._waiting):
            if len(self._waiting[time]) == len(self._formulas):
                values = self._waiting[time]
                self._send(time, [values[key] for key in self._formulas])
                self._waiting = {t: fields for t, fields in self._waiting.items() if t > time}
        if self._waiting:  # no older value follows; newer times are from before a jump back
            oldest = report.time - self._longest
            self._waiting = {
                t: fields for t, fields in self._waiting.items() if oldest <= t <= report.time
            }

    def _new_value(
        self, key: tuple[str, str], report: RequirementReport
    ) -> tuple[int, float] | None:
        """Return the value of a formula in a report, with its time; None if it is not new."""
        name = key[1]
        value = report.values.get(name) if name else report.robustness
        about = report.time - self._late[key] if name else report.about
        if value is None or about is None or math.isnan(value) or about == self._last:
            return None
        return about, value

    def _add(self, key: tuple[str, str], report: RequirementReport) -> None:
        news = self._new_value(key, report)
        if news is not None:
            self._waiting.setdefault(news[0], {})[key] = news[1]

    def _add_nan(self, key: tuple[str, str], time: int) -> None:
        self._waiting.setdefault(time, {})
        for earlier, values in self._waiting.items():
            if earlier < time:
                values.setdefault(key, math.nan)
        self._waiting[time][key] = math.nan

    def _send(self, time: int, values: Sequence[float]) -> None:
        self._publish(time, values)
        self._last = None if any(map(math.isnan, values)) else time


def lease_of(period: int) -> int:
    """Return the nanoseconds after which a silent monitor is dead: five periods, at least 1 s."""
    return max(_SECOND, 5 * period)


class States:
    """Publishes level, verdict and bounds of each requirement on ``TOPIC/state``.

    A message is a ``diagnostic_msgs/DiagnosticArray`` with one status. On ROS 2 the publishers
    offer liveliness by topic, so subscribers learn that the monitor hangs or is dead.

    Args:
        middleware: The node of ROS.
        topics: The topic of each requirement.
        period: The nanoseconds between looks.
    """

    def __init__(self, middleware: Middleware, topics: Mapping[str, str], period: int) -> None:
        self._publishers: dict[str, Publisher] = {}
        try:
            self._statuses = Statuses(middleware)
        except InputError:  # `Diagnostics` logs the error
            return
        for name, topic in topics.items():
            self._publishers[name] = middleware.publisher(
                f"{topic}/state", self._statuses.array, latched=False, lease=lease_of(period)
            )

    def publish(self, reports: Iterable[RequirementReport], now: int | None = None) -> None:
        """Publish reports with the time of their samples, or with ``now``."""
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


class LogLimit:
    """The log lines of a requirement: at most 10 per minute, and every restart."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._left_out = self._restarts = 0

    def line(self, report: RequirementReport, now: int) -> str:
        """Return the line for a changed report at a time; empty if there is none."""
        self._times = [time for time in self._times if 0 <= now - time < _MINUTE]
        restarted, self._restarts = report.restarts != self._restarts, report.restarts
        if len(self._times) >= _LINES and not restarted:
            self._left_out += 1
            return ""
        self._times.append(now)
        line = f"{report.name}: {report.text}"
        if self._left_out:
            line += f"; {self._left_out} changes were not logged"
            self._left_out = 0
        elif len(self._times) == _LINES:
            line += "; more changes in this minute are in /diagnostics only"
        return line


class Diagnostics:
    """The states of requirements on ``/diagnostics``: once a second, and when one changes.

    A state changes with its level, or when its record ends; these changes are logged too. Without
    ``diagnostic_msgs`` there are no diagnostics, which the log reports.

    Attributes:
        ros_state: The last result of `Middleware.ros_state`; None while ROS has no problem.
    """

    def __init__(self, middleware: Middleware, formulas: Mapping[str, str]) -> None:
        self._middleware = middleware
        self.ros_state: tuple[Level, str] | None = None
        self._last_ros_state: tuple[Level, str] | None = None
        self._formulas = formulas
        self._limits: dict[str, LogLimit] = {}
        self._states: list[tuple[Any, ...]] = []
        self._last_time = 0
        self._publisher: Publisher | None = None
        try:
            self._statuses = Statuses(middleware)
        except InputError as error:
            middleware.log(Level.WARN, f"there is no /diagnostics: {error}")
        else:
            self._publisher = middleware.publisher(
                "/diagnostics", self._statuses.array, latched=False
            )

    def publish(self, reports: Sequence[RequirementReport], now: int) -> bool:
        """Publish and log new states; return whether it published."""
        states, before = [*map(_STATE, reports)], self._states
        ros_state = self.ros_state
        news = ros_state is not None and ros_state != self._last_ros_state
        if states == before and not news and 0 <= now - self._last_time < _SECOND:
            return False
        missing = [None] * (len(states) - len(before))
        known = zip(reports, states, [*before, *missing], strict=True)
        changed = [report for report, state, was in known if state != was]
        self._last_time = now
        self._states = states
        for report in changed:
            if line := self._limits.setdefault(report.name, LogLimit()).line(report, now):
                self._middleware.log(report.level, line)
        if ros_state is not None and news:
            self._last_ros_state = ros_state
            self._middleware.log(*ros_state)
        if self._publisher is not None:
            node = self._middleware.name.strip("/")
            rows: list[tuple[str, Level, str, Mapping[str, str]]] = [
                (
                    f"{node}: {report.name}",
                    report.level,
                    report.text,
                    _numbers(report, self._formulas[report.name]),
                )
                for report in reports
            ]
            if ros_state is not None:
                rows.append((f"{node}: ROS", *ros_state, {}))
            self._publisher.publish(self._statuses.message(now, rows))
        return True

    def close(self) -> None:
        """Close the publisher."""
        if self._publisher is not None:
            self._publisher.close()


_STATE = attrgetter("level", "unrecorded", "restarts", "loses")
"""The fields that make up the state of a requirement."""


def _numbers(report: RequirementReport, formula: str) -> dict[str, str]:
    """Return the numbers of a report as texts."""
    return {
        "formula": formula,
        "robustness": _number(report.robustness),
        "at": _time(report.about),
        "lower": _number(report.lower),
        "upper": _number(report.upper),
        "verdict": "" if report.verdict is None else report.verdict.name,
        "worst robustness": _number(report.worst),
        "worst at": _time(report.worst_time),
        "violations": str(report.violations),
        "first violation at": _time(report.violated_at),
        "waiting for": ", ".join(report.waiting),
        "defaults": ", ".join(report.defaults),
        "stale inputs": ", ".join(report.stale),
        "late samples": str(report.missed),
        "late arrivals": str(report.late_arrivals),
        "lost messages": ", ".join(report.losses),
        "messages out of order": str(report.out_of_order),
        "messages out of line": str(report.strays),
        "messages ahead of the clock": str(report.ahead),
        "unreadable messages": str(report.errors),
        "restarts": str(report.restarts),
        "resets": str(report.resets),
        "last reset at": _time(report.reset_at),
    }


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _time(time: int | None) -> str:
    return "" if time is None else seconds(time, 3)
