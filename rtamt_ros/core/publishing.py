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
    """Makes messages of ``diagnostic_msgs/DiagnosticArray``, whose class is ``array``."""

    def __init__(self, middleware: Middleware) -> None:
        self._middleware = middleware
        self.array, self._status, self._pair = (
            middleware.message_class("diagnostic_msgs", name)
            for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
        )

    def message(self, time: int, rows: Iterable[tuple[str, Level, str, Mapping[str, str]]]) -> Any:  # noqa: ANN401 - the classes of ROS have no types
        """Return a message; a row is a name, a level, a text, and values by name."""
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

    Every ROS has this type, and nobody has to build it. The stamp is the time of the sample.
    Robustness that is late has its own time, and is within the bounds of the same message.
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


BOUNDS = {"lower": "Float64", "upper": "Float64", "verdict": "Int8"}
"""What is published of a requirement beside its robustness, and the messages of ``std_msgs``."""

_SECOND = 1_000_000_000
_MINUTE = 60 * _SECOND
_LINES = 10
"""The lines of a requirement in the log in a minute."""


class Publishing:
    """Publishes the robustness, the bounds and the verdict of requirements."""

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
        self._of: dict[str, list[_Outgoing | _Bounds]] = {name: [] for name in bounds}
        try:
            for output in outputs:
                message = classes[output.package, output.message]
                fields = [*output.formulas.values()]
                publisher = self._publisher(output.topic, message, fields)
                outgoing = _Outgoing(output, publisher, lateness)
                for name in dict.fromkeys(name for name, _ in output.formulas):
                    self._of[name].append(outgoing)
            for name, topic in bounds.items():
                publishers = {
                    name_of_bound: self._publisher(
                        f"{topic}/{name_of_bound}", classes["std_msgs", message]
                    )
                    for name_of_bound, message in BOUNDS.items()
                }
                self._of[name].append(_Bounds(publishers))
        except InputError:
            self.close()
            raise

    def publish(self, report: RequirementReport) -> None:
        """Publish a report; bounds and verdict only if they changed."""
        for outgoing in self._of[report.name]:
            outgoing.publish(report)

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

    Their topics are latched, and a message costs as much as a hundred samples of a monitor.
    """

    def __init__(self, publishers: Mapping[str, Publisher]) -> None:
        self._bounds = [_Bound(what, publisher) for what, publisher in publishers.items()]
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
    """The messages of one bound, or of the verdict."""

    def __init__(self, what: str, publisher: Publisher) -> None:
        self._of = attrgetter(what)
        self._publisher = publisher
        self._last = ""

    def publish(self, report: RequirementReport) -> None:
        value = self._of(report)
        if value is None:
            return
        written = float(value).hex()  # distinguishes -0.0 from 0.0, and equates nan
        if written != self._last:
            self._last = written
            message = self._publisher.message()
            message.data = int(value) if isinstance(value, Verdict) else value
            self._publisher.publish(message)


class _Outgoing:
    """The messages of one topic, one for each time that its fields are about.

    A field that is known earlier waits for the others. While an input is stale, unknown fields are
    nan in the messages that wait, and at the time of the sample.
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
        if self._only is not None:  # nothing to wait for
            news = (report.time, math.nan) if unknown else self._found(self._only, report)
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
                self._waiting = {at: its for at, its in self._waiting.items() if at > time}
        if self._waiting:  # older ones come no more; newer ones precede a jump back
            oldest = report.time - self._longest
            self._waiting = {
                at: its for at, its in self._waiting.items() if oldest <= at <= report.time
            }

    def _found(self, key: tuple[str, str], report: RequirementReport) -> tuple[int, float] | None:
        """Return the value of a formula in a report, with its time; None if it is not new."""
        name = key[1]
        value = report.values.get(name) if name else report.robustness
        about = report.time - self._late[key] if name else report.about
        if value is None or about is None or math.isnan(value) or about == self._last:
            return None
        return about, value

    def _add(self, key: tuple[str, str], report: RequirementReport) -> None:
        news = self._found(key, report)
        if news is not None:
            self._waiting.setdefault(news[0], {})[key] = news[1]

    def _add_nan(self, key: tuple[str, str], time: int) -> None:
        self._waiting.setdefault(time, {})
        for at, values in self._waiting.items():
            if at < time:
                values.setdefault(key, math.nan)
        self._waiting[time][key] = math.nan

    def _send(self, time: int, values: Sequence[float]) -> None:
        self._publish(time, values)
        self._last = None if any(map(math.isnan, values)) else time


class LogLimit:
    """The lines of a requirement in the log: at most 10 a minute, and every restart."""

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
        around: The result of `Middleware.around`, which becomes a state of its own when it is new.
    """

    def __init__(self, middleware: Middleware, formulas: Mapping[str, str]) -> None:
        self._middleware = middleware
        self.around: tuple[Level, str] | None = None
        self._last_around: tuple[Level, str] | None = None
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

    def tell(self, reports: Sequence[RequirementReport], now: int) -> bool:
        """Publish and log news; return whether it was time to."""
        states, before = [*map(_STATE, reports)], self._states
        around = self.around
        news = around is not None and around != self._last_around
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
        if around is not None and news:
            self._last_around = around
            self._middleware.log(*around)
        if self._publisher is not None:
            node = self._middleware.name.strip("/")
            rows: list[tuple[str, Level, str, Mapping[str, str]]] = [
                (
                    f"{node}: {each.name}",
                    each.level,
                    each.text,
                    _numbers(each, self._formulas[each.name]),
                )
                for each in reports
            ]
            if around is not None:
                rows.append((f"{node}: ROS", *around, {}))
            self._publisher.publish(self._statuses.message(now, rows))
        return True

    def close(self) -> None:
        """Close the publisher."""
        if self._publisher is not None:
            self._publisher.close()


_STATE = attrgetter("level", "unrecorded", "restarts", "loses")
"""What makes the state of a requirement another."""


def _numbers(report: RequirementReport, formula: str) -> dict[str, str]:
    """Return the numbers of a report for a reader."""
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
