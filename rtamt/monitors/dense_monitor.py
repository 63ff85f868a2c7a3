"""Monitors of events in dense time: the robustness at every time, and of an episode with bounds."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, TypeVar, Unpack

from rtamt.inputs.event_reader import EventReader
from rtamt.machines.backend import BACKENDS
from rtamt.machines.protocols import DenseEpisodeMachine, DenseMachine, End
from rtamt.machines.state import verdict_of
from rtamt.monitors.online import (
    EpisodeValues,
    MachineValue,
    NamedValues,
    Online,
    machine_value,
)
from rtamt.monitors.options import (
    EventOptions,
    Interpolation,
    Options,
    Spec,
    check_interpolation,
    checked_end,
    compiled_dense,
    compiled_regions,
    described,
    listed_in_signature,
)
from rtamt.monitors.verdict import Verdict
from rtamt.program.dense_lowering import DenseProgram, compile_dense
from rtamt.program.timing import Period

_M = TypeVar("_M", DenseMachine, DenseEpisodeMachine)

_UPDATE = """Update the monitor with new events; return the breakpoints that they settle.

A call that raises an error leaves the monitor as it was.

Args:
    events: A mapping from variables to a sequence of (time, value), an array of shape (n, 2), or
        `Events`; or the same by keyword, ``update(x=[(0, 1.5)])``. Variables may be absent. For
        variables that are fields, such as ``cmd.linear.x``, pass the message: ``{"cmd": [(time,
        message)]}``.

Returns:
    (time, robustness) wherever the robustness changes before `settled`, each breakpoint once. The
    first is the start of the trace.

Raises:
    InputError: On an unknown variable, a message without the field, times that do not increase
        (also from one call to the next), two events of a variable on one tick, a time of 2^62 ticks
        or more, numbers together with `numpy.datetime64`, a nan, or a term that is not a number
        (``sqrt(-1)``) at any time of the trace.
    InputTypeError: On values that are not real numbers.
    StateError: After `finish`.
"""


_EPISODE_UPDATE = """Update the monitor with new events; return the robustness of the trace so far.

A call that raises an error leaves the monitor as it was.

Args:
    events: As for `DenseMonitor`.

Returns:
    `robustness`: nan until every variable has an event.

Raises:
    InputError: As `DenseMonitor.update`, and on a trace that with the bounds of the formula lasts
        2^62 ticks or more.
    InputTypeError: On values that are not real numbers.
    StateError: After `finish`.
"""


class _Dense(Online[_M, DenseProgram]):
    """A monitor of events."""

    __slots__ = ()

    def _arguments(self) -> dict[str, Any]:
        return super()._arguments() | {"resolution": self.resolution}

    @property
    def resolution(self) -> Fraction:
        """The length of a tick in seconds, exactly."""
        return self.program.resolution

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables: in order of declaration, else of first appearance."""
        return self.program.program.variables

    finished: MachineValue[bool] = machine_value(
        "finished", "Whether `finish` has ended the trace."
    )

    def reset(self) -> None:
        """Forget every event."""
        self._machine.reset()


