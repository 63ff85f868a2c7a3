"""The facade: monitors of one signal, sample by sample."""

from __future__ import annotations

import enum
import functools
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, Protocol, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import StateError
from rtamt.inputs.messages import write_fields
from rtamt.inputs.samples import Columns, NanPolicy, SampleReader
from rtamt.machines.backend import (
    Backend,
    DiscreteMachine,
    EpisodeMachine,
    Machine,
    discrete_machine,
    episode_machine,
)
from rtamt.monitors.explanation import Explanation, explain
from rtamt.monitors.history import Recorder
from rtamt.monitors.online import DirectUpdate, Online, Spec
from rtamt.program.interface import Names, Semantics
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["EpisodeMonitor", "Monitor", "Spec", "Verdict"]


_UPDATE = """Take in one sample{result}

The sample is given by keyword (``update(x=1.0, y=2.0)``), as one mapping, by position in the order
of ``variables``, or as one 1-D array or list in that order. Integers, booleans and numpy scalars
are converted; +-inf is legal. Of a variable that is a field, such as ``cmd.linear.x``, the message
may be given, an object with attributes or a mapping: ``update(cmd=message)``.

Raises:
    InputError: On a missing or unknown variable, a wrong count or shape, a message without the
        field, a nan, or a term that is not a number (``sqrt(-1)``). The monitor is as it was before
        the call.
    InputTypeError: On a value that is no real number, or a message of another class than the text
        declares; likewise.
"""


_M = TypeVar("_M", bound=Machine)


class _Single(DirectUpdate, Online[_M]):
    """One signal: samples as arguments."""

    __slots__ = ("_reader",)

    update: Callable[..., float]

    def __init__(
        self,
        spec: Spec,
        period: Period | None = None,
        *,
        backend: Backend = "auto",
        nan: NanPolicy = "raise",
        semantics: Semantics = "standard",
        inputs: Names | None = None,
        outputs: Names | None = None,
    ) -> None:
        super().__init__(
            spec,
            period,
            backend=backend,
            nan=nan,
            semantics=semantics,
            inputs=inputs,
            outputs=outputs,
        )
        self.update = self._machine.update

    def _made(self) -> _M:
        self._reader = SampleReader(self.program, self._nan)
        return self._machine_of(self._reader)

    def _machine_of(self, reader: SampleReader) -> _M:
        raise NotImplementedError

    @property
    def samples(self) -> int:
        """Samples taken in since the monitor was made or reset."""
        return self._machine.samples

    def reset(self) -> None:
        """Forget every sample."""
        self._machine.reset()


