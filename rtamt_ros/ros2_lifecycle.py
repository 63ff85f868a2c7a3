"""The monitor as a lifecycle node of ROS 2 with parameters."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from rtamt import InputError, RtamtError, Specification
from rtamt.errors import nearest
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode
from rtamt_ros.parameters import PARAMETERS, read
from rtamt_ros.process import shorten_pauses
from rtamt_ros.ros2 import Ros2

_SEVERAL_TYPES = ("spec", "spec_file", "period", "stale")


class LifecycleMonitor:
    """A monitor as a lifecycle node.

    `configure` reads the parameters and the specifications. The node subscribes, samples and
    publishes while it is active. Setting a parameter at run time restarts the monitors; a wrong
    value is refused with the reason, and the monitors continue.

    Args:
        name: The name of the node, unless the arguments set another name.
        arguments: As for `Ros2`.
        parameters: Values of `PARAMETERS`, which override values in the arguments.

    Raises:
        InputError: If a parameter has a wrong type.

    Attributes:
        ros: The middleware.
    """

    def __init__(
        self,
        name: str = "stl_monitor",
        arguments: Sequence[str] = (),
        parameters: Mapping[str, object] | None = None,
    ) -> None:
        self._monitor: MonitorNode | None = None
        self.ros = Ros2(name, arguments, make=partial(_Node, self, parameters or {}))
        self.node: LifecycleNode = self.ros.node

    def autostart(self) -> bool:
        """Configure and activate the node; return whether both succeeded."""
        transitions = self.node.trigger_configure, self.node.trigger_activate
        return all(transition() == TransitionCallbackReturn.SUCCESS for transition in transitions)

    def configure(self) -> None:
        """Read parameters and specifications."""
        values = self._values()
        specifications, settings = read(values)
        self._monitor = MonitorNode(self.ros, _checked(specifications), settings)
        self._set_subscriptions(values)

    def activate(self) -> None:
        """Subscribe and publish; new runs start."""
        if self._monitor is not None:
            self._monitor.start()

    def deactivate(self) -> None:
        """Close subscriptions and publishers."""
        if self._monitor is not None:
            self._monitor.stop()

    def clean_up(self) -> None:
        """Deactivate, and forget the specifications."""
        self.deactivate()
        self._monitor = None

    def transition(self, act: Callable[[], None]) -> TransitionCallbackReturn:
        """Run a transition; log an error."""
        try:
            act()
        except RtamtError as error:
            self.ros.log(Level.ERROR, _text(error))
            return TransitionCallbackReturn.FAILURE
        except Exception:  # noqa: BLE001 - rclpy would not log it
            self.ros.log(Level.ERROR, traceback.format_exc())
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Set parameters at run time, or return the reason for a refusal."""
        values = {
            parameter.name: parameter.value
            for parameter in parameters
            if parameter.name in PARAMETERS
        }
        try:
            if values:
                self._change(values)
        except RtamtError as error:
            return SetParametersResult(successful=False, reason=_text(error))
        except Exception as error:  # noqa: BLE001 - rclpy would not answer
            self.ros.log(Level.ERROR, traceback.format_exc())
            return SetParametersResult(successful=False, reason=f"{type(error).__name__}: {error}")
        return SetParametersResult(successful=True)

    def _change(self, changes: Mapping[str, object]) -> None:
        before = self._values()
        values = {**before, **changes}
        specifications, settings = read(values, runnable=self._monitor is not None)
        if self._monitor is None:
            return
        for name in ("qos", "depth"):
            if values[name] != before[name] and self._monitor.running:
                raise InputError(
                    f"{name} is fixed while the node is active: deactivate it, then set {name}"
                )
        self._monitor.replace(_checked(specifications), settings)
        self._set_subscriptions(values)

    def _set_subscriptions(self, values: Mapping[str, Any]) -> None:
        self.ros.qos, self.ros.depth = values["qos"], values["depth"]

    def _values(self) -> dict[str, Any]:
        return {name: self.node.get_parameter(name).value for name in PARAMETERS}


class _Node(LifecycleNode):  # type: ignore[misc] # rclpy has no types
    """The node of rclpy, which passes transitions and parameters to its monitor."""

    def __init__(
        self,
        monitor: LifecycleMonitor,
        parameters: Mapping[str, object],
        name: str,
        *,
        context: Context,
    ) -> None:
        overrides = [Parameter(parameter, value=value) for parameter, value in parameters.items()]
        super().__init__(name, context=context, parameter_overrides=overrides)
        for parameter, (default, meaning) in PARAMETERS.items():
            descriptor = ParameterDescriptor(
                description=meaning,
                dynamic_typing=parameter in _SEVERAL_TYPES,
                read_only=parameter == "autostart",
            )
            try:
                self.declare_parameter(parameter, default, descriptor)
            except ParameterException as error:
                raise InputError(f"parameter {parameter}: {error}") from error
        for parameter in self._parameter_overrides:  # rclpy ignores undeclared parameters
            if not self.has_parameter(parameter) and not parameter.startswith("qos_overrides."):
                self.get_logger().warning(
                    f"no parameter {parameter}{nearest(parameter, PARAMETERS)}"
                )
        self.add_on_set_parameters_callback(monitor.set)
        self._monitor = monitor

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._monitor.transition(self._monitor.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._monitor.transition(self._monitor.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._monitor.transition(self._monitor.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        return self._monitor.transition(self._monitor.clean_up)

    # All three leave the node as new.
    on_shutdown = on_cleanup
    on_error = on_cleanup


def run(
    name: str = "stl_monitor",
    arguments: Sequence[str] = (),
    parameters: Mapping[str, object] | None = None,
) -> int:
    """Run a `LifecycleMonitor` until SIGINT or SIGTERM.

    Returns:
        0, or 2 if the node could not activate itself; the log has the reason.
    """
    monitor = LifecycleMonitor(name, arguments, parameters)
    try:
        if monitor.node.get_parameter("autostart").value and not monitor.autostart():
            return 2
        shorten_pauses()
        code = monitor.ros.spin()
        monitor.clean_up()
    finally:
        monitor.ros.close()
    return code


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the program ``stl_monitor`` of ``ros2 run``, which has parameters but no options.

    Args:
        arguments: The words of a command line; None for the words of the program.
    """
    rows = [
        f"  {name:<10} {meaning}" + (f" ({default})" if default not in {"", None} else "")
        for name, (default, meaning) in PARAMETERS.items()
    ]
    parser = argparse.ArgumentParser(
        prog="ros2 run rtamt_ros stl_monitor",
        description="Monitors the topics that specifications name, as a lifecycle node.",
        usage="%(prog)s --ros-args -p spec_file:=FILE [-p PARAMETER:=VALUE ...]",
        epilog="\n".join(["parameters:", *rows]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    words = sys.argv[1:] if arguments is None else arguments
    parser.parse_known_args(words)  # `Ros2` raises errors for unknown arguments
    try:
        code = run(arguments=words)
    except RtamtError as error:
        parser.error(str(error))
    sys.exit(code)


def _checked(specifications: list[Specification]) -> list[Specification]:
    if not specifications:
        raise InputError("nothing to monitor: set the parameter spec or spec_file")
    return specifications


def _text(error: RtamtError) -> str:
    """Return the text of an error after its notes, such as the file."""
    return ": ".join([*getattr(error, "__notes__", ()), str(error)])