class DenseMonitor(NamedValues, _Dense[DenseMachine]):
    """A monitor of the robustness over dense time, from events at any times.

    Signals are right-continuous step functions: a value lasts until the variable's next event. The
    robustness is also a step function, and exact: nothing is sampled. The trace starts when the
    last variable has its first event; a declared value counts from the start. The robustness of a
    time is returned once, when every variable has an event later than that by `horizon`, for chunks
    of any size. The monitor stores the events inside the longest windows, and events of variables
    that run ahead.

    Future operators need an end, except a top-level ``always p`` or ``eventually p``: there
    ``update`` returns the minimum or maximum robustness of p so far. Times and bounds without a
    unit are in the unit of the specification, seconds by default. If times are `numpy.datetime64`,
    so are returned times. Operators on neighbouring samples (`prev`, `next`, `rise`, `fall`) are
    an error.

    Args:
        spec: Text, a formula, or a parsed specification.
        resolution: The length of a tick, in seconds or as text with a unit. Times of events go to
            the nearest tick, bounds are whole numbers of ticks.
        interpolation: The value of a signal between events: ``"previous"``, the last value.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Raises:
        SpecificationError: On text that is not a specification, operators on neighbouring samples,
            a future operator without an end, a formula without variables, or bounds that are not a
            whole number of ticks or are 2^62 ticks or more.
        InputError: As for `Monitor`.

    Example:
        >>> import rtamt
        >>> m = rtamt.dense.Monitor("always[0:2](speed < 10)")
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
        check_interpolation(interpolation)
        self.specification, self.interface, self.backend, self.program = compiled_dense(
            type(self), spec, resolution, options, online=True
        )
        program = self.program.program
        observed = tuple(program.outputs.values())
        make = BACKENDS[self.backend].dense_machine
        self._runs(make(self.program, EventReader(self.program), observed))
        self.update = self._machine.update

    @property
    def interpolation(self) -> Interpolation:
        """The value of a signal between events: ``"previous"``, the last value."""
        return "previous"

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
        "The time before which the robustness has been returned: the earliest of the variables' "
        "last times, minus `horizon`; -inf until every variable has an event; after `finish`, the "
        "end.",
    )

    def finish(self) -> list[tuple[float, float]]:
        """End the trace, and return the remaining breakpoints.

        The trace ends at the earliest of the variables' last events, and windows are cut to it. The
        end is an instant of the trace: it is the last breakpoint if the robustness there differs
        from the value just before. Further calls return nothing.

        Raises:
            StateError: If a variable has no event.
            InputError: If all variables are never known at the same time.
        """
        return self._machine.finish()

    def __repr__(self) -> str:
        return f"<DenseMonitor of {self.specification.formula}, horizon {self.horizon:g}>"


@described("max_gap")
class DenseEpisodeMonitor(EpisodeValues[float, bool], _Dense[DenseEpisodeMachine]):
    """A monitor of the robustness of a whole trace in dense time, with bounds after every update.

    The robustness is about the start of the trace, the first time when all variables are known;
    write invariants with ``always(...)``. Future operators need no end. The trace so far ends at
    `settled`, the earliest of the variables' last events. After every update

    * ``robustness`` is the robustness if the trace ends there, where windows are cut to it;
    * ``lower`` and ``upper`` bound the robustness over all continuations and ends: ``lower`` never
      falls, ``upper`` never rises;
    * ``verdict`` is decided as soon as both have the same sign bit, at the time `decided_at`.

    With ``nan="unknown"`` an event may be nan or an `UncertainValue`; the bounds hold for all
    values that it may have, and ``robustness`` is the minimum. Events come in chunks of any size. A
    variable has its declared default until its first event, which must be later than `settled`.

    Args:
        spec: Text, a formula, or a parsed specification.
        resolution: As for `rtamt.dense.Monitor`.
        nan: ``"raise"`` refuses nan and uncertain values; ``"unknown"`` reads nan as an unknown
            value until the next event.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Raises:
        SpecificationError: As for `rtamt.dense.Monitor`, but future operators need no end; if too
            many operators without an end are nested.
        InputError: As for `Monitor`.

    Example:
        >>> import rtamt
        >>> m = rtamt.dense.EpisodeMonitor("always(speed < 10) and always(gap > 2)")
        >>> m.update({"speed": [(0, 4), (1.5, 8)], "gap": [(0, 9), (1, 5)]}), m.verdict.name
        (3.0, 'UNDECIDED')
        >>> m.lower, m.upper, m.settled
        (-inf, 3.0, 1.0)
        >>> m.update({"speed": [(2.5, 12), (4, 6)], "gap": [(4, 5)]}), m.verdict.name
        (-2.0, 'VIOLATED')
        >>> m.decided_at
        2.5
    """

    __slots__ = {
        "max_gap": "The maximum time in seconds over which a value holds; None without a limit.",
        "nan": 'How nan is read: ``"raise"`` or ``"unknown"``.',
        "update": _EPISODE_UPDATE,
    }

    update: Callable[..., float]

    @listed_in_signature(EventOptions)
    def __init__(
        self, spec: Spec, *, resolution: Period = "1ns", **options: Unpack[EventOptions]
    ) -> None:
        (
            self.specification,
            self.interface,
            self.backend,
            self.nan,
            self.max_gap,
            regions,
        ) = parts = compiled_regions(type(self), spec, resolution, options)
        program = compile_dense(self.specification, regions.resolution, interface=self.interface)
        self.program = program.result_alone()
        machine = BACKENDS[self.backend].dense_episode_machine(regions, parts.reader())
        self._runs(machine)
        self.update = self._machine.update

    def _arguments(self) -> dict[str, Any]:
        return super()._arguments() | {"nan": self.nan, "max_gap": self.max_gap}

    settled: MachineValue[float] = machine_value(
        "settled",
        "The end of the trace so far: the earliest of the variables' last times; -inf until all "
        "variables are known at one time.",
    )
    decided_at: MachineValue[float | None] = machine_value(
        "decided_at",
        "The first tick such that the trace up to it decides the verdict, whatever follows: a time "
        "of the kind of the events' times; None before a decision, and if the end decided.",
    )

    @property
    def verdict(self) -> Verdict:
        """The verdict, decided as soon as both bounds have the same sign bit."""
        return Verdict(verdict_of(self.lower, self.upper))

    def bounds(self) -> tuple[float, float]:
        """Return `lower` and `upper` as a pair."""
        return self.lower, self.upper

    def finish(self, end: End = "complete") -> float:
        """End the trace at `settled`: make bounds and verdict final.

        `EpisodeMonitor.finish` describes the end modes. Further calls change nothing.

        Args:
            end: The end mode: ``"complete"``, ``"cut"`` or ``"open"``.

        Returns:
            ``robustness``, the robustness of the complete trace, moved to the bounds.

        Raises:
            InputError: On another end mode, or if all variables are never known at the same time;
                then the trace continues.
            StateError: If a variable has no event.

        Example:
            >>> import rtamt
            >>> for end in ("complete", "cut", "open"):
            ...     m = rtamt.dense.EpisodeMonitor("eventually[0:3](x > 4)")
            ...     robustness = m.update({"x": [(0, 1), (2, 3)]})
            ...     print(m.finish(end), m.lower, m.upper, m.verdict.name)
            -1.0 -1.0 -1.0 VIOLATED
            -1.0 -1.0 inf UNDECIDED
            -1.0 -1.0 inf UNDECIDED
        """
        return self._machine.finish(checked_end(end))

    def __repr__(self) -> str:
        return f"<DenseEpisodeMonitor of {self.specification.formula}, {self.verdict.name}>"