class Monitor(_Single[DiscreteMachine]):
    """Robustness at every sample, late by a known latency.

    At sample t, ``update`` gives the robustness at time ``t - latency``: positive, satisfied by
    that margin; negative, violated by it. The first ``latency`` values are nan. Every value equals
    the one of `evaluate` wherever the formula's future lies inside the trace. An update costs the
    same whatever the length of the windows.

    Future operators need an end (``eventually[0:5]``), except a top-level ``always p`` or
    ``eventually p``: there ``update`` gives the least or greatest robustness of p so far.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: Seconds between samples, as a number or as text (``"100ms"``). None: the bounds of
            the formula are numbers of samples.
        backend: ``"auto"`` takes the C++ machine where it was built.
        nan: ``"raise"`` refuses nan; ``"hold"`` keeps the variable's last value.
        semantics: ``"standard"``, or an interface-aware one: ``"output-robustness"``,
            ``"input-vacuity"``, ``"input-robustness"`` or ``"output-vacuity"``.
        inputs: Variables that the system reads; a message stands for its fields. None: those that
            the text declares ``input``. Only interface-aware semantics ask for them.
        outputs: Variables that the system sets; likewise.

    Raises:
        SpecificationError: On text that is no specification, bounds that are no whole number of
            periods, or a future without end.

    Example:
        >>> m = Monitor("always[0:2](x > 1)")
        >>> m.latency, m.variables
        (2, ('x',))
        >>> [m.update(x=value) for value in (5, 4, 3, 0)]
        [nan, nan, 2.0, -1.0]

    Source: Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors from STL", ATVA 2020.
    """

    __slots__ = {"update": _UPDATE.format(result=" and give the robustness at time t - latency.")}

    def _compiled(self) -> Program:
        return compile_program(
            self.specification, self._period, interface=self.interface, online=True
        )

    def _machine_of(self, reader: SampleReader) -> DiscreteMachine:
        return discrete_machine(self.backend, self.program, reader, (self.program.result,))

    @property
    def latency(self) -> int:
        """Samples by which the robustness is late."""
        return self.program.latency or 0

    @property
    def values(self) -> dict[str, float]:
        """Current robustness of every named formula, each late by its own latency; nan before."""
        seen, registers = self._machine.samples, self._machine.registers
        return {
            name: registers[register] if seen > self.latencies[name] else math.nan
            for name, register in self.program.outputs.items()
        }

    @property
    def latencies(self) -> dict[str, int]:
        """Samples by which the value of every named formula is late."""
        return {n: self.program.latencies[r] or 0 for n, r in self.program.outputs.items()}

    def write(self, messages: Mapping[str, object] | None = None, /, **named: object) -> bool:
        """Set fields of messages to the values of the formulas that are named after them.

        Where the text says ``out.value = always(...)``, ``write(out=message)`` sets the field
        ``value`` of the message to ``values["out.value"]``: nan before its latency has passed.

        Args:
            messages: Objects with attributes, or mappings, by name.
            named: The same by keyword.

        Returns:
            Whether every value written is a number.

        Raises:
            InputError: If no formula is named after a field of the message, or the message has no
                such field (a mapping need not have it). No message is changed.
            InputTypeError: If a message is of another class than the text declares; likewise.

        Example:
            >>> monitor, message = Monitor("out.value = always[0:1](x > 0)"), {}
            >>> for x in (3.0, 1.0):
            ...     monitor.update(x), monitor.write(out=message), message
            (nan, False, {'value': nan})
            (1.0, True, {'value': 1.0})
        """
        return write_fields(self.specification, self.values, messages, named)

    def update_many(self, block: Columns) -> NDArray[np.float64]:
        """Take in a block of samples; what `update` gives for each, as an array.

        Args:
            block: A mapping of every variable to its n values, or of a message to its n (a data
                frame too), and of nothing else, or an array of shape (n, variables).

        Returns:
            n values; those of the first ``latency`` samples since the reset are nan.

        Raises:
            InputError: As `update` does; then no sample of the block was taken in.
            InputTypeError: Likewise.
        """
        machine = self._machine
        columns, n = self._reader.block(block, machine.samples, machine.inputs)
        return machine.run(columns, n, final=False)[0]

    def __repr__(self) -> str:
        return f"<Monitor of {self.specification.formula}, latency {self.latency}>"


class _MachineValue(Protocol):
    """A read-only attribute that the machine holds."""

    def __get__(self, monitor: object, owner: object) -> float: ...


def _machine_value(name: str, doc: str) -> _MachineValue:
    return cast("_MachineValue", property(operator.attrgetter(f"_machine.{name}"), doc=doc))


class Verdict(enum.IntEnum):
    """What is certain about an episode."""

    VIOLATED = -1
    """No continuation can satisfy the specification: the upper bound is below 0."""
    UNDECIDED = 0
    """The bounds do not exclude 0."""
    SATISFIED = 1
    """No continuation can violate the specification: the lower bound is above 0."""


# Attributes of an enumeration cost more than the rest of what reads them.
_VIOLATED, _UNDECIDED, _SATISFIED = Verdict


