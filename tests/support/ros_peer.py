"""A process with a node of ROS 1 or ROS 2 that a test controls: its program, and its driver.

The process keeps received messages and timer calls, which tests read by name.
"""

from __future__ import annotations

import operator
import subprocess
import sys
import threading
import traceback
from collections.abc import Collection, Mapping, Sequence
from importlib import import_module
from multiprocessing.connection import Connection, Pipe
from typing import Any

from ros_processes import PATIENCE, Ros

from rtamt import InputError
from rtamt_ros.middleware import Level, Middleware

__all__ = ["Peer", "connect"]


def connect(generation: int, name: str, arguments: Sequence[str] = ()) -> Middleware:
    """Create a node of ROS 1 or ROS 2 in this process."""
    module = import_module(f"rtamt_ros.ros{generation}")
    node: Middleware = getattr(module, f"Ros{generation}")(name, arguments)
    return node


class Peer:
    """A process with a node; `ask` calls a method of its `Desk`.

    Args:
        ros: The master or domain.
        name: The name of the node.
        arguments: The arguments of the node, such as remappings.
        number: Distinguishes its log from others.
    """

    def __init__(self, ros: Ros, name: str, arguments: Sequence[str], number: int) -> None:
        self._log = ros.folder / f"{name}-{number}.log"
        self._connection, other = Pipe()
        command = [sys.executable, __file__, str(other.fileno()), str(ros.generation), name]
        with other, self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [*command, *arguments],
                env=ros.environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                pass_fds=[other.fileno()],
            )

    def ask(self, method: str, *arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        """Call a method of the desk; its error fails the test."""
        try:
            self._connection.send((method, arguments, options))
            assert self._connection.poll(2 * PATIENCE), "it does not answer"
            good, answer = self._connection.recv()
            assert good, answer
        except (AssertionError, OSError, EOFError) as error:
            raise AssertionError(f"{method}{arguments}: {error}; its log:\n{self.log()}") from error
        return answer

    def log(self) -> str:
        """The output of the process."""
        return self._log.read_text()

    def end(self) -> int:
        """End the process; return its exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        try:
            return self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()
        finally:
            self._connection.close()


class Desk:
    """The actions of a test on a node in another process; each object has a key."""

    def __init__(self, node: Middleware) -> None:
        self.node = node
        self._handles: dict[str, Any] = {}
        self._kept: dict[str, list[Any]] = {}
        self._news = threading.Condition()

    def name(self) -> str:
        """Return the name of the node."""
        return self.node.name

    def resolve(self, topic: str) -> str:
        """Return the full name of a topic."""
        return self.node.resolve(topic)

    def published_topics(self) -> Collection[str] | None:
        """Return the topics with a publisher."""
        return self.node.published_topics()

    def now(self) -> int:
        """Return the time of the ROS clock."""
        return self.node.now()

    def simulated(self) -> bool:
        """Return whether the clock is simulated."""
        return self.node.is_simulated()

    def fields(self, package: str, name: str, fields: Sequence[str]) -> list[Any]:
        """Return the values of fields of a new message."""
        return _read(self.node.message_class(package, name)(), fields)

    def refusal(self, package: str, name: str) -> str:
        """Return the class and the text of the error for a missing message."""
        try:
            self.node.message_class(package, name)
        except Exception as error:  # noqa: BLE001 - it is what the test looks at
            return f"{type(error).__name__}: {error}"
        return "none"

    def path(self, folder: str) -> None:
        """Let packages be imported from a folder."""
        sys.path.append(folder)

    def stamped(self, package: str, name: str, time: int | None) -> int | None:
        """Return the stamp of a new message, set to a time."""
        message = self.node.message_class(package, name)()
        if time is not None:
            self.node.set_stamp(message, time)
        return self.node.stamp(message)

    def subscribe(
        self,
        key: str,
        topic: str,
        package: str,
        name: str,
        fields: Sequence[str],
        fail: float | None = None,
        *,
        arrival: bool = False,
    ) -> None:
        """Keep the stamp and the fields of every message, and optionally its arrival.

        It may fail at a value of the first field.
        """

        def keep(message: Any) -> None:  # noqa: ANN401
            arrived = (self.node.now(),) if arrival else ()
            values = _read(message, fields)
            if values[0] == fail:
                raise ArithmeticError("a callback that fails")
            self._keep(key, (self.node.stamp(message), *values, *arrived))

        message = self.node.message_class(package, name)
        self._handles[key] = self.node.subscribe(topic, message, keep)

    def every(self, key: str, period: int, lasts: float = 0.0) -> None:
        """Keep the time of every call of a timer, and whether calls overlap; the third call fails.

        Args:
            key: Its name.
            period: In nanoseconds.
            lasts: The seconds of each call.
        """
        inside: list[None] = []

        def call(due: int) -> None:
            inside.append(None)
            self._keep(key, (self.node.now(), len(inside), due))
            if lasts:
                threading.Event().wait(lasts)
            inside.pop()
            if len(self._kept[key]) == 3:
                raise ArithmeticError("a timer that fails")

        self._handles[key] = self.node.every(period, call)

    def publisher(
        self,
        key: str,
        topic: str,
        package: str,
        name: str,
        *,
        latched: bool = False,
        numbers: Sequence[str] = (),
    ) -> None:
        """Create a publisher, also of numbers in these fields."""
        message = self.node.message_class(package, name)
        fields = [each.split(".") for each in numbers]
        made = self.node.publisher(topic, message, latched=latched, fields=fields)
        self._handles[key] = made

    def publish_numbers(self, key: str, numbers: Sequence[float], stamp: int) -> None:
        """Publish numbers in the fields of the publisher."""
        self._handles[key].publish_numbers(stamp, numbers)

    def publish(self, key: str, values: Mapping[str, Any], stamp: int | None = None) -> None:
        """Publish a message with these values of fields."""
        publisher = self._handles[key]
        message = publisher.message()
        for field, value in values.items():
            *path, last = field.split(".")
            setattr(operator.attrgetter(".".join(path))(message) if path else message, last, value)
        if stamp is not None:
            self.node.set_stamp(message, stamp)
        publisher.publish(message)

    def publish_times(self, key: str, field: str, begin: int, count: int) -> list[float]:
        """Publish the time since a start as a field, in seconds, every 0 to 7 ms."""
        times = []
        for number in range(count):
            times.append((self.node.now() - begin) / 1e9)
            self.publish(key, {field: times[-1]})
            threading.Event().wait(number * 3 % 8 / 1000)
        return times

    def tick(self, key: str, time: int) -> None:
        """Publish a time of the clock."""
        publisher = self._handles[key]
        message = publisher.message()
        for part, value in zip(type(message.clock).__slots__, divmod(time, 10**9), strict=False):
            setattr(message.clock, part.lstrip("_"), value)
        publisher.publish(message)

    def wait_until(self, time: int, patience: float) -> bool:
        """Return whether the clock reaches a time before the time limit."""
        for _ in range(round(patience / 0.001)):
            if self.node.now() == time:
                return True
            threading.Event().wait(0.001)
        return False

    def kept(self, key: str, count: int = 0, patience: float = PATIENCE) -> list[Any]:
        """Return the objects of a key once there are enough, or after the time limit."""
        with self._news:
            self._news.wait_for(lambda: len(self._kept.get(key, ())) >= count, patience)
            return list(self._kept.get(key, ()))

    def trigger(self, key: str, name: str, text: str, error: str = "") -> None:
        """Offer a service that answers with a text, or fails with an error of this name."""

        def act() -> str:
            if error:
                raise {"InputError": InputError}.get(error, ArithmeticError)(text)
            return text

        self._handles[key] = self.node.trigger(name, act)

    def call(self, service: str) -> tuple[bool, str]:
        """Return the answer of a service of any node."""
        node: Any = self.node
        kind = import_module("std_srvs.srv").Trigger
        if self.node.generation == 1:
            rospy = import_module("rospy")
            rospy.wait_for_service(service, PATIENCE)
            answer = rospy.ServiceProxy(service, kind)()
            return answer.success, answer.message
        client = node.node.create_client(kind, service)
        assert client.wait_for_service(PATIENCE), f"there is no {service}"
        future, done = client.call_async(kind.Request()), threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert done.wait(PATIENCE), f"{service} does not answer"
        return future.result().success, future.result().message

    def close(self, key: str) -> None:
        """Close the object of a key."""
        self._handles.pop(key).close()

    def log(self, level: int, text: str) -> None:
        """Write to the log of the node."""
        self.node.log(Level(level), text)

    def end(self) -> None:
        """End the node from another thread than `spin`, after the answer."""
        threading.Timer(0.05, self.node.close).start()

    def _keep(self, key: str, value: tuple[Any, ...]) -> None:
        with self._news:
            self._kept.setdefault(key, []).append(value)
            self._news.notify_all()


def _read(message: Any, fields: Sequence[str]) -> list[Any]:  # noqa: ANN401
    return [operator.attrgetter(field)(message) for field in fields]


def _serve(connection: Connection, desk: Desk) -> None:
    while True:
        try:
            method, arguments, options = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = True, getattr(desk, method)(*arguments, **options)
        except Exception:  # noqa: BLE001 - it is told to the test
            answer = False, traceback.format_exc()
        connection.send(answer)


def _main(handle: str, generation: str, name: str, *arguments: str) -> None:
    with Connection(int(handle)) as connection:
        node = connect(int(generation), name, arguments)
        threading.Thread(target=_serve, args=(connection, Desk(node)), daemon=True).start()
        node.spin()
        node.close()
        print("closed", flush=True)  # noqa: T201


if __name__ == "__main__":
    _given, sys.argv[1:] = sys.argv[1:], []  # a node reads only the arguments that it gets
    _main(*_given)
