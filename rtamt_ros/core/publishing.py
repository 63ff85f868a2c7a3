"""Reports as messages on topics, and as diagnostics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any

from rtamt import InputError, Verdict
from rtamt_ros.core.outputs import Output
from rtamt_ros.core.report import RequirementReport, seconds
from rtamt_ros.middleware import Level, Middleware, Publisher

__all__ = ["BOUNDS", "Diagnostics", "Publishing"]

BOUNDS = {"lower": "Float64", "upper": "Float64", "verdict": "Int8"}
"""What is published of a requirement beside its robustness, and the messages of ``std_msgs``."""

_SECOND = 1_000_000_000


class Publishing:
    """Publishers of the robustness, the bounds and the verdict of requirements.

    Args:
        middleware: The node of ROS.
        outputs: The topics of robustness.
        bounds: For each requirement the topic below which its bounds are.
        classes: The classes of all messages, by package and name.
        lateness: As in `Judges`.

    Raises:
        InputError: If ROS refuses a topic; then no publisher is left open.
    """

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
        self._of: dict[str, list[_Outgoing]] = {name: [] for name in bounds}
        self._bounds: dict[str, list[_Bound]] = {name: [] for name in bounds}
        try:
            for output in outputs:
                publisher = self._publisher(output.topic, classes[output.package, output.message])
                outgoing = _Outgoing(middleware, output, publisher, lateness)
                for name in dict.fromkeys(name for name, _ in output.formulas):
                    self._of[name].append(outgoing)
            for name, topic in bounds.items():
                for what, message in BOUNDS.items():
                    publisher = self._publisher(f"{topic}/{what}", classes["std_msgs", message])
                    self._bounds[name].append(_Bound(what, publisher))
        except InputError:
            self.close()
            raise

    def publish(self, report: RequirementReport) -> None:
        """Publish what is known; of the bounds and the verdict, what is new."""
        for outgoing in self._of[report.name]:
            outgoing.publish(report)
        for bound in self._bounds[report.name]:
            bound.publish(report)

    def close(self) -> None:
        """Close every publisher."""
        while self._open:
            self._open.pop().close()

    def _publisher(self, topic: str, message: type) -> Publisher:
        publisher = self._middleware.publisher(topic, message)
        self._open.append(publisher)
        return publisher


class _Bound:
    """The messages of a bound or a verdict, each of which is published once until it changes.

    Their topics are latched, and a message costs as much as a hundred samples of a monitor.
    """

    def __init__(self, what: str, publisher: Publisher) -> None:
        self._of = attrgetter(what)
        self._publisher = publisher
        self._last = ""

    def publish(self, report: RequirementReport) -> None:
        value = self._of(report)
        if value is None:
            return
        written = float(value).hex()  # tells -0.0 from 0.0, and nan is nan
        if written != self._last:
            self._last = written
            message = self._publisher.message()
            message.data = int(value) if isinstance(value, Verdict) else value
            self._publisher.publish(message)


class _Outgoing:
    """The messages of one topic, one for each time: that which all its fields are about.

    A field whose values are known sooner than those of another waits for them. What is not known,
    as an input is stale, is nan in the messages that wait for it, and at the time of the sample.
    """

    def __init__(
        self,
        middleware: Middleware,
        output: Output,
        publisher: Publisher,
        lateness: Mapping[tuple[str, str], int],
    ) -> None:
        self._middleware = middleware
        self._publisher = publisher
        self._formulas = output.formulas
        self._late = {key: lateness[key] for key in output.formulas}
        self._longest = max(self._late.values())
        self._waiting: dict[int, dict[tuple[str, str], float]] = {}
        self._last: int | None = None  # what was said last, unless something was not known

    def publish(self, report: RequirementReport) -> None:
        gone = report.robustness is not None and math.isnan(report.robustness)
        for key in self._formulas:
            if key[0] == report.name:
                self._add_nan(key, report.time) if gone else self._add(key, report)
        for time in sorted(self._waiting):
            if len(self._waiting[time]) == len(self._formulas):
                self._send(time)
                self._waiting = {at: its for at, its in self._waiting.items() if at > time}
        if self._waiting:  # what is older comes no more, and what is newer came before a jump back
            oldest = report.time - self._longest
            self._waiting = {
                at: its for at, its in self._waiting.items() if oldest <= at <= report.time
            }

    def _add(self, key: tuple[str, str], report: RequirementReport) -> None:
        name = key[1]
        value = report.values.get(name) if name else report.robustness
        about = report.time - self._late[key] if name else report.about
        if value is None or about is None or math.isnan(value) or about == self._last:
            return
        self._waiting.setdefault(about, {})[key] = value

    def _add_nan(self, key: tuple[str, str], time: int) -> None:
        self._waiting.setdefault(time, {})
        for at, values in self._waiting.items():
            if at < time:
                values.setdefault(key, math.nan)
        self._waiting[time][key] = math.nan

    def _send(self, time: int) -> None:
        message = self._publisher.message()
        for key, value in self._waiting[time].items():
            *outer, last = self._formulas[key]
            holder: Any = message
            for step in outer:
                holder = getattr(holder, step)
            setattr(holder, last, value)
        self._middleware.set_stamp(message, time)
        self._publisher.publish(message)
        self._last = None if any(map(math.isnan, self._waiting[time].values())) else time


class Diagnostics:
    """The states of requirements on ``/diagnostics``: once a second, and when one is another.

    It is another when its level changes, or when its record ends. The log has these times only.

    Without the package ``diagnostic_msgs`` there are none, which the log says.

    Args:
        middleware: The node of ROS.
        formulas: The formula of every requirement.
    """

    def __init__(self, middleware: Middleware, formulas: Mapping[str, str]) -> None:
        self._middleware = middleware
        self._formulas = formulas
        self._states: dict[str, tuple[Level, str]] = {}
        self._told = 0
        self._publisher: Publisher | None = None
        try:
            array, self._status, self._pair = (
                middleware.message_class("diagnostic_msgs", name)
                for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
            )
        except InputError as error:
            middleware.log(Level.WARN, f"there is no /diagnostics: {error}")
        else:
            self._publisher = middleware.publisher("/diagnostics", array, latched=False)

    def tell(self, reports: Sequence[RequirementReport], now: int) -> bool:
        """Publish and log what is new; whether it was time to."""
        states = {each.name: (each.level, each.unrecorded) for each in reports}
        changed = [each for each in reports if self._states.get(each.name) != states[each.name]]
        if not changed and 0 <= now - self._told < _SECOND:
            return False
        self._told, self._states = now, states
        for report in changed:
            self._middleware.log(report.level, f"{report.name}: {report.text}")
        if self._publisher is not None:
            array = self._publisher.message()
            self._middleware.set_stamp(array, now)
            array.status = [self._status_of(each) for each in reports]
            self._publisher.publish(array)
        return True

    def close(self) -> None:
        """Close the publisher."""
        if self._publisher is not None:
            self._publisher.close()

    def _status_of(self, report: RequirementReport) -> object:
        status = self._status()
        level = int(report.level)
        # A byte is a number in ROS 1, and bytes in ROS 2.
        status.level = bytes([level]) if self._middleware.generation == 2 else level
        status.name = f"{self._middleware.name.strip('/')}: {report.name}"
        status.message = report.text
        status.hardware_id = ""
        for key, value in _told(report, self._formulas[report.name]).items():
            pair = self._pair()
            pair.key, pair.value = key, value
            status.values.append(pair)
        return status


def _told(report: RequirementReport, formula: str) -> dict[str, str]:
    """The numbers of a report for a reader."""
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
        "stale inputs": ", ".join(report.stale),
        "late samples": str(report.missed),
        "messages out of order": str(report.out_of_order),
        "unreadable messages": str(report.errors),
        "restarts": str(report.restarts),
    }


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _time(time: int | None) -> str:
    return "" if time is None else seconds(time, 3)