class EpisodeMonitor(_Single[EpisodeMachine]):
    """The robustness of a whole episode, and its bounds over all continuations, at every sample.

    Everything is about time 0 of the episode, as STL defines satisfaction; invariants are written
    ``always(...)``. Future operators need no end. After every sample

    * ``robustness`` is the one that the episode has if it ends now: `evaluate`'s for sample 0;
    * ``lower`` and ``upper`` bound the robustness over all ways to go on for ever (the robust
      satisfaction interval): a predicate at an unseen sample lies in [-inf, +inf], and bounds go
      through the formula by interval arithmetic. ``lower`` never falls, ``upper`` never rises;
    * ``verdict`` is decided as soon as the bounds exclude 0: a violation is known at the first
      sample at which interval arithmetic shows that nothing can save the episode.

    ``lower <= robustness <= upper`` holds but for one case: where a window is empty because the
    trace ends (``eventually[5:9]`` of a trace of 3 samples is -inf, ``always[5:9]`` +inf, under
    any polarity), ``robustness`` may lie outside the bounds, which speak of longer traces.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: Seconds between samples, as a number or as text (``"100ms"``). None: the bounds of
            the formula are numbers of samples.
        backend: ``"auto"`` takes the fastest machine that there is.
        nan: ``"raise"`` refuses nan; ``"hold"`` keeps the variable's last value.
        semantics: ``"standard"``, or an interface-aware one: ``"output-robustness"``,
            ``"input-vacuity"``, ``"input-robustness"`` or ``"output-vacuity"``.
        inputs: Variables that the system reads; a message stands for its fields. None: those that
            the text declares ``input``. Only interface-aware semantics ask for them.
        outputs: Variables that the system sets; likewise.
        history: Whether to keep the samples for `explain`: 8 bytes a value, until the reset.

    Raises:
        SpecificationError: On text that is no specification, bounds that are no whole number of
            periods, or too many operators without an end inside others.

    Example:
        >>> e = EpisodeMonitor("always[0:100](x > 1)")
        >>> e.update(x=5), e.lower, e.upper, e.verdict.name
        (4.0, -inf, 4.0, 'UNDECIDED')
        >>> e.update(x=0), e.lower, e.upper, e.verdict.name
        (-1.0, -inf, -1.0, 'VIOLATED')

    Source: Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors from STL", ATVA 2020; bounds
    after Deshmukh et al., "Robust online monitoring of signal temporal logic", FMSD 2017.
    """

    __slots__ = {
        "bounds": "Give `lower` and `upper`, in less than half of the time of reading both.",
        "update": _UPDATE.format(result=" and give the robustness if the episode ended with it.")
        + "    StateError: After `finish`.\n",
    }

    bounds: Callable[[], tuple[float, float]]

    def __init__(
        self,
        spec: Spec,
        period: Period | None = None,
        *,
        backend: Backend = "auto",
        nan: NanPolicy = "raise",
        semantics: Semantics = "standard",
        inputs: Names | None = None,
        outputs: Names | None = None,
        history: bool = False,
    ) -> None:
        super().__init__(
            spec,
            period,
            backend=backend,
            nan=nan,
            semantics=semantics,
            inputs=inputs,
            outputs=outputs,
        )
        self.bounds = self._machine.bounds
        if history:
            self._machine = Recorder(self._machine)
            self.update = self._machine.update

    def _compiled(self) -> Program:
        return compile_program(self.specification, self._period, interface=self.interface)

    def _machine_of(self, reader: SampleReader) -> EpisodeMachine:
        return episode_machine(self.backend, self.program, reader)

    # Read after every update: attrgetter needs half the time of a property in Python.
    robustness = _machine_value(
        "robustness", "Robustness if the episode ended with the last sample; nan before the first."
    )
    lower = _machine_value("lower", "The least robustness over all continuations.")
    upper = _machine_value("upper", "The greatest robustness over all continuations.")

    @property
    def verdict(self) -> Verdict:
        """What is certain."""
        if self._machine.upper < 0.0:
            return _VIOLATED
        return _SATISFIED if self._machine.lower > 0.0 else _UNDECIDED

    @property
    def finished(self) -> bool:
        """Whether `finish` has ended the trace."""
        return self._machine.finished

    def finish(self) -> float:
        """End the trace with the last sample, and give its robustness.

        Both bounds become the robustness, unless the verdict was decided: a verdict and the
        bounds that decided it never change. A robustness of 0 stays UNDECIDED. Calling it again
        changes nothing.

        Raises:
            StateError: Before the first sample.
        """
        return self._machine.finish()

    def explain(self) -> Explanation:
        """Which sub-formulas and samples decided ``robustness``, as `rtamt.explain` says it.

        Raises:
            StateError: Without ``history=True``, or before the first sample.

        Example:
            >>> e = EpisodeMonitor("always(x > 1)", history=True)
            >>> e.update(x=5), e.update(x=0), e.update(x=2)
            (4.0, -1.0, -1.0)
            >>> e.explain().causes
            (Cause(variable='x', sample=1, value=0.0),)
        """
        machine = self._machine
        if not isinstance(machine, Recorder):
            msg = "explain() needs the samples of the episode; make the monitor with history=True"
            raise StateError(msg)
        return explain(
            self.specification,
            machine.table,
            self._period,
            n=machine.samples,
            backend=self.backend,
            semantics=self.interface.semantics,
            inputs=self.interface.inputs,
            outputs=self.interface.outputs,
        )

    def __reduce__(self) -> tuple[Callable[..., Self], tuple[Any, ...], Any]:
        make, *rest = super().__reduce__()
        return functools.partial(make, history=isinstance(self._machine, Recorder)), *rest

    def __repr__(self) -> str:
        return f"<EpisodeMonitor of {self.specification.formula}, {self.verdict.name}>"
