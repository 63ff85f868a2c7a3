"""A node of ROS 2 that sends transitions and parameters to a monitor, as tools do."""

from __future__ import annotations

import json
import threading
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_processes import PATIENCE, Process, Ros, patiently, ros
from std_msgs.msg import Float64

from rtamt_ros.ros2 import Ros2

with warnings.catch_warnings():  # from a parser that rclpy loads with its first message
    warnings.simplefilter("ignore", DeprecationWarning)
    import_module("rosidl_generator_py")

__all__ = ["BEST_EFFORT", "LATCHED", "Client", "Heard", "Monitor", "Source", "domain", "tools"]

PROGRAM = "from rtamt_ros.ros2_lifecycle import main; main()"
RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Heard:
    """Messages of a topic, in order of arrival."""

    def __init__(self) -> None:
        self._messages: list[Any] = []
        self._news = threading.Condition()

    def keep(self, message: Any) -> None:  # noqa: ANN401 - its class is of ROS
        """Add a message."""
        with self._news:
            self._messages.append(message)
            self._news.notify_all()

    def next(self, met: Callable[[Any], bool], patience: float = PATIENCE) -> Any:  # noqa: ANN401
        """Return the next message that satisfies a condition; fail if none arrives."""
        with self._news:
            begin = len(self._messages)
            self._news.wait_for(lambda: any(map(met, self._messages[begin:])), patience)
            found = [each for each in self._messages[begin:] if met(each)]
            assert found, f"no such message came; the last: {self._messages[-1:]}"
            return found[0]

    def all(self, count: int = 0, patience: float = PATIENCE) -> list[Any]:
        """Return all messages once there are enough, or after the time limit."""
        with self._news:
            self._news.wait_for(lambda: len(self._messages) >= count, patience)
            return list(self._messages)


class Client:
    """A node in this process, and monitors in other processes.

    Args:
        ros: The domain of all nodes.
    """

    def __init__(self, ros: Ros) -> None:
        self.ros = ros
        self.middleware = Ros2("client")
        self._spinner = threading.Thread(target=self.middleware.spin)
        self._spinner.start()
        self._shared: dict[str, Monitor] = {}
        self._ends: list[Callable[[], object]] = []

    def end_test(self) -> None:
        """End the processes of a test; shared monitors continue."""
        while self._ends:
            self._ends.pop()()

    def close(self) -> None:
        """End the node of this process."""
        self.middleware.close()
        self._spinner.join()

    def monitor(self, name: str, **parameters: object) -> Monitor:
        """Start a monitor in the namespace of this name, with these parameters."""
        words = ["-r", f"__ns:=/{name}"]
        for each, value in parameters.items():
            words += ["-p", f"{each}:={json.dumps(value)}"]
        monitor = Monitor(
            self, name, self.ros.start("-c", PROGRAM, "--ros-args", *words, name=name)
        )
        self._ends.append(monitor.process.ask_to_end)
        return monitor

    def shared(self, name: str, **parameters: object) -> Monitor:
        """Return the monitor of this name that several tests share; the first call starts it."""
        if name not in self._shared:
            self._shared[name] = self.monitor(name, **parameters)
            self._ends.pop()
        return self._shared[name]

    def until(self, met: Callable[[], bool]) -> None:
        """Wait for a condition that has no event."""
        patiently(met)

    def hear(self, topic: str, message: type, profile: QoSProfile = RELIABLE) -> Heard:
        """Record the messages of a topic."""
        heard = Heard()
        node = self.middleware.node
        subscription = node.create_subscription(message, topic, heard.keep, profile)
        self._ends.append(lambda: node.destroy_subscription(subscription))
        return heard

    def source(self, topic: str, value: float, profile: QoSProfile = RELIABLE) -> Source:
        """Publish a number on a topic, 50 times a second."""
        source = Source(self.middleware, topic, value, profile)
        self._ends.append(source.close)
        return source


class Source:
    """A number that is published 50 times a second until it is closed.

    Attributes:
        value: The number.
    """

    def __init__(self, node: Ros2, topic: str, value: float, profile: QoSProfile) -> None:
        self.value = value
        self._publisher = node.node.create_publisher(Float64, topic, profile)
        self._timer = node.every(20_000_000, self._publish)

    def _publish(self, _due: int) -> None:
        self._publisher.publish(Float64(data=self.value))

    def close(self) -> None:
        """Stop publishing; the last value stays."""
        self._timer.close()


class Monitor:
    """A monitor in a process of its own, controlled by the services of its node."""

    def __init__(self, client: Client, name: str, process: Process) -> None:
        self._client = client
        self._node = client.middleware.node
        self._name = name
        self.process = process
        self._services: dict[str, Any] = {}

    def send(self, kind: Any, service: str, **request: Any) -> Any:  # noqa: ANN401
        """Call a service of the node; return the future answer."""
        found = self._services.get(service)
        if found is None:
            found = self._node.create_client(kind, f"/{self._name}/stl_monitor/{service}")
            self._services[service] = found
        self._client.until(lambda: found.service_is_ready() or not self.process.runs())
        assert self.process.runs(), self.process.output
        return found.call_async(kind.Request(**request))

    def call(self, kind: Any, service: str, **request: Any) -> Any:  # noqa: ANN401
        """Return the answer of a service of the node."""
        answered = threading.Event()
        answer = self.send(kind, service, **request)
        answer.add_done_callback(lambda _: answered.set())
        assert answered.wait(PATIENCE), f"{service} does not answer: {self.process.output}"
        return answer.result()

    @property
    def state(self) -> str:
        """Return the state of the life cycle."""
        return str(self.call(GetState, "get_state").current_state.label)

    def do(self, transition: str) -> bool:
        """Request a transition; return whether it succeeded."""
        asked = Transition(label=transition)
        return bool(self.call(ChangeState, "change_state", transition=asked).success)

    def set(self, **values: object) -> str:
        """Set all parameters or none; return the reason of an error, or an empty text."""
        asked = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        result = self.call(
            SetParametersAtomically, "set_parameters_atomically", parameters=asked
        ).result
        assert result.successful == (not result.reason)
        return str(result.reason)

    def get(self, name: str) -> object:
        """Return the value of a parameter."""
        found = self.call(GetParameters, "get_parameters", names=[name]).values[0]
        value: object = parameter_value_to_python(found)
        return value


@pytest.fixture(scope="module")
def domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Return a client in a domain of its own, which this process uses until the end of a file."""
    with ros(2, tmp_path_factory.mktemp("ros")) as found, pytest.MonkeyPatch.context() as patch:
        for name, value in found.environment.items():
            patch.setenv(name, value)
        connected = Client(found)
        try:
            yield connected
        finally:
            connected.close()


@pytest.fixture
def tools(domain: Client) -> Iterator[Client]:
    """Return the client; the processes of each test end with the test."""
    yield domain
    domain.end_test()
