"""Monitors of one signal, sample by sample."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from typing import Any, ClassVar, TypeVar, Unpack

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError, StateError
from rtamt.inputs.between import UncertainValue
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.machines.backend import BACKENDS, read_only
from rtamt.machines.protocols import DiscreteMachine, End, EpisodeMachine, SampleMachine
from rtamt.monitors.explainer import explain
from rtamt.monitors.explanation import Explanation
from rtamt.monitors.online import (
    EpisodeValues,
    Late,
    MachineValue,
    NamedValues,
    Sampled,
    machine_value,
)
from rtamt.monitors.options import SampleOptions, Spec, checked_end, described, listed_in_signature
from rtamt.monitors.verdict import Verdict
from rtamt.program.memory import intervals_fit, limit_discrete, limit_episode
from rtamt.program.timing import Period

_UPDATE = """Update the monitor with a sample and return the robustness {when}.

Pass the sample by keyword (``update(x=1.0, y=2.0)``), as one mapping, by position in the order of
``variables``, or as one 1-D array or list in that order. Integers, booleans and numpy scalars are
converted; +-inf is legal. For fields, such as ``cmd.linear.x``, pass the message, an object with
attributes or a mapping: ``update(cmd=message)``. A call that raises an error leaves the monitor as
it was.

Raises:
    InputError: On a missing or unknown variable, a wrong count or shape, a message without the
        field, a nan, or a term that is not a number (``sqrt(-1)``).
    InputTypeError: On a value that is not a real number, or a message of another class than the
        text declares.
