"""A monitor as a node, on any middleware."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rtamt import InputError, Specification, parse
from rtamt.errors import nearest
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.judges import Judges
from rtamt_ros.core.publishing import (
    BOUNDS,
    COMBINED,
    Combined,
    Diagnostics,
    Publishing,
    States,
)
from rtamt_ros.core.report import RequirementReport, counted, seconds
from rtamt_ros.core.requirements import bound_topics, outputs_of
from rtamt_ros.core.settings import Settings
from rtamt_ros.core.topics import MessageCallback, OpenSubscription, Subscriptions
from rtamt_ros.messages import check_input, check_output
from rtamt_ros.middleware import Handle, Level, Middleware, Reception

__all__ = ["MonitorNode", "RequirementReport", "Settings"]


class Plan:
    """The checked specifications, topics and message classes of a node."""

    def __init__(
        self,
        middleware: Middleware,
        specifications: Sequence[str | Specification],
        settings: Settings,
    ) -> None:
        self.settings = settings
        self.specifications = tuple(
            parse(specification) if isinstance(specification, str) else specification
            for specification in specifications
        )
        if not self.specifications:
            raise InputError("expected one or more specifications, got an empty list")
        judges = self.judges()
        self.outputs = outputs_of(judges.requirements, dense=self.settings.dense)
        self.lateness = judges.lateness
        self.bounds = bound_topics(self.outputs)
        self.topics = {name: topic.inputs[0] for name, topic in judges.topics.items()}
        self.formulas = {
            requirement.name: str(requirement.specification.formula)
            for requirement in judges.requirements
        }
        wanted = {("std_msgs", message) for message in BOUNDS.values()}
        wanted |= {(output.package, output.message) for output in self.outputs}
        wanted |= {class_of(source) for source in judges.inputs}
        wanted |= {COMBINED} if self.settings.combined else set()
        self.classes = {key: middleware.message_class(*key) for key in sorted(wanted)}
        parts = {requirement.name: requirement.specification for requirement in judges.requirements}
        for requirement in judges.requirements:
            for subscription in requirement.specification.subscriptions():
                for field in subscription.fields:
                    key = class_of(requirement.cells[field.variable][0])
                    check_input(requirement.specification, field, self.classes[key], "/".join(key))
        for output in self.outputs:
            key = output.package, output.message
            for (name, formula), path in output.formulas.items():
                title = formula or parts[name].publications(name)[-1].formula
                check_output(parts[name], title, path, self.classes[key], "/".join(key))

    def judges(self) -> Judges:
        """Return new judges."""
        return Judges(self.specifications, self.settings)

    def check_types(self, middleware: Middleware) -> None:
        """Raise InputError if remappings join topics with different message classes."""
        known: dict[str, tuple[str, str]] = {}
        topics = [(name, class_of(source)) for name, source in self.topics.items()]
        topics += [(output.topic, (output.package, output.message)) for output in self.outputs]
        if combined := self.settings.combined:
            topics.append((combined, COMBINED))
            if middleware.resolve(combined) == "/diagnostics":
                raise InputError(
                    "combined: /diagnostics has the states of all nodes; write another topic, such "
                    "as rtamt/all"
                )
        for topic, kind in topics:
            full = middleware.resolve(topic)
            other = known.setdefault(full, kind)
            if other != kind:
                raise InputError(
                    f"expected one type of messages on {full}, got {'/'.join(other)} and "
                    f"{'/'.join(kind)}"
                )


def class_of(source: Input) -> tuple[str, str]:
    """Return the package and the name of the message class of an input."""
    return source.package or "", source.message or ""


SEARCH_AFTER = 3.0
"""Seconds of the wall clock after which a topic without a publisher is logged."""
FOLLOW_PERIOD = 250_000_000
"""Nanoseconds of a steady clock between looks at the publishers of the topics."""
WATCH_PERIOD = 2.0
"""Seconds of the wall clock between checks of the state of ROS."""
CLOCK_PERIOD = 2.0
"""Seconds of the wall clock between checks whether a simulated clock stands still."""


class MonitorNode:
    """Monitors the topics that specifications name, and publishes the results.

    Every requirement of every specification (`Specification.requirements`) has its own monitor, and
    requirements share subscriptions. Each requirement, and each named formula that it uses, has a
    latched topic: the topic of its output variable (``@ topic(out, monitor/out)``), otherwise
    ``rtamt/NAME``. The bounds are on ``TOPIC/lower`` and ``TOPIC/upper``, and the verdict (-1, 0 or
    1) is on ``TOPIC/verdict``. ``TOPIC/state`` has level, verdict and bounds at every sample, and
    ``/diagnostics`` has the level and the numbers of every `RequirementReport`.

    The constructor parses and compiles the specifications and looks up all message classes, so it
    raises every error of a specification. Nothing else happens before `start`.

    Args:
        middleware: The node of ROS. `stop` does not close it.
        specifications: Texts, or specifications from `rtamt.load` and `rtamt.parse`.
        settings: The settings; None for `Settings()`.

    Raises:
        SpecificationError: If a text is wrong or a monitor cannot run it, if a message class is
            unknown, or if two requirements have one name or topic.
        InputError: If a message class is not installed.
    """

    def __init__(
        self,
        middleware: Middleware,
        specifications: Sequence[str | Specification],
        settings: Settings | None = None,
    ) -> None:
        self._middleware = middleware
        self._lock = threading.RLock()
        self._plan = Plan(middleware, specifications, settings or Settings())
        self._subscriptions = Subscriptions(middleware)
        self._running: _Running | None = None

    @property
    def settings(self) -> Settings:
        """The settings."""
        return self._plan.settings

    @property
    def specifications(self) -> tuple[Specification, ...]:
        """The parsed specifications."""
        return self._plan.specifications

    @property
    def running(self) -> bool:
        """Whether the node was started and not stopped."""
        return self._running is not None

    @property
    def reports(self) -> tuple[RequirementReport, ...]:
        """The last report of every requirement; empty before the first look."""
        running = self._running
        return () if running is None else running.judges.reports

    def reset(self) -> str:
        """Start all monitors again with the current messages, as ``~/reset`` does.

        Violations and the minimum robustness are counted again. Until the next sample, robustness
        and bounds are nan on the topics, and verdicts 0. A record continues in its next file.

        Returns:
            The last state of every requirement: after the first line, one line each. The log has
            the same text.

        Raises:
            InputError: If the node does not run, or a simulated clock has not started.
        """
        running = self._running
        if running is None:
            raise InputError("the monitor does not run; start it, or activate its node")
        return running.reset()

    def start(self) -> None:
        """Subscribe, publish and sample; the monitors start again. A second call does nothing.

        Raises:
            InputError: If ROS refuses a topic; everything is closed again.
        """
        with self._lock:
            if self._running is None:
                try:
                    self._run()
                except InputError:
                    self._subscriptions.close()
                    raise

    def stop(self) -> None:
        """Close every subscription, publisher and timer; the record is complete."""
        with self._lock:
            running, self._running = self._running, None
        if running is not None:
            running.close()
            self._subscriptions.close()

    def _run(self) -> None:
        """Start the monitors of the plan, on the subscriptions that are open already."""
        running = _Running(self._middleware, self._plan, self._subscriptions)
        running.open()
        self._running = running

    def replace(
        self, specifications: Sequence[str | Specification], settings: Settings | None = None
    ) -> None:
        """Monitor other specifications; a running node keeps running.

        New runs start, as after `reset`. Subscriptions to topics with the same message class stay
        open and keep their last message.

        Args:
            specifications: As for the class.
            settings: Other settings; None keeps them.

        Raises:
            SpecificationError: As for the class. The node continues unchanged.
            InputError: As for the class, or if ROS refuses a topic; a running node then starts
                again with its old specifications.
        """
        with self._lock:
            before, running = self._plan, self._running
            plan = Plan(self._middleware, specifications, settings or before.settings)
            self._plan = plan
            if running is None:
                return
            self._running = None
            running.close()
            try:
                self._run()
            except InputError:
                self._plan = before
                self._run()
                raise
            finally:
                self._subscriptions.close([*self._plan.topics])


class _Running:
    """The judges, subscriptions, publishers and threads of a running node."""

    def __init__(self, middleware: Middleware, plan: Plan, subscriptions: Subscriptions) -> None:
        self.judges = plan.judges()
        self._subscriptions = subscriptions
        self._middleware = middleware
        self._plan = plan
        self._lock = threading.RLock()  # protects publishing, and judges in dense time
        # The clock is read under this lock, so messages and looks come in the order of their times.
        # On samples it is another lock, so that messages do not wait for a look to publish.
        self._arrivals = self._lock if plan.settings.dense else threading.RLock()
        self._closed = False
        self._handles: list[Handle] = []
        self._combined: Combined | None = None
        self._ended = threading.Event()
        self._begin = time.monotonic()
        self._searched = self._watching = False
        self._follows_at = 0
        self._defaults_wait = True
        self._threads: list[threading.Thread] = []

    def open(self) -> None:
        plan, middleware = self._plan, self._middleware
        try:
            plan.check_types(middleware)
            publishing = Publishing(
                middleware, plan.outputs, plan.bounds, plan.classes, plan.lateness
            )
            self._handles.append(publishing)
            self._publish = publishing.publish
            if plan.settings.combined:
                self._combined = Combined(middleware, plan.settings.combined)
                self._handles.append(self._combined)
            self._states = States(middleware, plan.bounds, plan.settings.period)
            self._handles.append(self._states)
            self._diagnostics = Diagnostics(middleware, plan.formulas)
            self._handles.append(self._diagnostics)
            self._subscribe()
            self._offer_reset()
            self._log_topics()
            self._handles.append(middleware.every(plan.settings.period, self._look))
        except InputError:
            self.close()
            raise
        if middleware.now() <= 0:  # no timer is due before a simulated clock starts
            self._look(0)

    def close(self) -> None:
        self._subscriptions.detach()
        with self._lock:
            self._closed = True
            self._subscriptions.keep(self.judges.topics)
        self._ended.set()
        # Close without the lock: a handle may wait for a callback that waits for the lock.
        while self._handles:
            self._handles.pop().close()
        for thread in self._threads:
            thread.join()
        with self._lock:
            self.judges.close()

    def reset(self) -> str:
        with self._lock:
            with self._arrivals:
                now = self._middleware.now()
            if self._closed or now <= 0:
                raise InputError("the node does not run, or its clock has not started")
            reports = self.judges.reset(now)
            self._publish_all(reports)
        first = f"new run of {counted(len(reports), 'requirement')} at {seconds(now, 3)}"
        text = "\n".join([first, *(f"{report.name}: {report.problem}" for report in reports)])
        self._middleware.log(Level.WARN, text)
        return text

    def _subscribe(self) -> None:
        """Subscribe to topics; open subscriptions continue with their last messages."""
        detached: dict[str, OpenSubscription] = {}
        for name, topic in self.judges.topics.items():
            message = self._plan.classes[class_of(topic.inputs[0])]
            subscription = self._subscriptions.detached(name, message)
            if subscription is not None:
                detached[name] = subscription
                topic.continue_from(subscription.order, subscription.evidence)
            else:
                subscription = self._subscriptions.open(name, message, self._callback(name))
            topic.subscribed = subscription.subscribed
        if detached:
            with self._lock, self._arrivals:
                arrivals = {
                    name: [
                        (message, self._time(message, came), came)
                        for message, came in subscription.take_stored()
                    ]
                    for name, subscription in detached.items()
                }
                self._follow_publishers()
                self.judges.resume(arrivals, self._middleware.now())
                for name, subscription in detached.items():
                    subscription.attach(self._callback(name))

    def _time(self, message: Any, came: int) -> int:  # noqa: ANN401 - the classes of ROS have no types
        """Return the time of a message: its stamp or its arrival."""
        stamp = self._middleware.stamp(message) if self._plan.settings.stamps else None
        return stamp or came

    def _follow_publishers(self) -> None:
        """Read the publishers of all topics, which decide about defaults and stale inputs."""
        middleware, steady = self._middleware, self._middleware.steady()
        for name, topic in self.judges.topics.items():
            message, before = self._plan.classes[class_of(topic.inputs[0])], topic.several
            topic.follow(middleware.publishers_of(name, message), middleware.resolve(name))
            if topic.several != before:
                middleware.log(*topic.news())
            if topic.needs_answer(steady):
                topic.may_keep = middleware.may_keep(name, message)
            topic.look(steady)
        self._follows_at = steady + FOLLOW_PERIOD
        self._defaults_wait = any(topic.waits for topic in self.judges.topics.values())

    def _offer_reset(self) -> None:
        try:
            self._handles.append(self._middleware.trigger("reset", self.reset))
        except InputError as error:
            self._middleware.log(Level.WARN, f"there is no service ~/reset: {error}")

    def _log_topics(self) -> None:
        """Log the topics of the node, and the files of its record."""
        log, resolve = partial(self._middleware.log, Level.OK), self._middleware.resolve
        for name, topic in self.judges.topics.items():
            names = ", ".join(dict.fromkeys(source.name for source in topic.inputs))
            log(f"subscribes to {resolve(name)} ({'/'.join(class_of(topic.inputs[0]))}) as {names}")
        for output in self._plan.outputs:
            log(f"publishes {resolve(output.topic)} ({output.package}/{output.message})")
        if self._plan.settings.combined:
            log(f"publishes {resolve(self._plan.settings.combined)} ({'/'.join(COMBINED)})")
        for path in self.judges.files:
            log(f"records {path}")

    def _in_thread(self, task: Callable[[], None]) -> None:
        """Run a slow task in a thread, so that it does not delay looks."""
        thread = threading.Thread(target=task, name=task.__name__, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _log_silent_topics(self) -> None:
        """Log the topics that nobody publishes, with similar names."""
        published = self._middleware.published_topics()
        if published is None:
            return
        own = {output.topic for output in self._plan.outputs} | {"/diagnostics", "/rosout"}
        own |= {self._plan.settings.combined} - {""}
        own |= {f"{topic}/{name}" for topic in self._plan.bounds.values() for name in BOUNDS}
        own |= {f"{topic}/state" for topic in self._plan.bounds.values()}
        others = set(published) - {self._middleware.resolve(topic) for topic in own}
        for name, topic in self.judges.topics.items():
            full = self._middleware.resolve(name)
            needed = any(source.default is None for source in topic.inputs)
            if needed and full not in published:
                hint = nearest(full, others)
                self._middleware.log(Level.WARN, f"nobody publishes {full}{hint}")

    def _callback(self, topic: str) -> MessageCallback:
        """Return the callback that passes messages of a topic to the judges."""
        clock, time, take = self._middleware.now, self._time, self.judges.take
        count = self.judges.topics[topic].evidence.count

        def sampled(message: Any, reception: Reception) -> None:  # noqa: ANN401 - the classes of ROS have no types
            with self._arrivals:
                now = clock()
                came = min(reception.received or now, now)
                stamp = time(message, came)
                count(reception, stamp)
                take(topic, message, stamp, came, now)

        def dense(message: Any, reception: Reception) -> None:  # noqa: ANN401
            with self._arrivals:
                if not self._closed:
                    now = clock()
                    came = min(reception.received or now, now)
                    stamp = time(message, came)
                    count(reception, stamp)
                    reports = take(topic, message, stamp, came, now)
                    for report in reports:
                        self._publish(report)
                    self._states.publish(reports, now)

        return dense if self._plan.settings.dense else sampled

    def _look(self, due: int) -> None:
        if self._defaults_wait or self._middleware.steady() >= self._follows_at:
            self._follow_publishers()
        self._middleware.take_waiting()
        self._publish_now(lambda now: self.judges.look(due, now))
        if not self._searched and time.monotonic() >= self._begin + SEARCH_AFTER:
            self._searched = True
            self._in_thread(self._watch_others)
        if not self._watching and self._middleware.is_simulated() and not self._closed:
            self._watching = True
            self._in_thread(self._watch_clock)

    def _publish_now(self, reports: Callable[[int], Sequence[RequirementReport]]) -> None:
        """Publish the reports of the current time."""
        with self._lock:
            with self._arrivals:
                now = self._middleware.now()
            if not self._closed:
                self._publish_all(reports(now))
                if self._plan.settings.dense and now > 0:
                    self._states.publish(self.judges.reports, now)
                self._states.assert_alive()
                if self._diagnostics.publish(self.judges.reports, now):
                    self.judges.flush()

    def _publish_all(self, reports: Sequence[RequirementReport]) -> None:
        for report in reports:
            self._publish(report)
        if not self._plan.settings.dense:
            self._states.publish(reports)
        if self._combined is not None:
            self._combined.publish(reports)

    def _watch_clock(self) -> None:
        """Report a simulated clock that stands still, because no timer is due then."""
        before = 0

        def standing(now: int) -> Sequence[RequirementReport]:
            return self.judges.standing() if 0 < now == before else []

        while not self._ended.wait(CLOCK_PERIOD):
            self._publish_now(standing)
            before = self._middleware.now()

    def _watch_others(self) -> None:
        """Log silent topics; then report the state of ROS when it changes."""
        self._log_silent_topics()
        while not self._ended.wait(WATCH_PERIOD):
            ros_state = self._middleware.ros_state()
            if ros_state != self._diagnostics.ros_state:
                self._diagnostics.ros_state = ros_state
                self._publish_now(lambda _now: [])
