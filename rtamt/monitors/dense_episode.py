"""The monitor of a whole trace in dense time."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, Unpack

from rtamt.inputs.samples import NanPolicy
from rtamt.machines.backend import BACKENDS
from rtamt.machines.protocols import DenseEpisodeMachine, End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.online import DirectUpdate, MachineValue, Online, machine_value
from rtamt.monitors.options import (
    EventOptions,
    Spec,
    checked_end,
    compiled_dense,
    event_reader,
    listed_in_signature,
)
from rtamt.monitors.verdict import Verdict
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.dense_regions import compile_regions
from rtamt.program.timing import Period, as_period

__all__ = ["DenseEpisodeMonitor"]

_UPDATE = """Take in new events, and give the robustness of the trace so far.

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


class DenseEpisodeMonitor(DirectUpdate, Online[DenseEpisodeMachine, DenseProgram]):
    """The robustness of a whole trace in dense time, and its bounds, as events come.

    It is `EpisodeMonitor` for events: everything is about the begin of the trace, the first time at
    which all variables are known, and exact at that instant; invariants are written
    ``always(...)``. Future operators need no end. The trace so far ends at the earliest of the
    variables' last events, `settled`, an instant that is known. After every update

    * ``robustness`` is the one that the trace has if it ends there, where windows are cut to it;
    * ``lower`` and ``upper`` bound the robustness whatever follows, nothing too: ``lower`` never
      falls, ``upper`` never rises, and the robustness of this and every later end lies between;
    * ``verdict`` is decided as soon as both have the same sign bit, `decided_at` says since when.

    With ``nan="unknown"`` an event may be nan or a `Between`: until its next event the variable may
    be any number, or lies between two. The bounds hold for whatever it is, as for unknown samples;
    ``robustness`` is the least.

    Events come in chunks of any size, each variable at its own pace; what is said of a time does
    not depend on the chunks. A variable with a declared value has it until its first event, and
    nothing waits for it: that event must come later than `settled`. Memory holds the events inside
    the longest windows, and events of variables that run ahead.

    Args:
        spec: Text, a formula, or a parsed specification.
        resolution: As for `DenseMonitor`.
        nan: What an event of nan is: ``"raise"``, an error; ``"unknown"``, a value of which nothing
            is known until the variable's next event. A `Between` is an error under ``"raise"`` too.
        max_gap: The longest time, in seconds or as text with a unit, between neighbouring events of
            a variable that its value lasts: in a longer one it is unknown from one tick after the
            first event up to the second. None: it lasts however long.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Raises:
        SpecificationError: As for `DenseMonitor`, but futures need no end; on too many operators
            without an end inside others.
        InputError: As for `Monitor`, and on another ``nan``.

    Example:
        >>> m = DenseEpisodeMonitor("always(speed < 10) and always(gap > 2)")
        >>> m.update({"speed": [(0, 4), (1.5, 8)], "gap": [(0, 9), (1, 5)]}), m.verdict.name
        (3.0, 'UNDECIDED')
        >>> m.lower, m.upper, m.settled
        (-inf, 3.0, 1.0)
        >>> m.update({"speed": [(2.5, 12), (4, 6)], "gap": [(4, 5)]}), m.verdict.name
        (-2.0, 'VIOLATED')
        >>> m.decided_at
        2.5

    Source: as for `EpisodeMonitor`.
    """

    __slots__ = {
        "max_gap": "The longest time between events that leaves no hole, in seconds; or None.",
        "nan": 'What an event of nan is: ``"raise"`` or ``"unknown"``.',
        "update": _UPDATE,
    }

    update: Callable[..., float]

    @listed_in_signature(EventOptions)
    def __init__(
        self, spec: Spec, *, resolution: Period = "1ns", **options: Unpack[EventOptions]
    ) -> None:
        self.specification, self.interface, self.backend, whole = compiled_dense(
            type(self), spec, resolution, options, online=False, bounds=True
        )
        regions = compile_regions(self.specification, whole.resolution, interface=self.interface)
        self.program = whole.result_alone()
        make = BACKENDS[self.backend].dense_episode_machine
        reader = event_reader(self.program, options)
        self.nan: NanPolicy = reader.nan
        self.max_gap = as_period(options.get("max_gap"), "max_gap")
        self._runs(make(regions, reader))
        self.update = self._machine.update

    def _arguments(self) -> dict[str, Any]:
        its = {"resolution": self.resolution, "nan": self.nan, "max_gap": self.max_gap}
        return super()._arguments() | its

    @property
    def resolution(self) -> Fraction:
        """The length of a tick in seconds, exactly."""
        return self.program.resolution

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables: in order of declaration, else of first appearance."""
        return self.program.program.variables

    robustness: MachineValue[float] = machine_value(
        "robustness", "Robustness if the trace ended at `settled`; nan before there is one."
    )
    lower: MachineValue[float] = machine_value(
        "lower", "The least robustness over all continuations and ends."
    )
    upper: MachineValue[float] = machine_value(
        "upper", "The greatest robustness over all continuations and ends."
    )
    settled: MachineValue[float] = machine_value(
        "settled",
        "The end of the trace so far: the least of the variables' last times; -inf until all "
        "variables are known at one time.",
    )
    decided_at: MachineValue[float | None] = machine_value(
        "decided_at",
        "The first tick such that the trace up to it decides the verdict, whatever follows: a time "
        "of the kind of the events' times; None while there is none, and if the end decided.",
    )
    finished: MachineValue[bool] = machine_value(
        "finished", "Whether `finish` has ended the trace."
    )

    @property
    def verdict(self) -> Verdict:
        """The verdict, decided as soon as both bounds have the same sign bit."""
        return Verdict(verdict_of(self.lower, self.upper))

    def bounds(self) -> tuple[float, float]:
        """Give `lower` and `upper` as a pair."""
        return self.lower, self.upper

    def finish(self, end: End = "complete") -> float:
        """End the trace at `settled`: make bounds and verdict final, give the robustness.

        `EpisodeMonitor.finish` describes the readings of the end. Calling it again changes nothing,
        whatever the reading.

        Args:
            end: The reading of the end: ``"complete"``, ``"cut"`` or ``"open"``.

        Returns:
            ``robustness``: it judges the complete trace, moved to the bounds.

        Raises:
            InputError: On another reading, or if there is no time at which all variables are known;
                then the trace goes on.
            StateError: If a variable has no event.

        Example:
            >>> for end in ("complete", "cut", "open"):
            ...     m = DenseEpisodeMonitor("eventually[0:3](x > 4)")
            ...     robustness = m.update({"x": [(0, 1), (2, 3)]})
            ...     print(m.finish(end), m.lower, m.upper, m.verdict.name)
            -1.0 -1.0 -1.0 VIOLATED
            -1.0 -1.0 inf UNDECIDED
            -1.0 -1.0 inf UNDECIDED
        """
        return self._machine.finish(checked_end(end))

    def reset(self) -> None:
        """Forget every event."""
        self._machine.reset()

    def __repr__(self) -> str:
        return f"<DenseEpisodeMonitor of {self.specification.formula}, {self.verdict.name}>"
