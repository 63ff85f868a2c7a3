"""The facade of dense time: a monitor of events, and the evaluation of whole signals."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, Literal, Self

from rtamt.errors import InputError
from rtamt.inputs.events import EventReader, Events, EventsLike
from rtamt.inputs.messages import write_fields
from rtamt.language.parser import as_specification
from rtamt.machines.backend import Backend, DenseMachine, choose, dense_machine
from rtamt.monitors.online import DirectUpdate, Resumable, Spec
from rtamt.program.dense_lowering import compile_dense
from rtamt.program.interface import Names, Semantics, as_interface

__all__ = ["DenseMonitor", "evaluate_dense"]

Interpolation = Literal["previous"]

_UPDATE = """Take in new events, and give the breakpoints that are settled by them.

Args:
    events: A mapping from variables to a sequence of (time, value), an array of shape (n, 2), or
        `Events`; or the same by keyword, ``update(x=[(0, 1.5)])``. A variable that is absent or
        whose events are empty has no new ones. Of variables that are fields, such as
        ``cmd.linear.x``, the message may be given: ``{"cmd": [(time, message)]}``.

Returns:
    (time, robustness) wherever the robustness becomes another one, before `settled`; each once.
    The first is where the trace begins.

Raises:
    InputError: On an unknown variable, a message without the field, times that do not increase
        (from one call to the next too), a nan, or a term that is not a number (``sqrt(-1)``) at any
        time of the trace. The monitor is as it was before the call.
    InputTypeError: On values that are no real numbers; likewise.
    StateError: After `finish`.
"""


class DenseMonitor(DirectUpdate, Resumable[DenseMachine]):
    """Robustness over dense time, from events that need not come at the same times.

    Signals are right-continuous step functions: a value lasts until the variable's next event.
    The robustness is one too, exact, without sampling. The trace begins when the last variable
    has its first event. What has been said never changes: the robustness of a time is given when
    all variables have events later than that by `horizon`, whatever the chunks in which they come.
    Memory holds the events inside the longest windows, and those of variables that run ahead.

    Future operators need an end, except a top-level ``always p`` or ``eventually p``: there
    ``update`` gives the least or greatest robustness of p so far. Bounds without a unit are in the
    specification's (seconds), and so are the times of events. Operators that speak of neighbouring
    samples (`prev`, `next`, `rise`, `fall`) have no meaning here.

    Args:
        spec: Text, a formula, or a parsed specification.
        interpolation: What a signal is between events: ``"previous"``, the last value.
        backend: ``"auto"`` takes the C++ machine where it was built.
        semantics: Which robustness is meant: ``"standard"``, or an interface-aware one,
            ``"output-robustness"``, ``"input-vacuity"``, ``"input-robustness"`` or
            ``"output-vacuity"``.
        inputs: Variables that the system reads; a message stands for its fields. None: those that
            the text declares ``input``. Only interface-aware semantics ask for them.
        outputs: Variables that the system sets; likewise.

    Raises:
        SpecificationError: On text that is no specification, operators that speak of samples, a
            future without end, or a formula without variables.

    Example:
        >>> m = DenseMonitor("always[0:2](speed < 10)")
        >>> m.update({"speed": [(0, 4), (0.5, 8)]})
        []
        >>> m.update({"speed": [(3.5, 5)]}), m.settled
        ([(0.0, 2.0)], 1.5)
        >>> m.finish()
        [(3.5, 5.0)]

    Source: Maler and Nickovic, "Monitoring temporal properties of continuous signals", FORMATS
    2004; Donze, Ferrere and Maler, "Efficient robust monitoring for STL", CAV 2013.
    """

    __slots__ = {
        "backend": "Which machine runs.",
        "interface": "Which robustness is meant.",
        "program": "What it runs.",
        "specification": "What it was made from.",
        "update": _UPDATE,
    }

    update: Callable[..., list[tuple[float, float]]]

    def __init__(
        self,
        spec: Spec,
        *,
        interpolation: Interpolation = "previous",
        backend: Backend = "auto",
        semantics: Semantics = "standard",
        inputs: Names | None = None,
        outputs: Names | None = None,
    ) -> None:
        _check_interpolation(interpolation)
        self.specification = as_specification(spec)
        self.interface = as_interface(self.specification, semantics, inputs, outputs)
        self.backend = choose(backend)
        self.program = compile_dense(self.specification, interface=self.interface, online=True)
        program = self.program.program
        observed = tuple(program.outputs.values())
        self._machine = dense_machine(self.backend, self.program, EventReader(program), observed)
        self.update = self._machine.update

    @property
    def interpolation(self) -> Interpolation:
        """What a signal is between events."""
        return "previous"

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables: in order of declaration, else of first appearance."""
        return self.program.program.variables

    @property
    def horizon(self) -> float:
        """The time by which the robustness is late."""
        return self.program.latency(self.program.program.result)

    @property
    def latencies(self) -> dict[str, float]:
        """The time by which the value of every named formula is late."""
        return {n: self.program.latency(r) for n, r in self.program.program.outputs.items()}

    @property
    def values(self) -> dict[str, float]:
        """The last robustness of every named formula that is settled, each late by its own latency.

        nan before there is one; after `finish`, the robustness at the end of the trace.
        """
        return dict(zip(self.program.program.outputs, self._machine.values, strict=True))

    def write(self, messages: Mapping[str, object] | None = None, /, **named: object) -> bool:
        """Set fields of messages to `values` of the formulas named after them; see `Monitor.write`.

        Raises:
            InputError: If no formula is named after a field of the message, or the message has no
                such field. No message is changed.
            InputTypeError: If a message is of another class than the text declares; likewise.
        """
        return write_fields(self.specification, self.values, messages, named)

    @property
    def settled(self) -> float:
        """The time before which all has been said: the least of the variables' last - `horizon`.

        -inf until every variable has an event; after `finish`, the end of the trace.
        """
        return self._machine.settled

    @property
    def finished(self) -> bool:
        """Whether `finish` has ended the trace."""
        return self._machine.finished

    def finish(self) -> list[tuple[float, float]]:
        """End the trace with the first of the variables' last events, and give what is left.

        Windows are cut to the trace. The end is an instant of it: if its robustness is another
        one than just before, it is the last breakpoint. Calling it again gives nothing.

        Raises:
            StateError: If a variable has no event.
            InputError: If there is no time at which all variables are known.
        """
        return self._machine.finish()

    def reset(self) -> None:
        """Forget every event."""
        self._machine.reset()

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[Any, ...], Any]:
        make = functools.partial(
            type(self),
            backend=self.backend,
            semantics=self.interface.semantics,
            inputs=self.interface.inputs,
            outputs=self.interface.outputs,
        )
        return make, (self.specification,), self._machine.state()

    def __repr__(self) -> str:
        return f"<DenseMonitor of {self.specification.formula}, horizon {self.horizon:g}>"


