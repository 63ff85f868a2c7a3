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

    Raises:
        InputError: If ROS refuses a topic; then no publisher is left open.
    """

    def __init__(
        self,
        middleware: Middleware,
        outputs: Sequence[Output],
        bounds: Mapping[str, str],
        classes: Mapping[tuple[str, str], type],
    ) -> None:
        self._middleware = middleware
        self._open: list[Publisher] = []
        self._of: dict[str, list[_Outgoing]] = {name: [] for name in bounds}
        self._bounds: dict[str, list[_Bound]] = {name: [] for name in bounds}
        try:
            for output in outputs:
                publisher = self._publisher(output.topic, classes[output.package, output.message])
                outgoing = _Outgoing(middleware, output, publisher)
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
    """The messages of one topic: published once every field of them has a value."""

    def __init__(self, middleware: Middleware, output: Output, publisher: Publisher) -> None:
        self._middleware = middleware
        self._publisher = publisher
        self._formulas = output.formulas
        self._values: dict[tuple[str, str], float | None] = dict.fromkeys(output.formulas)

    def publish(self, report: RequirementReport) -> None:
        gone = report.robustness is not None and math.isnan(report.robustness)
        for name, formula in self._formulas:
            if name == report.name:
                value = report.values.get(formula) if formula else report.robustness
                known = gone or (value is not None and not math.isnan(value))
                self._values[name, formula] = math.nan if gone else value if known else None
        if None in self._values.values():
            return
        message = self._publisher.message()
        for key, path in self._formulas.items():
            holder: Any = message
            for step in path[:-1]:
                holder = getattr(holder, step)
            setattr(holder, path[-1], self._values[key])
        self._middleware.set_stamp(message, report.time if report.about is None else report.about)
        self._publisher.publish(message)


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