"""


_M = TypeVar("_M", bound=SampleMachine)


class _Single(Sampled[_M]):
    """A monitor of one signal: a sample is the arguments of ``update``."""

    __slots__ = ("_reader",)

    _bounds: ClassVar = False
    update: Callable[..., float]

    @listed_in_signature(SampleOptions)
    def __init__(
        self, spec: Spec, period: Period | None = None, **options: Unpack[SampleOptions]
    ) -> None:
        self._compile(spec, period, options)
        self._reader = SampleReader(self.program, self._nan, bounds=self._bounds)
        self._runs(self._made(self._reader))
        self.update = self._machine.update

    def _made(self, reader: SampleReader) -> _M:
        raise NotImplementedError

    samples: MachineValue[int] = machine_value(
        "samples", "The number of samples since the monitor was created or reset."
    )

    def reset(self) -> None:
        """Forget every sample."""
        self._machine.reset()


@described(*SampleOptions.__annotations__)
class Monitor(Late, NamedValues, _Single[DiscreteMachine]):
    """A monitor of the robustness at every sample, late by a known latency.

    At sample t, ``update`` returns the robustness at time ``t - latency``: positive if satisfied by
    that margin, negative if violated; at 0 the sign bit decides (`holds`). The first ``latency``
    values are nan. An update costs the same for windows of any length. Future operators need an
    end (``eventually[0:5]``), except a top-level ``always p`` or ``eventually p``: there
    ``update`` returns the minimum or maximum robustness of p so far.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: Seconds between samples, as a number or text (``"100ms"``). Default: bounds count
            samples.
        **options: See `OPTIONS`.

    Raises:
        SpecificationError: If the text is not a specification, a bound does not fit the period, a
            window is empty after rounding, a future operator has no end, or windows need more than
            `rtamt.limits.window_bytes`.
        InputError: If an option has a wrong value, or the native backend was not built.

    Example:
        >>> m = Monitor("always[0:2](x > 1)")
        >>> [m.update(x=value) for value in (5, 4, 3, 0)]
        [nan, nan, 2.0, -1.0]

    Source: Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors from STL", ATVA 2020.
    """

    __slots__ = {"update": _UPDATE.format(when="at time t - latency")}

    def _made(self, reader: SampleReader) -> DiscreteMachine:
        limit_discrete(self.program)
        return BACKENDS[self.backend].discrete_machine(self.program, reader, (self.program.result,))

    @property
    def values(self) -> dict[str, float]:
        """The last robustness of every named formula, late by its own latency; nan before that."""
        seen, registers = self._machine.samples, self._machine.registers
        return {
            name: registers[register] if seen > self.latencies[name] else math.nan
            for name, register in self.program.outputs.items()
        }

    @property
    def latencies(self) -> dict[str, int]:
        """Samples by which the value of every named formula is late."""
        return {n: self.program.latencies[r] or 0 for n, r in self.program.outputs.items()}

    def update_many(self, block: TraceColumns) -> NDArray[np.float64]:
        """Update the monitor with a block of samples; return the values of `update` as an array.

        A call that raises an error leaves the monitor as it was, unless another thread writes to
        the arrays of the block.

        Args:
            block: A mapping (or data frame) of every variable to its n values, or of a message to
                n messages, without other names; or an array of shape (n, variables).

        Returns:
            n values; nan for the first ``latency`` samples since the reset.

        Raises:
            InputError: As `update` does, and on columns of different length.
            InputTypeError: On values that are not real numbers, or messages of another class than
                the text declares.
        """
        machine = self._machine
        columns, n = self._reader.block(block, machine.samples, machine.inputs)
        return machine.run(columns, n)[0]

    def __repr__(self) -> str:
        return f"<Monitor of {self.specification.formula}, latency {self.latency}>"


class EpisodeMonitor(EpisodeValues[float, bool], _Single[EpisodeMachine]):
    """A monitor of the robustness of a whole episode, with bounds at every sample.

    Write invariants with ``always(...)``; future operators need no end. After every sample

    * ``robustness`` is the robustness if the episode ends now, as `evaluate` returns for sample 0;
    * ``lower`` and ``upper`` bound the robustness over all continuations and all ends, including an
      end now: a predicate at an unseen sample lies in [-inf, +inf], and bounds go through the
      formula by interval arithmetic. ``lower`` never falls, ``upper`` never rises;
    * ``verdict`` is decided as soon as both bounds have the same sign bit (+0.0 holds, -0.0 does
      not), and stays wherever the trace then ends.

    With an `UncertainValue`, the bounds hold for all values in its interval, ``robustness`` is the
    minimum if the episode ends now, and `finish` may leave the verdict undecided.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `Monitor`.
        history: Whether to store the samples for `explain`, with 8 bytes a value, until the reset.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="unknown"`` reads nan as ``UncertainValue(-math.inf, math.inf)``.

    Raises:
        SpecificationError: As for `Monitor`, but future operators need no end; if too many
            operators without an end are nested. Uncertain values double the memory, so `update` may
            raise it at the first of them.
        InputError: As for `Monitor`.

    Example:
        >>> e = EpisodeMonitor("always[0:100](x > 1)")
        >>> e.update(x=5), e.lower, e.upper, e.verdict.name
        (4.0, -inf, 4.0, 'UNDECIDED')
        >>> e.update(x=0), e.lower, e.upper, e.verdict.name
        (-1.0, -inf, -1.0, 'VIOLATED')

        >>> e = EpisodeMonitor("always(x > 1)", nan="unknown")
        >>> e.update(x=5), e.update(x=math.nan), e.finish(), e.upper, e.verdict.name
        (4.0, -inf, -inf, 4.0, 'UNDECIDED')

    Source: Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors from STL", ATVA 2020; bounds
    after Deshmukh et al., "Robust online monitoring of signal temporal logic", FMSD 2017.
    """

    __slots__ = {
        "__weakref__": None,
        "_history": None,
        "lower": "The minimum robustness over all continuations and ends.",
        "robustness": "Robustness if the episode ended now; nan before the first sample.",
        "update": _UPDATE.format(when="that the episode has if it ends now")
        + "    StateError: After `finish`.\n",
        "upper": "The maximum robustness over all continuations and ends.",
        "verdict": "The verdict, decided as soon as both bounds have the same sign bit.",
    }

    _bounds: ClassVar = True
    verdict: MachineValue[Verdict]

    @listed_in_signature(SampleOptions)
    def __init__(
        self,
        spec: Spec,
        period: Period | None = None,
        *,
        history: bool = False,
        **options: Unpack[SampleOptions],
    ) -> None:
        super().__init__(spec, period, **options)
        self._machine.show_in(self, _SHOWN, _VERDICTS)
        self._history: array[float] | None = None
        if history:
            self._history = array("d")
            self.update = _recording(self._machine, self._history, len(self.variables))

    def _made(self, reader: SampleReader) -> EpisodeMachine:
        limit_episode(self.program, unknown=reader.nan == "unknown")
        reader.intervals_fit = intervals_fit(self.program)
        return BACKENDS[self.backend].episode_machine(self.program, reader)

    @property
    def fed_machine(self) -> EpisodeMachine | None:
        """The machine, if the monitor stores no samples and so uses the update of the machine."""
        return self._machine if self._history is None else None

    @property
    def unknown(self) -> tuple[str, ...]:
        """The variables with an `UncertainValue` in the last sample."""
        values = zip(self.variables, self._machine.inputs, strict=False)  # none before the first
        return tuple(name for name, value in values if isinstance(value, UncertainValue))

    def bounds(self) -> tuple[float, float]:
        """Return `lower` and `upper` as a pair."""
        return self.lower, self.upper

    def finish(self, end: End = "complete") -> float:
        """End the trace with the last sample: make bounds and verdict final.

        The bounds become narrower or stay, so a decided verdict never changes:

        * ``"complete"``: nothing follows. Windows are cut to the trace, and both bounds become the
          robustness, whose sign bit is the verdict.
        * ``"cut"``: the trace is a recording of something longer. Samples after the last are
          unknown to bounded windows; a future operator without an end covers the recorded time, and
          has the bounds of ``"open"`` if no sample of its window was recorded. If the robustness
          lies outside the bounds, it is moved to the nearest bound.
        * ``"open"``: anything may follow. The bounds stay as they are.

        Formulas that depend on a predicate that counts 0 under interface-aware semantics have the
        bounds -0.0 and +0.0, and stay UNDECIDED under every end mode. Further calls change nothing.

        Args:
            end: The end mode.

        Returns:
            ``robustness``, the robustness of the complete trace unless it was moved.

        Raises:
            InputError: On another end mode; then the episode continues.
            StateError: Before the first sample.

        Example:
            >>> text = "always(x > 5 implies eventually[0:3](x < 2))"
            >>> for end in ("complete", "cut", "open"):
            ...     e = EpisodeMonitor(text)
            ...     robustness = e.update(x=6)
            ...     print(e.finish(end), e.lower, e.upper, e.verdict.name)
            -1.0 -1.0 -1.0 VIOLATED
            -1.0 -1.0 inf UNDECIDED
            -1.0 -inf inf UNDECIDED

            >>> e = EpisodeMonitor("next(prev(x > 0))")
            >>> e.update(x=-4), e.finish("cut"), e.verdict.name
            (inf, -4.0, 'VIOLATED')
        """
        return self._machine.finish(checked_end(end))

    def explain(self) -> Explanation:
        """Return the sub-formulas and samples that decided ``robustness``; see `rtamt.explain`.

        Raises:
            StateError: Without ``history=True``, or before the first sample.
            InputError: If a sample has an unknown value (`UncertainValue`, ``nan="unknown"``).

        Example:
            >>> e = EpisodeMonitor("always(x > 1)", history=True)
            >>> e.update(x=5), e.update(x=0), e.update(x=2)
            (4.0, -1.0, -1.0)
            >>> e.explain().causes
            (Cause(variable='x', sample=1, value=0.0),)
        """
        if self._history is None:
            raise StateError(
                "explain() needs the samples of the episode; make the monitor with history=True"
            )
        if not self.samples:
            raise StateError("explain() needs at least one sample, got none since reset")
        table = np.array(self._history).reshape(self.samples, len(self.variables))
        if len(unknown := np.argwhere(np.isnan(table))):
            sample, variable = unknown[0]
            raise InputError(
                f"explain() needs samples that are known, and '{self.variables[variable]}' is not "
                f"known at sample {sample}"
            )
        return explain(self.specification, table, n=self.samples, **super()._arguments())

    def reset(self) -> None:
        """Forget every sample."""
        self._machine.reset()
        if self._history is not None:
            del self._history[:]

    def _arguments(self) -> dict[str, Any]:
        return super()._arguments() | {"history": self._history is not None}

    def _state(self) -> object:
        state = self._machine.state()
        return state if self._history is None else (state, self._history.tobytes())

    def __setstate__(self, state: Any) -> None:  # noqa: ANN401 - each machine has its own
        if self._history is None:
            super().__setstate__(state)
            return
        state, samples_before = state
        history, before = array("d", samples_before), self._machine.state()
        super().__setstate__(state)
        samples = self.samples
        if len(history) != samples * len(self.variables):
            super().__setstate__(before)
            raise ValueError(
                f"expected a history of {samples} samples of {', '.join(self.variables)}, "
                f"got {len(history)} numbers"
            )
        self._history[:] = history

    def __repr__(self) -> str:
        return f"<EpisodeMonitor of {self.specification.formula}, {self.verdict.name}>"


# The slots that the machine writes and users read, in the order of its arguments.
_SHOWN = tuple(vars(EpisodeMonitor)[name] for name in ("robustness", "lower", "upper", "verdict"))
_VERDICTS = tuple(Verdict)
for _slot in _SHOWN:
    setattr(EpisodeMonitor, _slot.__name__, read_only(_slot))


def _recording(machine: EpisodeMachine, history: array[float], width: int) -> Callable[..., float]:
    """Return an update of the machine that adds its samples, nan if not known, to a history."""
    update, keep = machine.update, history.extend

    def recorded(*args: object, **named: object) -> float:
        robustness = update(*args, **named)
        keep([x if isinstance(x, float) else math.nan for x in machine.inputs[:width]])
        return robustness

    return recorded
