"""Robustness over dense time: a monitor of events, and the evaluation of whole signals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, Literal, Unpack

from rtamt.errors import InputError
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Events, EventsLike
from rtamt.machines.backend import BACKENDS
from rtamt.machines.protocols import DenseMachine
from rtamt.monitors.online import DirectUpdate, MachineValue, NamedValues, Online, machine_value
from rtamt.monitors.options import Options, Spec, compiled_dense, listed_in_signature
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.timing import Period

__all__ = ["DenseMonitor", "evaluate_dense"]

Interpolation = Literal["previous"]

_UPDATE = """Take in new events, and give the breakpoints that are settled by them.

A call that raises an error leaves the monitor as it was.

Args:
    events: A mapping from variables to a sequence of (time, value), an array of shape (n, 2), or
        `Events`; or the same by keyword, ``update(x=[(0, 1.5)])``. A variable that is absent or
        whose events are empty has no new ones. For variables that are fields, such as
        ``cmd.linear.x``, the message may be given: ``{"cmd": [(time, message)]}``.

Returns:
    (time, robustness) wherever the robustness changes before `settled`; each once. The first is
    where the trace begins.

Raises:
    InputError: On an unknown variable, a message without the field, times that do not increase
        (from one call to the next too), two of one variable on one tick, one of 2^62 ticks or more,
        numbers beside `numpy.datetime64`, a nan, or a term that is not a number (``sqrt(-1)``) at
        any time of the trace.
    InputTypeError: On values that are not real numbers.
    StateError: After `finish`.
"""


class DenseMonitor(NamedValues, DirectUpdate, Online[DenseMachine, DenseProgram]):
    """Robustness over dense time, from events that need not come at the same times.

    Signals are right-continuous step functions: a value lasts until the variable's next event.
    The robustness is one too, and exact: nothing is sampled. The trace begins when the last
    variable has its first event; a variable with a declared value has it until then, and nothing
    waits for it. The robustness of a time is given, once and for all, when every
    variable has an event later than that by `horizon`, whatever the chunks in which events come.
    Memory holds the events inside the longest windows, and events of variables that run ahead.

    Future operators need an end, except a top-level ``always p`` or ``eventually p``: there
    ``update`` gives the least or greatest robustness of p so far. Bounds without a unit are in the
    specification's (seconds), and so are the times of events; times may be `numpy.datetime64`, and
    come back as that. Operators on neighbouring samples (`prev`, `next`, `rise`, `fall`) have no
    meaning here.

    Args:
        spec: Text, a formula, or a parsed specification.
        resolution: The length of a tick, in seconds or as text with a unit. Times of events go to
            the nearest tick, bounds are whole numbers of ticks.
        interpolation: The value of a signal between events: ``"previous"``, the last one.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Raises:
        SpecificationError: On text that is not a specification, operators on neighbouring samples,
            a future without an end, a formula without variables, or bounds that are no whole number
            of ticks or 2^62 or more.
        InputError: As for `Monitor`.

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

    __slots__ = {"update": _UPDATE}

    update: Callable[..., list[tuple[float, float]]]

    @listed_in_signature(Options)
    def __init__(
        self,
        spec: Spec,
        *,
        resolution: Period = "1ns",
        interpolation: Interpolation = "previous",
        **options: Unpack[Options],
    ) -> None:
        _check_interpolation(interpolation)
        self.specification, self.interface, self.backend, self.program = compiled_dense(
            type(self), spec, resolution, options, online=True
        )
        program = self.program.program
        observed = tuple(program.outputs.values())
        make = BACKENDS[self.backend].dense_machine
        self._runs(make(self.program, EventReader(self.program), observed))
        self.update = self._machine.update

    def _arguments(self) -> dict[str, Any]:
        return super()._arguments() | {"resolution": self.resolution}

    @property
    def resolution(self) -> Fraction:
        """The length of a tick in seconds, exactly."""
        return self.program.resolution

    @property
    def interpolation(self) -> Interpolation:
        """The value of a signal between events: ``"previous"``, the last one."""
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
        """The last settled robustness of every named formula, late by its own latency.

        nan before there is one; after `finish`, the robustness at the end of the trace.
        """
        return dict(zip(self.program.program.outputs, self._machine.values, strict=True))

    settled: MachineValue[float] = machine_value(
        "settled",
        "The time before which the robustness has been given: the least of the variables' last "
        "times, less `horizon`; -inf until every variable has an event; after `finish`, the end.",
    )
    finished: MachineValue[bool] = machine_value(
        "finished", "Whether `finish` has ended the trace."
    )

    def finish(self) -> list[tuple[float, float]]:
        """End the trace, and give the breakpoints that are left.

        The trace ends at the earliest of the variables' last events, and windows are cut to it. The
        end is an instant of the trace: it is the last breakpoint if the robustness there differs
        from the value just before. Calling it again gives nothing.

        Raises:
            StateError: If a variable has no event.
            InputError: If there is no time at which all variables are known.
        """
        return self._machine.finish()

    def reset(self) -> None:
        """Forget every event."""
        self._machine.reset()

    def __repr__(self) -> str:
        return f"<DenseMonitor of {self.specification.formula}, horizon {self.horizon:g}>"


@listed_in_signature(Options)
def evaluate_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    *,
    resolution: Period = "1ns",
    interpolation: Interpolation = "previous",
    **options: Unpack[Options],
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
        resolution: As for `DenseMonitor`.
        interpolation: As for `DenseMonitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Returns:
        The robustness, a step function too: an event where it begins, wherever it changes, and at
        the end if it changes there. A value that holds at a single instant inside the trace, with
        another before and after, is left out; at the end it is given.

    Raises:
        SpecificationError: As for `DenseMonitor`, except that a future may have no end.
        InputError: On a variable without events, times that `DenseMonitor` refuses, a nan, a term
            that is not a number, or variables that are never known at the same time.
        InputTypeError: On values that are not real numbers.

    Example:
        >>> signals = {"request": [(0, 0), (1, 1), (5, 1)], "grant": [(0, 0), (2.5, 1), (5, 1)]}
        >>> spec = "request > 0.5 implies eventually[0:1](grant > 0.5)"
        >>> list(evaluate_dense(spec, signals))
        [(0.0, 0.5), (1.0, -0.5), (1.5, 0.5)]

    Source: see `DenseMonitor`.
    """
    _check_interpolation(interpolation)
    _, _, backend, whole = compiled_dense(evaluate_dense, spec, resolution, options, online=False)
    program = whole.result_alone()
    reader = EventReader(program)
    machine = BACKENDS[backend].dense_machine(program, reader, ())
    return Events.unchecked(*machine.run(reader.whole(signals)))


def _check_interpolation(interpolation: str) -> None:
    if interpolation != "previous":
        raise InputError(
            "expected interpolation='previous' (a value lasts until the next event), "
            f"got {interpolation!r}"
        )