def evaluate_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    *,
    interpolation: Interpolation = "previous",
    backend: Backend = "auto",
    semantics: Semantics = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
) -> Events:
    """Robustness over a whole trace in dense time.

    Signals are right-continuous step functions: a value lasts until the variable's next event, and
    the last event is an instant, the end. The trace is where all variables are known. Windows are
    closed and cut to the trace: where nothing of the window is left, ``always`` is +inf and
    ``eventually`` -inf. Operators without an end reach to the end of the trace.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: For each variable a sequence of (time, value), an array of shape (n, 2), or
            `Events`. Other variables are ignored.
        interpolation: What a signal is between events: ``"previous"``, the last value.
        backend: ``"auto"`` takes the C++ machine where it was built.
        semantics: Which robustness is meant; see `DenseMonitor`.
        inputs: Variables that the system reads; see `DenseMonitor`.
        outputs: Variables that the system sets; see `DenseMonitor`.

    Returns:
        The robustness, a step function likewise: where it begins, wherever it becomes another
        one, and at the end if it is another one there. Of instants at which it has another value
        than just before and after, only the end is represented.

    Raises:
        SpecificationError: As for `DenseMonitor`, but a future without end is welcome.
        InputError: On a variable without events, times that do not increase, a nan, a term that
            is not a number, or variables that are never known at the same time.
        InputTypeError: On values that are no real numbers.

    Example:
        >>> signals = {"request": [(0, 0), (1, 1), (5, 1)], "grant": [(0, 0), (2.5, 1), (5, 1)]}
        >>> spec = "request > 0.5 implies eventually[0:1](grant > 0.5)"
        >>> list(evaluate_dense(spec, signals))
        [(0.0, 0.5), (1.0, -0.5), (1.5, 0.5)]

    Source: see `DenseMonitor`.
    """
    _check_interpolation(interpolation)
    specification = as_specification(spec)
    interface = as_interface(specification, semantics, inputs, outputs)
    program = compile_dense(specification, interface=interface).result_alone()
    reader = EventReader(program.program)
    machine = dense_machine(backend, program, reader, ())
    return Events(*machine.run(reader.whole(signals)))


def _check_interpolation(interpolation: str) -> None:
    if interpolation != "previous":
        msg = (
            "expected interpolation='previous' (a value lasts until the next event), "
            f"got {interpolation!r}"
        )
        raise InputError(msg)
